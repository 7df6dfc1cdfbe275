"""`Operator`: somebody who sends targets and emergency stops to a run over one transport."""

from __future__ import annotations

import asyncio
import io
import itertools
import json
import os
import pty
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from http.client import HTTPConnection
from typing import Any

import zenoh
from evdev import ecodes
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from benchmarks.shared.pads import EmulatedPad, wait_for_readers
from flexmotion.configs.errors import GatewayError
from flexmotion.configs.stream import Gateway, StreamSettings, load_stream
from flexmotion.streamer.gateway.async_client import AsyncClient
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.keyboard import Keyboard, keys_at_once
from flexmotion.streamer.gateway.listening import Listening
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.transports.ros2_messages import EMPTY, STRING, Ros2Messages
from flexmotion.streamer.gateway.transports.ros2_node import Ros2Link, Ros2Node

_PATIENCE_S = 120.0
_NAME = "benchmark"
_POSTS = 8
"""POSTs that wait for their answers at a time."""
_ANSWERS = ("accepted", "slowed", "partly", "superseded", "expired", "refused")


@dataclass(frozen=True)
class Place:
    """Where a run listens.

    Attributes:
        settings: of its stream, with ports that are free.
        listening: on all transports.
        pad: its gamepad.
    """

    settings: StreamSettings
    listening: Listening
    pad: EmulatedPad

    @classmethod
    def free(cls, stack: ExitStack) -> Place:
        """A place for a run, until the stack is left."""
        pad = EmulatedPad()
        stack.callback(pad.close)
        names = ("port", "stop_port", "zenoh_port", "zenoh_stop_port", "ros2_port")
        ports = {name: any_free() for name in names}
        settings = load_stream().model_copy(update={"gateway": Gateway.model_validate(ports)})
        return cls(settings, Listening(zenoh=True, ros2=True, gamepad=pad.find), pad)

    @property
    def gateway(self) -> Gateway:
        """Settings of the gateway, with its ports."""
        return self.settings.gateway

    def wait(self) -> None:
        """Wait until the gateway listens."""

        def listens() -> bool:
            try:
                return bool(self.client().status())
            except GatewayError:
                return False

        _wait(listens, "the gateway to listen")

    def client(self) -> Client:
        """A client of the run."""
        return Client(port=self.gateway.port, stop_port=self.gateway.stop_port, source=_NAME)


class Operator:
    """One who sends messages that carry an id, and gets an answer to each.

    Attributes:
        name: of the transport.
        sent: number of targets that have been sent.
    """

    name = ""

    def __init__(self) -> None:
        self.sent = 0
        self._ids = itertools.count(1)
        self._asked: dict[str, float] = {}
        self._told: dict[str, tuple[str, float]] = {}

    def put(self, message: dict[str, Any]) -> None:
        """Send a message."""
        raise NotImplementedError

    def estop(self) -> None:
        """Send an emergency stop."""
        raise NotImplementedError

    def take(self) -> None:
        """Take the lease over."""
        self.put({"type": "take", "id": "take"})
        _wait(lambda: "take" in self._told, f"{self.name}: the answer to 'take'")

    def send(self, turning: float) -> None:
        """Send a target: to turn on the spot [rad/s]."""
        identity = str(next(self._ids))
        self._asked[identity] = time.perf_counter()
        self.sent += 1
        self.put({"type": "velocity", "velocity": [0.0, 0.0, turning], "ttl_s": 2.0, "id": identity})

    def answers(self, number: int) -> tuple[Counter[str], list[float]]:
        """States of the answers to so many targets, and the times from sending to the answer [ms]."""
        end = time.monotonic() + _PATIENCE_S
        while len(self._told.keys() & self._asked.keys()) < number and time.monotonic() < end:
            time.sleep(0.01)
        found = [self._told[identity] for identity in self._asked if identity in self._told]
        return Counter(state for state, _ in found), [1e3 * took for _, took in found]

    def told(self, text: str | bytes) -> None:
        """Take an answer, as JSON."""
        content = json.loads(text)
        identity = content.get("id")
        if content.get("type") == "answer" and identity is not None:
            self._told[identity] = (content["state"], time.perf_counter() - self._asked.get(identity, 0.0))


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
        self._socket.send(json.dumps({**message, "source": _NAME}))

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
        self._posting.submit(lambda: self.told(_posted(port, "/targets", {**message, "source": _NAME})))

    def estop(self) -> None:
        """See `Operator.estop`."""
        _posted(self._place.gateway.stop_port, "/estop")


