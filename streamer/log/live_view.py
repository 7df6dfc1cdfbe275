"""`LiveView`: the service that shows a run in Foxglove while it goes on, by the topics of its log."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable

import foxglove
from foxglove import Context

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.log.channels import Channels
from flexmotion.streamer.log.following import Following, Published

ADDRESS = "127.0.0.1"
"""Foxglove's protocol has no token: only this machine is listened to. Others come through a tunnel."""
_BACKLOG = 512
"""Messages kept for a viewer that reads slowly, before its oldest are dropped."""


class LiveView:
    """A `flexmotion.streamer.run.supervisor.Service`: a WebSocket server for Foxglove, which takes nothing from it.

    Args:
        port: to listen on.
        published: by the run.

    Attributes:
        name: of its process.
        url: for Foxglove, "Open connection".

    Raises:
        ConfigError: the port is taken.
    """

    name = "foxglove"

    def __init__(self, port: int, published: Published) -> None:
        self.port, self.published = port, published
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((ADDRESS, port))
            except OSError as error:
                reason = error.strerror or error
                raise ConfigError(f"--foxglove: {ADDRESS}:{port} cannot be listened on: {reason}") from error
        self._parent = os.getpid()

    @property
    def url(self) -> str:
        """Address of the server."""
        return f"ws://{ADDRESS}:{self.port}"

    def follow(self) -> Callable[[bool], None]:
        """See `Service.follow`: the server has threads of its own, and nothing of Python in them."""
        if os.getpid() != self._parent:
            os.nice(10)
        context = Context()
        channels = Channels(context, self.published.header.joints)
        server = foxglove.start_server(
            name=f"FlexMotion: {self.published.header.robot}",
            host=ADDRESS,
            port=self.port,
            context=context,
            message_backlog_size=_BACKLOG,
        )
        following: Following | None = None

        def step(last: bool) -> None:
            nonlocal following
            if last:
                server.stop()
            elif not channels.watched:
                following = None  # what happened before a viewer came is in the log
            else:
                following = following or Following(self.published, channels, new_only=True)
                following.step()

        return step
