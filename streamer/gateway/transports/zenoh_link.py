"""`ZenohLink`: how a run is reached over zenoh, and the keys of its messages.

`flexmotion/ROBOT/targets/OPERATOR`, `.../answers/OPERATOR`, `.../status`, `.../stop`, `.../estop`, `.../alive/PROCESS`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.admission import Admission, is_loopback
from flexmotion.streamer.gateway.ports import check_free
from flexmotion.streamer.gateway.transports.extras import need
from flexmotion.streamer.gateway.transports.zenoh_session import configuration

if TYPE_CHECKING:
    import zenoh

ROOT = "flexmotion"
_HOST = re.compile(r"^[a-z0-9_]+/(?:\[(?P<six>[^]]+)\]|(?P<host>[^:/#?]+)):\d+(?:[#?].*)?$")


@dataclass(frozen=True)
class ZenohLink:
    """How a process of a run takes part in zenoh.

    Attributes:
        robot: name of the robot, a part of each key.
        admission: whose token messages carry as their attachment.
        listen: endpoint, such as "tcp/127.0.0.1:8792".
        connect: endpoints of routers, and of this run's other process.
    """

    robot: str
    admission: Admission
    listen: str
    connect: tuple[str, ...] = ()

    def key(self, *parts: str) -> str:
        """A key of this robot."""
        return "/".join((ROOT, self.robot, *parts))

    def admits(self, message: zenoh.Sample | zenoh.Query) -> bool:
        """Whether a message carries the token, or none is needed."""
        return self.admission.opens(b"" if message.attachment is None else message.attachment.to_bytes())

    def config(self) -> zenoh.Config:
        """The configuration of its session: a peer."""
        return configuration(
            {
                "mode": "peer",
                "listen/endpoints": [self.listen],
                "connect/endpoints": list(self.connect),
                # A router may come later.
                "connect/timeout_ms": -1,
                "connect/exit_on_failure": False,
            }
        )


def zenoh_links(
    robot: str, address: str, token: str | None, settings: Gateway, router: str | None = None
) -> tuple[ZenohLink, ZenohLink]:
    """How the gateway and the stop process of a run take part in zenoh.

    The gateway is connected to the stop process, so that a client which knows the gateway alone reaches both.

    Raises:
        ConfigError: the library is missing, a port is taken, or an address needs a token.
    """
    need("zenoh", "--zenoh", "zenoh")
    admission = Admission(address, token)
    routers = () if router is None else (router,)
    if router is not None:
        _check_router(router, token)
    for port in (settings.zenoh_port, settings.zenoh_stop_port):
        check_free(address, port, "zenoh port of the gateway")
    host = f"[{address}]" if ":" in address else address
    targets, stops = (f"tcp/{host}:{port}" for port in (settings.zenoh_port, settings.zenoh_stop_port))
    return ZenohLink(robot, admission, targets, (*routers, stops)), ZenohLink(robot, admission, stops, routers)


def _check_router(endpoint: str, token: str | None) -> None:
    """Raise `ConfigError` where a router's endpoint is none, or is on another machine and the run has no token."""
    found = _HOST.match(endpoint)
    if found is None:
        raise ConfigError(f"--zenoh-router: {endpoint}: expected PROTOCOL/HOST:PORT, such as tcp/192.168.0.10:7447")
    host = found["six"] or found["host"]
    if token is None and not is_loopback(host):
        raise ConfigError(
            f"--zenoh-router: {host} is another machine, from which others reach this robot: set FLEXMOTION_TOKEN or "
            "give --token-file"
        )
