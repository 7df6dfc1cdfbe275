"""Programs that send random targets to a run: over a WebSocket, over HTTP, and as lines on its standard input."""

from __future__ import annotations

import json
import threading
import time
from collections import Counter
from collections.abc import Callable
from http.client import HTTPConnection, HTTPException
from typing import IO, Any

import numpy as np

from flexmotion.configs.errors import GatewayError
from flexmotion.streamer.commands.choice import SWITCHED_PROMPTS
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.connection import PATIENCE_S

FASTEST = 0.4
"""Bound of turning [rad/s], and of walking ahead [m/s of the human]."""
_LOOK_S = 0.01

Ask = Callable[[dict[str, Any]], str]
"""Sends a message and returns the state of its answer."""


def drawn(random: np.random.Generator) -> dict[str, Any]:
    """A random target: words, a velocity, or a stand."""
    kind = random.random()
    if kind < 0.45:
        return {"type": "text", "text": str(random.choice(SWITCHED_PROMPTS)), "ttl_s": 8.0}
    if kind < 0.9:
        ahead, turning = random.uniform(-0.5, 1.0) * FASTEST, random.uniform(-1.0, 1.0) * FASTEST
        return {"type": "velocity", "velocity": [round(float(ahead), 3), 0.0, round(float(turning), 3)], "ttl_s": 4.0}
    return {"type": "hold"}


class Sender(threading.Thread):
    """One program that sends a random target every now and then, and waits for each answer.

    Args:
        name: of its source, and of the transport.
        ask: sends a message over the transport.
        now: time of the run [s].
        interval_s: mean time between two targets, on that clock [s].

    Attributes:
        sent: targets sent.
        states: answers by state; "none" where none came.
    """

    def __init__(self, name: str, ask: Ask, now: Callable[[], float], interval_s: float, seed: int) -> None:
        super().__init__(name=name, daemon=True)
        self.ask, self.now, self.interval_s = ask, now, interval_s
        self.sent, self.states = 0, Counter[str]()
        self._random, self._ended = np.random.default_rng(seed), threading.Event()

    def run(self) -> None:
        """See `Thread`."""
        due = self.now()
        while not self._ended.is_set():
            if self.now() < due:
                self._ended.wait(_LOOK_S)
                continue
            due = self.now() + float(self._random.uniform(0.2, 1.8)) * self.interval_s
            # Each takes the lease from the one before: all have the same priority.
            message = {**drawn(self._random), "source": self.name}
            self.sent += 1
            try:
                self.ask({"type": "take", "source": self.name})
                self.states[self.ask(message)] += 1
            except GatewayError:
                self.states["none"] += 1

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


class Lines:
    """The other end of a run's standard input and output: messages and answers, a JSON object a line."""

    def __init__(self, to_run: IO[bytes], from_run: IO[bytes]) -> None:
        self._to_run, self._from_run = to_run, from_run
        self._answers: dict[str, str] = {}
        self._arrived = threading.Condition()
        self._number = 0
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._from_run:
            try:
                answer = json.loads(line)
            except ValueError:
                continue  # the report, at the end
            if not isinstance(answer, dict) or answer.get("type") != "answer":
                continue
            with self._arrived:
                self._answers[str(answer.get("id"))] = answer["state"]
                self._arrived.notify_all()

    def ask(self, message: dict[str, Any]) -> str:
        """Send a message and wait for its answer. Raises `GatewayError` where none comes."""
        self._number += 1
        identity = f"line {self._number}"
        self._to_run.write(json.dumps({**message, "id": identity}).encode() + b"\n")
        self._to_run.flush()
        end = time.monotonic() + PATIENCE_S
        with self._arrived:
            while identity not in self._answers:
                if not self._arrived.wait(max(end - time.monotonic(), 0.0)) and time.monotonic() >= end:
                    raise GatewayError("standard input: no answer")
            return self._answers.pop(identity)


def three(port: int, lines: Lines, now: Callable[[], float], interval_s: float, seed: int) -> list[Sender]:
    """A sender for each transport, not yet started; each sends at a third of the rate."""
    ways: dict[str, Ask] = {
        "websocket": over_websocket(port, "websocket"),
        "http": over_http(port, "http"),
        "lines": lines.ask,
    }
    each = interval_s * len(ways)
    return [Sender(name, ask, now, each, seed + number) for number, (name, ask) in enumerate(ways.items())]
