"""Joint speed, acceleration and torque of a planned motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot_file import TORQUE_CUTOFF_HZ
from flexmotion.human.filters import butterworth, recursive
from flexmotion.retarget.dynamics import RobotDynamics
from flexmotion.retarget.schedule import Schedule
from flexmotion.retarget.state import RetargetState
from flexmotion.spatial.rotations import turns

Float = NDArray[np.float64]

_STRIDE, _QUIET_STRIDE = 2, 4
"""Torques are computed at every second row and interpolated, since the accelerations are low-passed below; at every
fourth where the robot comes to rest: an eighth fewer rows, and there within .05 N·m of every row. Of all rows .014 N·m
off in the root mean square of 168 plans, as with every second; .5 at most, where a foot touches down."""


class JointTorques:
    """Derivatives and inverse dynamics of plans of one robot.

    Args:
        rate_hz: rows a second.
    """

    def __init__(self, dynamics: RobotDynamics, rate_hz: float) -> None:
        self.dynamics, self.dt = dynamics, 1.0 / rate_hz
        self._feed, self._back = butterworth(TORQUE_CUTOFF_HZ, rate_hz)  # keeps the noise of differences out of torques
        # State of a filter whose input and output were 1 for ever.
        (_, b1, b2), (a1, a2) = self._feed, self._back
        self._settled = np.array([b1 + b2 - a1 - a2, b2 - a2])[:, None]

    def of(
        self, state: RetargetState, schedule: Schedule, base: Float, q: Float, quiet: int
    ) -> tuple[Float, Float, Float]:
        """Joint speed, acceleration and torque of each row.

        Args:
            state: holds the two rows before the first.
            schedule: feet and load over the rows.
            base: torso poses, (T, 7); q: (T, n) [rad].
            quiet: first row from which the robot only comes to rest.

        Returns:
            qd [rad/s], qdd [rad/s²] and torque [N·m], (T, n) each.
        """
        joints, torso = np.concatenate([state.q[::-1], q]), np.concatenate([state.base[::-1], base])
        places = np.hstack([joints, torso[:, :3]])
        moves = np.hstack([places[1:] - places[:-1], turns(torso[:, 3:])])
        speed, acceleration = self._rates(moves / self.dt)
        n = joints.shape[1]
        qd, qdd = speed[:, :n], acceleration[:, :n]
        rows = _computed(quiet, len(q))
        torque, _ = self.dynamics.inverse(
            base[rows],
            speed[rows, n:],
            acceleration[rows, n:],
            q[rows],
            qd[rows],
            qdd[rows],
            schedule.feet[rows],
            schedule.share[rows],
        )
        return qd, qdd, _between_rows(rows, torque, len(q))

    def _rates(self, between: Float) -> tuple[Float, Float]:
        """Speed and low-passed acceleration at rows, (T, C), from the mean speeds between them, (T + 1, C).

        Central differences; the last row keeps the speed before it.
        """
        after = np.concatenate([between[2:], between[-1:]])
        change = (between[1:] - between[:-1]) / self.dt
        acceleration = np.concatenate([change[1:], np.zeros((1, between.shape[1]))])
        smooth = recursive(self._feed, self._back, acceleration, self._settled * change[0])
        return 0.5 * (between[1:] + after), smooth


def _computed(quiet: int, count: int) -> NDArray[np.int64]:
    """Rows at which torques are computed, ascending, the first and the last of `count` among them."""
    busy = np.arange(0, min(quiet, count), _STRIDE)
    calm = np.arange(len(busy) * _STRIDE, count, _QUIET_STRIDE)
    rows = np.concatenate([busy, calm])
    return rows if rows[-1] == count - 1 else np.append(rows, count - 1)


def _between_rows(rows: NDArray[np.int64], values: Float, count: int) -> Float:
    """Linear interpolation of values at ascending rows from 0 on, (k, n), at every row, (count, n)."""
    every = np.arange(count)
    low = np.minimum(rows.searchsorted(every, side="right") - 1, len(rows) - 2)
    begin, width = rows.take(low), np.diff(rows).take(low)
    found: Float = values.take(low, axis=0)
    found += ((every - begin) / width)[:, None] * (values[1:] - values[:-1]).take(low, axis=0)
    return found
