"""`Operator`: somebody who sends targets and emergency stops to a run over one transport."""

from __future__ import annotations

import itertools
import json
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from benchmarks.shared.pads import EmulatedPad
from flexmotion.configs.errors import GatewayError
from flexmotion.configs.stream import Gateway, StreamSettings, load_stream
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.listening import Listening
from flexmotion.streamer.gateway.ports import any_free

PATIENCE_S = 120.0
ROS2_TYPES = (*Gateway().ros2_types, "take")
"""As shipped, and the change of operators."""
NAME = "benchmark"
"""Source of the messages."""
ANSWERS = ("accepted", "slowed", "partly", "superseded", "expired", "refused")


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
        settings = load_stream().model_copy(
            update={"gateway": Gateway.model_validate({**ports, "ros2_types": ROS2_TYPES})}
        )
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

        wait(listens, "the gateway to listen")

    def client(self) -> Client:
        """A client of the run."""
        return Client(port=self.gateway.port, stop_port=self.gateway.stop_port, source=NAME)


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
        wait(lambda: "take" in self._told, f"{self.name}: the answer to 'take'")

    def send(self, turning: float) -> None:
        """Send a target: to turn on the spot [rad/s]."""
        identity = str(next(self._ids))
        self._asked[identity] = time.perf_counter()
        self.sent += 1
        self.put({"type": "velocity", "velocity": [0.0, 0.0, turning], "ttl_s": 2.0, "id": identity})

    def answers(self, number: int) -> tuple[Counter[str], list[float]]:
        """States of the answers to so many targets, and the times from sending to the answer [ms]."""
        end = time.monotonic() + PATIENCE_S
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


def wait(happens: Callable[[], object], what: str) -> None:
    """Wait until something happens. Raises `TimeoutError` after two minutes."""
    end = time.monotonic() + PATIENCE_S
    while not happens():
        if time.monotonic() > end:
            raise TimeoutError(f"waited {PATIENCE_S:g} s for {what}")
        time.sleep(0.01)