def _posted(port: int, path: str, message: dict[str, Any] | None = None) -> bytes:
    connection = HTTPConnection("127.0.0.1", port, timeout=_PATIENCE_S)
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
        _wait(lambda: len(list(alive.get("flexmotion/op3/alive/*"))) == len(ports), "the run over zenoh")
        self._reading = self._session.declare_subscriber(
            f"flexmotion/op3/answers/{_NAME}", lambda sample: self.told(sample.payload.to_bytes())
        )

    def put(self, message: dict[str, Any]) -> None:
        """See `Operator.put`."""
        self._session.put(f"flexmotion/op3/targets/{_NAME}", json.dumps(message))

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
        self._node = Ros2Node(link, own, _NAME, self._messages)
        ends = ("flexmotion/%op3%cmd_vel_unstamped", "flexmotion_stops/%op3%estop")
        alive = own.liveliness()
        _wait(lambda: all(list(alive.get(f"@ros2_lv/**/{end}/**")) for end in ends), "the run in ROS 2")
        self._node.subscribe("answers", STRING, lambda data: self.told(self._messages.decode(STRING, data).data))
        self._put, self._stop = self._node.publish("targets", STRING), self._node.publish("estop", EMPTY)

    def put(self, message: dict[str, Any]) -> None:
        """See `Operator.put`."""
        self._put(self._messages.string(json.dumps(message)))

    def estop(self) -> None:
        """See `Operator.estop`."""
        self._stop(self._messages.empty())


class _Counted(Operator):
    """One whose messages carry no id that it knows: the gateway's counts say what became of them."""

    def __init__(self, place: Place) -> None:
        super().__init__()
        self._client = place.client()
        self._before = self._counts()

    def _counts(self) -> Counter[str]:
        return Counter(self._client.status()["counts"])

    def release(self) -> None:
        """Let all keys and sticks go."""

    def answers(self, number: int) -> tuple[Counter[str], list[float]]:
        """See `Operator.answers`."""
        self.release()
        end = time.monotonic() + _PATIENCE_S
        while True:
            time.sleep(0.5)
            found = self._counts() - self._before
            states = Counter({state: found[state] for state in _ANSWERS if found[state]})
            self.sent = found["received"]
            if states.total() == self.sent >= number or time.monotonic() > end:
                return states, []


class OverGamepad(_Counted):
    """Both by a gamepad."""

    name = "gamepad"

    def __init__(self, place: Place, _stack: ExitStack) -> None:
        super().__init__(place)
        self._pad = place.pad
        wait_for_readers(self._pad, 2)

    def take(self) -> None:
        """See `Operator.take`."""
        self._pad.press(ecodes.BTN_SELECT)
        self._move(ecodes.EV_KEY, ecodes.BTN_TL, 1)

    def send(self, turning: float) -> None:
        """See `Operator.send`; the stick is moved."""
        self._move(ecodes.EV_ABS, ecodes.ABS_RX, int(-32767 * turning))

    def release(self) -> None:
        """See `_Counted.release`."""
        self._move(ecodes.EV_ABS, ecodes.ABS_RX, 0)

    def estop(self) -> None:
        """See `Operator.estop`."""
        self._pad.press(ecodes.BTN_MODE)

    def _move(self, kind: int, code: int, value: int) -> None:
        self._pad.send(kind, code, value)
        self._pad.send(ecodes.EV_SYN, ecodes.SYN_REPORT, 0)


class OverKeyboard(_Counted):
    """Both by keys, in a pseudo-terminal."""

    name = "keyboard"

    def __init__(self, place: Place, stack: ExitStack) -> None:
        super().__init__(place)
        self._keys, terminal = pty.openpty()
        shown = io.StringIO()
        keyboard = Keyboard(
            lambda: AsyncClient(port=place.gateway.port, source="keyboard"), place.client(), (0.3, 0.15, 0.4), shown
        )

        def steer() -> None:
            with keys_at_once(terminal):
                asyncio.run(keyboard.run(terminal))

        thread = threading.Thread(target=steer, daemon=True)
        thread.start()
        stack.callback(thread.join, _PATIENCE_S)
        stack.callback(os.close, self._keys)
        _wait(lambda: "connected" in shown.getvalue(), "the keyboard's connection")

    def take(self) -> None:
        """See `Operator.take`."""
        os.write(self._keys, b"t")

    def send(self, turning: float) -> None:
        """See `Operator.send`; a key is pressed."""
        os.write(self._keys, b"a" if turning > 0.0 else b"d")

    def estop(self) -> None:
        """See `Operator.estop`."""
        os.write(self._keys, b"!")


OPERATORS: dict[str, Callable[[Place, ExitStack], Operator]] = {
    one.name: one for one in (OverWebSocket, OverHttp, OverZenoh, OverRos2, OverGamepad, OverKeyboard)
}
"""By the name of the transport."""


def session(mode: str, connected: list[str], listen: list[str] | None = None) -> Any:
    """A session of zenoh."""
    config = zenoh.Config()
    values = {"mode": mode, "connect/endpoints": connected, "listen/endpoints": listen or []}
    for key, value in {**values, "scouting/multicast/enabled": False, "connect/timeout_ms": -1}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def _wait(happens: Callable[[], object], what: str) -> None:
    end = time.monotonic() + _PATIENCE_S
    while not happens():
        if time.monotonic() > end:
            raise TimeoutError(f"waited {_PATIENCE_S:g} s for {what}")
        time.sleep(0.01)
