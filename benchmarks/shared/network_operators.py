"""Operators over a network: WebSocket, HTTP, zenoh, ROS 2."""

from __future__ import annotations

import json
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from http.client import HTTPConnection
from typing import Any

import zenoh
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from benchmarks.shared.operators import NAME, PATIENCE_S, Operator, Place, wait
from flexmotion.streamer.gateway.transports.ros2_messages import EMPTY, STRING, Ros2Messages
from flexmotion.streamer.gateway.transports.ros2_node import Ros2Link, Ros2Node
from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.run.requests import RequestChannel

_POSTS = 8
"""POSTs that wait for their answers at a time."""


class OverWebSocket(Operator):
    """Targets over a WebSocket, stops over HTTP."""

    name = "websocket"

    def __init__(self, place: Place, stack: ExitStack) -> None:
        super().__init__()
        self._client = place.client()
        self._socket = stack.enter_context(connect(f"ws://127.0.0.1:{place.gateway.port}/targets"))
        threading.Thread(target=self._read, daemon=True).start()

    def put(self, message: dict[str, Any]) -> None:
        """See `Operator.put`."""
        self._socket.send(json.dumps({**message, "source": NAME}))

    def estop(self) -> None:
        """See `Operator.estop`."""
        self._client.estop()

    def _read(self) -> None:
        with suppress(ConnectionClosed):  # the run has ended
            for frame in self._socket:
                self.told(frame)


class OverHttp(Operator):
    """Both over HTTP, a connection a message."""

    name = "http"

    def __init__(self, place: Place, stack: ExitStack) -> None:
        super().__init__()
        self._place = place
        self._posting = stack.enter_context(ThreadPoolExecutor(_POSTS))

    def put(self, message: dict[str, Any]) -> None:
        """See `Operator.put`; the answer to a POST comes when a plan follows it."""
        port = self._place.gateway.port
        self._posting.submit(lambda: self.told(_posted(port, "/targets", {**message, "source": NAME})))

    def estop(self) -> None:
        """See `Operator.estop`."""
        _posted(self._place.gateway.stop_port, "/estop")


def _posted(port: int, path: str, message: dict[str, Any] | None = None) -> bytes:
    connection = HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
    try:
        connection.request("POST", path, None if message is None else json.dumps(message))
        return connection.getresponse().read()
    finally:
        connection.close()


class OverZenoh(Operator):
    """Both over zenoh, connected to the gateway and to the stop process."""

    name = "zenoh"

    def __init__(self, place: Place, stack: ExitStack) -> None:
        super().__init__()
        ports = place.gateway.zenoh_port, place.gateway.zenoh_stop_port
        self._session = stack.enter_context(session("peer", [f"tcp/127.0.0.1:{port}" for port in ports]))
        alive = self._session.liveliness()
        wait(lambda: len(list(alive.get("flexmotion/op3/alive/*"))) == len(ports), "the run over zenoh")
        self._reading = self._session.declare_subscriber(
            f"flexmotion/op3/answers/{NAME}", lambda sample: self.told(sample.payload.to_bytes())
        )

    def put(self, message: dict[str, Any]) -> None:
        """See `Operator.put`."""
        self._session.put(f"flexmotion/op3/targets/{NAME}", json.dumps(message))

    def estop(self) -> None:
        """See `Operator.estop`."""
        self._session.put("flexmotion/op3/estop", b"")


class OverRos2(Operator):
    """Both from another node of ROS 2, over a router."""

    name = "ros2"

    def __init__(self, place: Place, stack: ExitStack) -> None:
        super().__init__()
        link, self._messages = Ros2Link("op3", place.gateway.ros2_port, 0), Ros2Messages()
        stack.enter_context(session("router", [], [link.router]))
        own = stack.enter_context(session("client", [link.router]))
        self._node = Ros2Node(link, own, NAME, self._messages, Way(NAME, RequestChannel()))
        ends = ("flexmotion/%op3%cmd_vel_unstamped", "flexmotion_stops/%op3%estop")
        alive = own.liveliness()
        wait(lambda: all(list(alive.get(f"@ros2_lv/**/{end}/**")) for end in ends), "the run in ROS 2")
        self._node.subscribe("answers", STRING, lambda data: self.told(self._messages.decode(STRING, data).data))
        self._put, self._stop = self._node.publish("targets", STRING), self._node.publish("estop", EMPTY)

    def put(self, message: dict[str, Any]) -> None:
        """See `Operator.put`."""
        self._put(self._messages.string(json.dumps(message)))

    def estop(self) -> None:
        """See `Operator.estop`."""
        self._stop(self._messages.empty())


def session(mode: str, connected: list[str], listen: list[str] | None = None) -> Any:
    """A session of zenoh."""
    config = zenoh.Config()
    values = {"mode": mode, "connect/endpoints": connected, "listen/endpoints": listen or []}
    for key, value in {**values, "scouting/multicast/enabled": False, "connect/timeout_ms": -1}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)
