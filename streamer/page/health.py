"""Figures of a run over its last seconds."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.robot import Robot
from flexmotion.streamer.control.ladder import State

Float = NDArray[np.float64]
Row = np.ndarray[Any, Any]

WINDOW_S, LOAD_S = 5.0, 1.0
"""Windows of lateness and work, and of load [s]."""
MOST_LOAD = 9.99
"""Greatest share of an envelope that is shown. A servo at its temperature limit gives no torque, and its share
is infinite."""


@dataclass(frozen=True)
class Load:
    """RMS load of a joint: share of its servo's envelope at its speed, supply and temperature."""

    joint: str
    share: float


class Health:
    """Figures over the newest rows.

    Attributes:
        row: the newest row.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        window = int(WINDOW_S * robot.rate_hz)
        self._lateness: deque[float] = deque(maxlen=window)
        self._work: deque[float] = deque(maxlen=window)
        self._envelope = Envelope.of(robot)
        self._loads: deque[Float] = deque(maxlen=int(LOAD_S * robot.rate_hz))
        self.row: Row | None = None

    def take(self, rows: Row) -> None:
        """Take rows (k,), k > 0."""
        self._lateness.extend(rows["lateness_s"].tolist())
        self._work.extend(rows["work_s"].tolist())
        self._loads.extend(load(self._envelope, rows))
        self.row = rows[-1]

    @property
    def state(self) -> State:
        """State of the safety ladder."""
        return State.OFF if self.row is None else State(int(self.row["state"]))

    @property
    def time_s(self) -> float:
        """Time of the loop since its start [s]."""
        return 0.0 if self.row is None else float(self.row["tick"]) / self.robot.rate_hz

    def lateness_s(self, percentile: float) -> float:
        """Percentile of how late the loop woke [s]; NaN before the first row."""
        return _percentile(self._lateness, percentile)

    def work_s(self, percentile: float) -> float:
        """Percentile of how long a tick's work took [s]; NaN before the first row."""
        return _percentile(self._work, percentile)

    def hardest(self, count: int) -> list[Load]:
        """The joints with the highest load, highest first; none before the first row."""
        if not self._loads:
            return []
        rms = np.sqrt(np.mean(np.square(np.stack(self._loads)), axis=0))
        return [Load(self.robot.joint_names[joint], float(rms[joint])) for joint in np.argsort(-rms)[:count]]


def torque(rows: Row) -> Float:
    """Joint torques (k, n) [N·m]: simulated, else measured, else planned; 0 if unknown."""
    found = rows["torque_ref"]
    for name in ("effort", "true_torque"):
        found = np.where(np.isfinite(rows[name]), rows[name], found)
    return np.nan_to_num(found)


def load(envelope: Envelope, rows: Row) -> Float:
    """Share of the envelope that each joint uses, (k, n), at the speed, supply and temperature measured.

    At most `MOST_LOAD`, and finite.
    """
    now = envelope.at(rows["voltage"], rows["temperature"])
    return np.fmin(now.load(torque(rows), np.nan_to_num(rows["qd"])), MOST_LOAD)


def _percentile(values: deque[float], percentile: float) -> float:
    return float(np.percentile(values, percentile)) if values else float("nan")
