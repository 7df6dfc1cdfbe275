"""Programs that send random targets to a run: over a WebSocket, over HTTP, and as lines on its standard input."""

from __future__ import annotations

import heapq
import json
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from http.client import HTTPConnection, HTTPException
from typing import Any

import numpy as np

from benchmarks.shared.lines import Lines
from flexmotion.configs.errors import GatewayError
from flexmotion.streamer.commands.choice import SWITCHED_PROMPTS
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.connection import PATIENCE_S

FASTEST = 0.4
"""Bound of turning [rad/s], and of walking ahead [m/s of the human]."""
WAYS = ("websocket", "http", "lines")
"""Names of the senders."""
_LOOK_S = 0.01
_REMEMBERED = 20

Ask = Callable[[dict[str, Any]], str]
"""Sends a message and returns the state of its answer."""
Due = tuple[float, dict[str, Any]]
"""When a target is due [s], and the target."""


def drawn(random: np.random.Generator) -> dict[str, Any]:
    """A random target: words, a velocity, or a stand."""
    kind = random.random()
    if kind < 0.45:
        return {"type": "text", "text": str(random.choice(SWITCHED_PROMPTS)), "ttl_s": 8.0}
    if kind < 0.9:
        ahead, turning = random.uniform(-0.5, 1.0) * FASTEST, random.uniform(-1.0, 1.0) * FASTEST
        return {"type": "velocity", "velocity": [round(float(ahead), 3), 0.0, round(float(turning), 3)], "ttl_s": 4.0}
    return {"type": "hold"}


def schedule(interval_s: float, seed: int) -> Iterator[Due]:
    """Random targets at random intervals, without an end; the same ones for the same seed."""
    random, due_s = np.random.default_rng(seed), 0.0
    while True:
        yield due_s, drawn(random)
        due_s += float(random.uniform(0.2, 1.8)) * interval_s


def schedules(interval_s: float, seed: int) -> dict[str, Iterator[Due]]:
    """One for each sender; together they send at the mean interval."""
    return {name: schedule(interval_s * len(WAYS), seed + number) for number, name in enumerate(WAYS)}


def merged(interval_s: float, seed: int) -> Iterator[Due]:
    """The targets of all senders, as one schedule."""
    return heapq.merge(*schedules(interval_s, seed).values(), key=lambda due: due[0])


class Sender(threading.Thread):
    """One program that sends targets when they are due, and waits for each answer.

    Args:
        name: of its source, and of the transport.
        ask: sends a message over the transport.
        now: time of the run [s].
        due: the targets.

    Attributes:
        sent: targets sent.
        states: answers by state; "none" where none came.
        newest: the last targets, each as time [s], target and state.
    """

    def __init__(self, name: str, ask: Ask, now: Callable[[], float], due: Iterator[Due]) -> None:
        super().__init__(name=name, daemon=True)
        self.ask, self.now, self.due = ask, now, due
        self.sent, self.states = 0, Counter[str]()
        self.newest: deque[tuple[float, dict[str, Any], str]] = deque(maxlen=_REMEMBERED)
        self._ended = threading.Event()

    def run(self) -> None:
        """See `Thread`."""
        for due_s, target in self.due:
            while self.now() < due_s:
                if self._ended.wait(_LOOK_S):
                    return
            if self._ended.is_set():
                return
            self.sent += 1
            at_s = self.now()
            try:
                # Each takes the lease from the one before: all have the same priority.
                self.ask({"type": "take", "source": self.name})
                state = self.ask({**target, "source": self.name})
            except GatewayError:
                state = "none"
            self.states[state] += 1
            self.newest.append((at_s, target, state))

    def end(self, patience_s: float) -> None:
        """Send no more, and wait for the last answer."""
        self._ended.set()
        self.join(patience_s)


def over_websocket(port: int, name: str) -> Ask:
    """Over one WebSocket, which stays open."""
    client = Client(port=port, source=name)
    return lambda message: str(client.ask(message).state)


def over_http(port: int, name: str) -> Ask:
    """By a POST for each message."""

    def ask(message: dict[str, Any]) -> str:
        connection = HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
        try:
            connection.request("POST", "/targets", json.dumps(message).encode())
            return str(json.loads(connection.getresponse().read())["state"])
        except (OSError, HTTPException, ValueError) as error:
            raise GatewayError(f"{name}: {error}") from error
        finally:
            connection.close()

    return ask


def three(port: int, lines: Lines, now: Callable[[], float], interval_s: float, seed: int) -> list[Sender]:
    """A sender for each transport, not yet started."""
    ways: dict[str, Ask] = {
        "websocket": over_websocket(port, "websocket"),
        "http": over_http(port, "http"),
        "lines": lines.ask,
    }
    return [Sender(name, ways[name], now, due) for name, due in schedules(interval_s, seed).items()]
