"""`Viewer`: the service that shows a run in a browser; the run does not wait for it."""

from __future__ import annotations

import multiprocessing
import os
import socket
from collections.abc import Callable

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.streamer.control.telemetry import Telemetry

HOST = "127.0.0.1"
FIRST_PORT = 8080
_PORTS = 100
"""Number of ports to try, from the requested one on."""
_NICENESS = 10
"""Niceness: the viewer uses the time that the run leaves."""


class Viewer:
    """A web page with the robot as measured and as planned, its feet, balance and health.

    It is a `flexmotion.streamer.run.supervisor.Service`.

    Args:
        port: first port to try.

    Attributes:
        name: name of the service.
        port: port of the page, on this machine only.

    Raises:
        ConfigError: no port is free.
    """

    name = "viewer"

    def __init__(self, robot: Robot, telemetry: Telemetry, *, port: int = FIRST_PORT) -> None:
        self.robot, self.telemetry, self.port = robot, telemetry, free_port(port)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.port}"

    def follow(self) -> Callable[[bool], None]:
        """Serve the page; returns the function that updates it."""
        if multiprocessing.parent_process() is not None:  # in lockstep the viewer is in the run's process
            os.nice(_NICENESS)
        # The web server takes half a second to load; only this process needs it.
        from flexmotion.streamer.viewer.view_page import ViewPage

        return ViewPage(self.robot, self.telemetry, HOST, self.port).follow


def free_port(first: int) -> int:
    """The first free port of this machine from `first` on. Raises `ConfigError` if none is free."""
    last = min(first + _PORTS, 65536)
    for port in range(first, last):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return port
    raise ConfigError(f"--view-port: ports {first} to {last - 1} are all taken or not allowed")
