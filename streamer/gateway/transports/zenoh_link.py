"""`ZenohLink`: how a run is reached over zenoh, and the keys of its messages.

`flexmotion/ROBOT/targets/OPERATOR`, `.../answers/OPERATOR`, `.../status`, `.../stop`, `.../estop`, `.../alive/PROCESS`.
"""

from __future__ import annotations

import json
import logging
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.admission import Admission, is_loopback
from flexmotion.streamer.gateway.ports import check_free
from flexmotion.streamer.gateway.transports.extras import need

if TYPE_CHECKING:
    import zenoh

ROOT = "flexmotion"
_LARGEST = 65536
"""Longest message that is put together from its parts [bytes]; the desk refuses far shorter ones and says so."""
_RETRY_S = 2.0
"""Time between two attempts to open a session [s]."""
_HOST = re.compile(r"^[a-z0-9_]+/(?:\[(?P<six>[^]]+)\]|(?P<host>[^:/#?]+)):\d+(?:[#?].*)?$")

log = logging.getLogger(__name__)


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
        """The configuration of its session: a peer that looks for nobody by itself."""
        import zenoh

        config = zenoh.Config()
        for key, value in {
            "mode": "peer",
            "listen/endpoints": [self.listen],
            "connect/endpoints": list(self.connect),
            # A router may come later, and come back.
            "connect/timeout_ms": -1,
            "connect/exit_on_failure": False,
            "connect/retry": {"period_init_ms": 250, "period_max_ms": 2000, "period_increase_factor": 2},
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "transport/link/rx/max_message_size": _LARGEST,
        }.items():
            config.insert_json5(key, json.dumps(value))
        return config

    def begin(self, serve: Callable[[zenoh.Session], list[Any]], name: str) -> Callable[[], None]:
        """Open a session in a thread of its own, and again until it works; returns what closes it.

        Args:
            serve: declares what the session is for, once, and returns it: it lasts as long as somebody refers to it.
            name: of the thread, and in messages.
        """
        ended = threading.Event()
        opened: list[zenoh.Session] = []
        declared: list[Any] = []

        def run() -> None:
            import zenoh

            while not ended.is_set():
                try:
                    session = zenoh.open(self.config())
                except zenoh.ZError as error:
                    log.warning("%s: zenoh cannot be opened at %s: %s", name, self.listen, error)
                    ended.wait(_RETRY_S)
                    continue
                opened.append(session)
                declared.extend(serve(session))
                return

        thread = threading.Thread(target=run, name=name, daemon=True)
        thread.start()

        def end() -> None:
            ended.set()
            thread.join(_RETRY_S)
            declared.clear()
            for session in opened:
                session.close()

        return end


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


def payload(message: Any) -> bytes:
    """The bytes of a sample or a query; a query may have none."""
    return b"" if message.payload is None else bytes(message.payload.to_bytes())


def direct(take: Callable[[Any], None]) -> Any:
    """A handler that is called in zenoh's own thread: a function that waits makes the sender wait."""
    from zenoh import handlers

    return handlers.Callback(take, indirect=False)
