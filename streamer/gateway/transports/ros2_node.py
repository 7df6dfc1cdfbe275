"""`Ros2Node`: a node of ROS 2 over zenoh, as `rmw_zenoh` names topics and tells who publishes and subscribes.

Keys and tokens: design.md of `rmw_zenoh`. Checked against `zenoh-ros2-sdk`.
"""

from __future__ import annotations

import os
import secrets
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.gateway.transports.ros2_messages import Ros2Messages
from flexmotion.streamer.gateway.transports.zenoh_session import configuration, direct, payload
from flexmotion.streamer.gateway.ways import Way

if TYPE_CHECKING:
    import zenoh

_OPEN_MS = 2000
_QOS = "::,10:,:,:,,"
"""Reliable, volatile, the last ten, as by default."""


@dataclass(frozen=True)
class Ros2Link:
    """Where a process finds ROS 2.

    Attributes:
        robot: name of the robot, its namespace.
        port: of the zenoh router on this machine; others are reached through it alone.
        domain: number of the domain.
    """

    robot: str
    port: int
    domain: int

    @property
    def router(self) -> str:
        """Endpoint of the router."""
        return f"tcp/127.0.0.1:{self.port}"

    def config(self) -> zenoh.Config:
        """The configuration of its session: a client of the router, which listens nowhere."""
        return configuration(
            {
                "mode": "client",
                "connect/endpoints": [self.router],
                "connect/timeout_ms": _OPEN_MS,
                "connect/exit_on_failure": True,
            }
        )


def domain_from_environment() -> int:
    """The domain of `ROS_DOMAIN_ID`, else 0. Raises `ConfigError` where that is no number of a domain."""
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not text.isdecimal() or int(text) > 232:
        raise ConfigError(f"ROS_DOMAIN_ID: {text}: expected a number from 0 to 232")
    return int(text)


class Ros2Node:
    """A node in the robot's namespace.

    Args:
        link: where it is.
        session: of zenoh, open.
        name: of the node.
        way: is told of errors in what takes its messages.

    Attributes:
        declared: what has been declared; it lasts as long as somebody refers to it.
    """

    def __init__(self, link: Ros2Link, session: zenoh.Session, name: str, messages: Ros2Messages, way: Way) -> None:
        self.link, self.messages, self.way = link, messages, way
        self._session, self._name, self._entities = session, name, 0
        self._node = f"@ros2_lv/{link.domain}/{session.info.zid()}/0"
        self.declared: list[Any] = [session.liveliness().declare_token(f"{self._node}/0/NN/%/%{link.robot}/{name}")]

    def subscribe(self, topic: str, kind: str, take: Callable[[bytes], None]) -> None:
        """Have `take` called with each message of a topic, as CDR, in zenoh's own thread."""
        # Any hash: distributions before Jazzy send none.
        key = f"{self._key(topic, kind)}/*"
        self.declared.append(
            self._session.declare_subscriber(key, direct(lambda sample: take(payload(sample)), self.way))
        )
        self._announce("MS", topic, kind)

    def publish(self, topic: str, kind: str) -> Callable[[bytes], None]:
        """Function that publishes a message, as CDR, on a topic."""
        self._announce("MP", topic, kind)
        publisher = self._session.declare_publisher(f"{self._key(topic, kind)}/{self.messages.hash(kind)}")
        self.declared.append(publisher)
        identity = secrets.token_bytes(16)
        number = 0

        def send(data: bytes) -> None:
            nonlocal number
            number += 1
            attachment = struct.pack("<qqB", number, time.time_ns(), len(identity)) + identity
            publisher.put(data, attachment=attachment)

        return send

    def _announce(self, role: str, topic: str, kind: str) -> None:
        """Tell the graph of ROS 2 of a publisher (MP) or a subscription (MS)."""
        self._entities += 1
        token = (
            f"{self._node}/{self._entities}/{role}/%/%{self.link.robot}/{self._name}/"
            f"%{self.link.robot}%{topic.replace('/', '%')}/{_dds(kind)}/{self.messages.hash(kind)}/{_QOS}"
        )
        self.declared.append(self._session.liveliness().declare_token(token))

    def _key(self, topic: str, kind: str) -> str:
        return f"{self.link.domain}/{self.link.robot}/{topic}/{_dds(kind)}"


def _dds(kind: str) -> str:
    """The type's name in DDS: `std_msgs::msg::dds_::String_`."""
    package, _, name = kind.split("/")
    return f"{package}::msg::dds_::{name}_"
