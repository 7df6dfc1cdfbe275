"""`Feed`: what a page is sent about a run: pictures, figures, curves, events, and what was asked."""

from __future__ import annotations

import json
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from flexmotion.configs.robot import Robot
from flexmotion.streamer.control.telemetry import Event, Telemetry, events
from flexmotion.streamer.motion.heard import Heard, HeardChannel, heard_since
from flexmotion.streamer.motion.human_channel import HumanChannel
from flexmotion.streamer.page.advice import advice, headline
from flexmotion.streamer.page.curves import NAMES, Curves
from flexmotion.streamer.page.health import Health
from flexmotion.streamer.page.pictures import Pictures, Row

_KEPT = 60
"""Events and answers that a page gets when it is opened."""
_HEALTH_S = 0.25
_JOINTS = 6


class Feed:
    """Follows a run for all pages that are open.

    Args:
        items: answers to the script or the prompt.
        simulated: the robot is.
        source_of: gives the name of who sent a target, by its number; None: nobody knows.
    """

    def __init__(
        self,
        robot: Robot,
        telemetry: Telemetry,
        humans: HumanChannel | None,
        heard: HeardChannel,
        items: Sequence[Heard] = (),
        source_of: Callable[[int], str | None] = lambda _number: None,
        *,
        simulated: bool = False,
    ) -> None:
        self.robot, self.source_of, self.simulated = robot, source_of, simulated
        self.pictures, self.health, self.curves = Pictures(robot, humans), Health(robot), Curves(robot)
        self._rows, self._events, self._heard = telemetry.ticks.reader(), telemetry.events.reader(), heard.reader()
        self._told: deque[str] = deque((self._asked(item) for item in items), maxlen=_KEPT)
        self._happened: deque[str] = deque(maxlen=_KEPT)
        self._target_ms: float | None = None
        self._health_s = -math.inf
        self.update()

    def opened(self) -> list[str]:
        """What a page is sent first: the last half minute."""
        curves = _text({"type": "curves", "names": NAMES, "samples": list(self.curves.samples), "begin": True})
        return [curves, *self._happened, *self._told]

    def update(self) -> tuple[bytes | None, list[str]]:
        """The picture of the newest row (None: no new row), and texts."""
        rows = self._rows.read()
        texts = []
        for event in events(self._events):
            self._happened.append(_event(event, self.robot.rate_hz, self.simulated))
            texts.append(self._happened[-1])
        for heard in heard_since(self._heard):
            self._told.append(self._asked(heard))
            texts.append(self._told[-1])
        if not len(rows):
            return None, texts
        self.health.take(rows)
        followed = rows["target_to_command_s"][np.isfinite(rows["target_to_command_s"])]
        if len(followed):
            self._target_ms = 1e3 * float(followed[-1])
        new = self.curves.take(rows)
        if new:
            texts.append(_text({"type": "curves", "samples": new}))
        now = time.monotonic()
        if now - self._health_s >= _HEALTH_S:
            self._health_s = now
            texts.append(_text(self._figures(rows[-1])))
        return self.pictures.of(rows[-1]), texts

    def _figures(self, row: Row) -> dict[str, Any]:
        health = self.health
        return {
            "type": "health",
            "hardest": [[load.joint, round(load.share, 3)] for load in health.hardest(_JOINTS)],
            "temperatures": [_number(value, 1) for value in row["temperature"]],
            "voltages": [_number(value, 2) for value in row["voltage"]],
            "wake_ms": [_number(1e3 * health.lateness_s(share), 2) for share in (50, 99)],
            "work_ms": [_number(1e3 * health.work_s(share), 2) for share in (50, 99)],
            "sample_ms": _number(1e3 * float(row["sample_s"]), 1),
            "retarget_ms": _number(1e3 * float(row["retarget_s"]), 1),
            "target_to_command_ms": _number(self._target_ms, 1),
            **{
                name: int(row[name])
                for name in (
                    *("plan", "late_plans", "underruns", "missed_deadlines", "violations"),
                    *("steps_planned", "steps_inserted"),
                )
            },
            "hung": bool(row["hung"]),
        }

    def _asked(self, heard: Heard) -> str:
        content = heard.model_dump(mode="json", exclude_none=True)
        source = self.source_of(heard.id) if heard.id else "script"
        return _text({"type": "heard", "source": source, **content})


def _event(event: Event, rate_hz: float, simulated: bool) -> str:
    content = {"type": "event", "time_s": round(event.tick / rate_hz, 2), "kind": event.kind, "message": event.message}
    if event.kind != "request":
        known = {"headline": headline, "advice": advice}
        told = {name: of(event.message, simulated=simulated) for name, of in known.items()}
        content |= {name: text for name, text in told.items() if text is not None}
    return _text(content)


def _text(content: dict[str, Any]) -> str:
    """Content as JSON. Raises `ValueError` where a number is not finite: no browser can read it."""
    return json.dumps(content, allow_nan=False)


def _number(value: float | None, digits: int) -> float | None:
    return None if value is None or not math.isfinite(value) else round(float(value), digits)
