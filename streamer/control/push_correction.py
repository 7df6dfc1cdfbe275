"""`PushCorrection`: moves joints of a robot that is pushed, by gains that were learned for it.

Balance feedback is weak, as walks need it (`stabiliser.py`). A robot whose divergent component is further from its plan
than walks take it uses all of its sole, its hips and the leg in the air: while it stands on one foot, each joint leaves
its plan in proportion to what the error is beyond a dead band, outward of that foot, inward or ahead. The gains are
data of the robot (`configs/push_correction.py`); without them nothing is moved. The clamp of goals comes after it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.push_correction import DIRECTIONS
from flexmotion.configs.robot import Robot
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.reference import Reference

Float = NDArray[np.float64]

_SPEED = 3.0
"""Speed at which a joint leaves the plan at most [rad/s]."""
_FADE_S = 0.1
"""Time constant with which a joint comes back to its plan [s]."""
FALLS_M = 0.15
"""A divergent component further from its plan is no sway of a robot that stands on its feet: a wrong reading, or a
fall [m]."""
_ROOM = 0.15
"""An offset brings no joint nearer to its limits than this [rad]. A hip that carries a falling robot ran past its limit
with 3.8 rad/s, and its goal, which is bounded by the limit, implied 1.03 of the stall torque."""
_TICKS = 2
"""Ticks in a row that must show an error before it is answered: one reading alone may be wrong."""
_NOTHING = 1e-3
"""A smaller offset of all joints is none, and the next push has to begin anew [rad]."""


class PushCorrection:
    """Offsets for joints of a robot that is pushed; allocates nothing that grows.

    Args:
        enabled: whether it acts, as balance feedback does.

    Attributes:
        offset: to add to the reference of the joints, (n,) [rad]; speed: its rate, (n,) [rad/s].
        acts: whether any joint has an offset; falls: one has, and the error is that of a fall.
    """

    def __init__(self, robot: Robot, *, enabled: bool = True) -> None:
        self.correction = robot.push_correction if enabled else None
        self.offset, self.speed = np.zeros(robot.n), np.zeros(robot.n)
        self._rate = float(robot.rate_hz)
        self._lower, self._upper = robot.lower + _ROOM, robot.upper - _ROOM
        self._step, self._keep = _SPEED / robot.rate_hz, math.exp(-1.0 / (_FADE_S * robot.rate_hz))
        self.acts = self.falls = False
        self._seen = 0  # ticks in a row with an error to answer
        self._before, self._goal = np.zeros(robot.n), np.zeros(robot.n)
        self._errors = np.zeros(len(DIRECTIONS))

    def reset(self) -> None:
        """Let the joints follow their plan at once."""
        self._seen = 0
        if self.acts:
            self.offset[:] = self.speed[:] = 0.0
            self.acts = self.falls = False

    def update(self, estimator: Estimator, reference: Reference, *, hung: bool = False, measured: bool = True) -> bool:
        """Fill `offset` and `speed` for the newest estimate.

        Args:
            reference: of this tick.
            hung: the feet are in the air: there is no balance to speak of.
            measured: IMU and joints have just been measured, and are believed.

        Returns:
            Whether any joint has an offset.
        """
        correction = self.correction
        if correction is None:
            return False
        self.falls = False
        known = reference.balanced and estimator.has_imu and measured and not hung
        side = self._fill_errors(estimator, reference) if known else None
        self._seen = 0 if side is None else self._seen + 1
        if not self.acts and self._seen < _TICKS:
            return False
        goal, offset = self._goal, self.offset
        np.copyto(self._before, offset)
        # A joint goes out as fast as it may and comes back slowly: the error of a robot that sways back crosses zero.
        np.multiply(offset, self._keep, out=goal)
        if side is not None:
            wanted = correction.gains[side] @ self._errors
            further = (np.abs(wanted) >= np.abs(goal)) | (wanted * offset < 0.0)
            np.copyto(goal, wanted, where=further)
        # Also where the joint only comes back: its plan may have come near a limit meanwhile.
        q, most = reference.q, correction.most
        lowest, highest = np.clip(self._lower - q, -most, 0.0), np.clip(self._upper - q, 0.0, most)
        np.minimum(np.maximum(goal, lowest, out=goal), highest, out=goal)
        goal -= offset
        offset += np.minimum(np.maximum(goal, -self._step, out=goal), self._step, out=goal)
        np.subtract(offset, self._before, out=self.speed)
        self.speed *= self._rate
        self.acts = True
        self.falls = known and math.hypot(*(estimator.dcm - reference.dcm)) > FALLS_M
        if side is None and np.abs(offset).max() <= _NOTHING:
            self.reset()
        return self.acts

    def _fill_errors(self, estimator: Estimator, reference: Reference) -> int | None:
        """Fill the errors beyond the dead band, in the order of `DIRECTIONS`.

        Returns:
            The foot that the robot stands on; None: it stands on both, or no error is to be answered.
        """
        assert self.correction is not None
        correction, feet = self.correction, reference.feet
        dead, least = correction.dead, correction.dead if self.acts else correction.begins
        on_left, on_right = reference.contacts.tolist()
        if on_left == on_right:
            return None
        yaw = 0.5 * float(feet[0, 3] + feet[1, 3])
        cos, sin = math.cos(yaw), math.sin(yaw)
        x, y = (estimator.dcm - reference.dcm).tolist()
        ahead, left = cos * x + sin * y, cos * y - sin * x
        if not math.isfinite(ahead + left) or (ahead <= least[0] and abs(left) <= least[1]):
            return None
        side = 0 if on_left else 1
        outward, errors = left if on_left else -left, self._errors
        errors[0], errors[1], errors[2] = outward - dead[1], -outward - dead[1], ahead - dead[0]
        np.minimum(np.maximum(errors, 0.0, out=errors), correction.reach, out=errors)
        return side
