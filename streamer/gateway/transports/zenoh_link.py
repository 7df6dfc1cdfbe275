"""`ZenohLink`: how a run is reached over zenoh, and the keys of its messages.

`flexmotion/ROBOT/targets/OPERATOR`, `.../answers/OPERATOR`, `.../status`, `.../stop`, `.../estop`, `.../alive/PROCESS`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.admission import TOKEN_VARIABLE, Admission, Refusal
from flexmotion.streamer.gateway.ports import check_free
from flexmotion.streamer.gateway.proofs import Proofs
from flexmotion.streamer.gateway.transports.extras import need
from flexmotion.streamer.gateway.transports.zenoh_session import attached, configuration, payload

if TYPE_CHECKING:
    import zenoh

ROOT = "flexmotion"
_ENDPOINT = re.compile(r"^[a-z0-9_]+/(?:\[[^]]+\]|[^:/#?]+):\d+(?:[#?].*)?$")


def robot_key(robot: str, *parts: str) -> str:
    """A key of a robot."""
    return "/".join((ROOT, robot, *parts))


@dataclass(frozen=True)
class ZenohLink:
    """How a process of a run takes part in zenoh.

    Attributes:
        robot: name of the robot, a part of each key.
        token: that messages prove as their attachment (`flexmotion.streamer.gateway.proofs`); None: none is needed.
        listen: endpoint, such as "tcp/127.0.0.1:8792".
        connect: endpoints of routers, and of this run's other process.
    """

    robot: str
    token: str | None = field(repr=False)
    listen: str
    connect: tuple[str, ...] = ()
    _proofs: Proofs = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_proofs", Proofs(self.token))

    def key(self, *parts: str) -> str:
        """A key of this robot."""
        return robot_key(self.robot, *parts)

    def refusal(self, message: zenoh.Sample | zenoh.Query, *, at_any_time: bool = False) -> Refusal | None:
        """Why a message is not taken; None where it proves the token, or none is needed. See `Proofs.refusal`."""
        return self._proofs.refusal(attached(message), str(message.key_expr), payload(message), at_any_time=at_any_time)

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
    Admission(address, token)  # checks both
    routers = () if router is None else (router,)
    if router is not None:
        _check_router(router, token, open_to_all=settings.zenoh_open_router)
    for port in (settings.zenoh_port, settings.zenoh_stop_port):
        check_free(address, port, "zenoh port of the gateway")
    host = f"[{address}]" if ":" in address else address
    targets, stops = (f"tcp/{host}:{port}" for port in (settings.zenoh_port, settings.zenoh_stop_port))
    return ZenohLink(robot, token, targets, (*routers, stops)), ZenohLink(robot, token, stops, routers)


def _check_router(endpoint: str, token: str | None, *, open_to_all: bool) -> None:
    """Raise `ConfigError` where a router's endpoint is none, or the run has no token and may not be open to all.

    A router's own address says nothing about who reaches it: one on this machine may listen to a whole network.
    """
    if not _ENDPOINT.match(endpoint):
        raise ConfigError(f"--zenoh-router: {endpoint}: expected PROTOCOL/HOST:PORT, such as tcp/192.168.0.10:7447")
    if token is None and not open_to_all:
        raise ConfigError(
            f"--zenoh-router: {endpoint}: whoever reaches this router could steer the robot: set {TOKEN_VARIABLE} or "
            "give --token-file (or set gateway.zenoh_open_router in the stream settings, where only you reach it)"
        )
