"""`RobotRecord`: what a robot was told and what it measured, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

LEAST_STRETCH_S = 2.0
"""Shorter stretches without a gap are left out [s]."""


@dataclass(frozen=True)
class RobotRecord:
    """N ticks of a robot whose torque is on. Joints are in robot order; times are on one clock.

    Attributes:
        time, goal_time: of the measurements of a tick, and of sending its goals, (N,) [s].
        goal, position: goals sent and angles measured, (N, n) [rad].
        effort: torque by motor current, (N, n) [N·m]; NaN where unknown.
        voltage: supply, (N, n) [V]; NaN where unknown.
        fresh: joints that were measured in this tick, (N, n).
        accel, gyro: specific force [m/s²] and angular velocity [rad/s] in the torso frame, (N, 3); NaN: unknown.
        bus_s: time from sending a goal to its arrival at a servo, minus the age of a measurement [s].
        motion: what moved, for the file.
    """

    time: Float
    goal_time: Float
    goal: Float
    position: Float
    effort: Float
    voltage: Float
    fresh: Bool
    accel: Float
    gyro: Float
    bus_s: float
    motion: str

    def __len__(self) -> int:
        return len(self.time)

    def part(self, rows: slice | NDArray[np.int64] | Bool) -> RobotRecord:
        """Some of the ticks."""
        return RobotRecord(
            **{name: getattr(self, name)[rows] for name in _PER_TICK}, bus_s=self.bus_s, motion=self.motion
        )

    def stretches(self, period_s: float) -> list[slice]:
        """Ticks without a gap of more than two periods, each at least `LEAST_STRETCH_S` long."""
        ends = np.flatnonzero(np.diff(self.time) > 2.5 * period_s) + 1
        edges = [0, *ends.tolist(), len(self)]
        found = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        return [each for each in found if (each.stop - each.start) * period_s >= LEAST_STRETCH_S]

    def believed(self, joint: int) -> Bool:
        """Ticks in which a joint was measured and its angle is a number, (N,)."""
        return self.fresh[:, joint] & np.isfinite(self.position[:, joint])

    def specific_force(self) -> Float:
        """`accel`; where it is not known that of a torso that stands upright and still, (N, 3) [m/s²]."""
        return np.where(np.isfinite(self.accel), self.accel, np.array([0.0, 0.0, GRAVITY]))


def new_angles(position: Float, answered: Bool, turns: int) -> Bool:
    """Ticks in which a joint was measured, (N, n), for the angles of all ticks.

    Servos that are read in turns (`Driver.turns`) keep their last angle in between: only a change is certainly new.
    """
    fresh = answered & np.isfinite(position)
    if turns > 1:
        fresh[1:] &= position[1:] != position[:-1]
    return fresh


_PER_TICK = ("time", "goal_time", "goal", "position", "effort", "voltage", "fresh", "accel", "gyro")
