"""`Curves`: figures of the last half minute, ten a second: tracking, load, balance, punctuality."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.robot import Robot
from flexmotion.streamer.page.health import load

Float = NDArray[np.float64]
Row = np.ndarray[Any, Any]

NAMES = ("time_s", "tracking_deg", "load", "margin_mm", "late_ms")
"""Values of a sample, in their order: time of the robot; RMS error of the joints; greatest share of its servo's
envelope that a joint uses; distance of the commanded zero-moment point from the edge of the soles, negative outside;
longest time from a period's begin to the end of its work."""
KEPT_S, _STEP_S = 30.0, 0.1


class Curves:
    """Samples of the last half minute.

    Attributes:
        samples: each in the order of `NAMES`, oldest first; None where a value is unknown.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._envelope = Envelope.of(robot)
        self._ticks = max(round(_STEP_S * robot.rate_hz), 1)
        self.samples: deque[list[float | None]] = deque(maxlen=round(KEPT_S / _STEP_S))
        self._rows: list[Row] = []

    def take(self, rows: Row) -> list[list[float | None]]:
        """Take rows (k,) in their order; returns the samples that are new."""
        self._rows += list(rows)
        new = []
        while len(self._rows) >= self._ticks:
            part, self._rows = self._rows[: self._ticks], self._rows[self._ticks :]
            new.append(self._sample(np.array(part)))
        self.samples.extend(new)
        return new

    def _sample(self, rows: Row) -> list[float | None]:
        error = rows["q"] - rows["q_ref"]
        known = error[np.isfinite(error)]
        tracking = float(np.degrees(np.sqrt(np.mean(known**2)))) if known.size else None
        late = rows["lateness_s"] + rows["work_s"]
        known = late[np.isfinite(late)]
        values = (
            float(rows["tick"][-1]) / self.robot.rate_hz,
            tracking,
            float(load(self._envelope, rows).max()),
            margin_mm(rows[-1], self.robot.sole_half_size),
            1e3 * float(known.max()) if known.size else None,
        )
        return [None if value is None else round(value, 3) for value in values]


def margin_mm(row: Row, half_sizes: Float) -> float | None:
    """Distance of the commanded zero-moment point from the edge of the soles on the floor [mm]; None without a plan.

    Args:
        half_sizes: of the left and the right sole, (2, 2) [m].
    """
    feet, zmp = row["foot_ref"], row["zmp_ref"] + np.nan_to_num(row["zmp_shift"])
    if not (np.isfinite(feet).all() and np.isfinite(zmp).all() and row["contact_ref"].any()):
        return None
    corners = np.concatenate([_corners(feet[side], half_sizes[side]) for side in (0, 1) if row["contact_ref"][side]])
    try:
        hull = ConvexHull(corners)
    except QhullError:
        return None
    return float(-1e3 * (hull.equations[:, :2] @ zmp + hull.equations[:, 2]).max())


def _corners(foot: Float, half: Float) -> Float:
    x, y, _, yaw = foot
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    ends = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
    return ends @ turn.T + [x, y]
