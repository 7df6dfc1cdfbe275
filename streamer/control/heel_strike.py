"""`HeelStrike`: a foot that is set down ahead of the other one lands heel first, corrected from step to step.

Servos lag and legs sag under load, so that a sole that is planned level is not level when it strikes: by how much
differs from robot to robot. Toes that strike early make the foot bounce, and tip the robot over the outer edge of the
other foot; it then turns on a corner of each sole, which is how feet that carry it slip. How the soles were to each
other shortly before a step landed corrects the next step of that foot.

The middle of the sole is raised, so that the heel comes down as the plan has a level sole. A lower heel strikes before
the plan shifts the weight, and then the foot bounces too.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.reference import Reference

Float = NDArray[np.float64]

TOES_UP = math.radians(2.0)
"""Wanted pitch of a sole that is about to land ahead, against the other one [rad]."""
_SHARE = 0.5
"""Share of what was missing in a step by which the next one is corrected."""
_MOST = 0.06
"""Most that a sole leaves its plan [rad]."""
_MOST_JOINT = 0.15
"""Most that a joint leaves its plan for it [rad]."""
_LOOKED_AT = 0.0015
"""Planned height of the sole over the other one below which it is looked at, on its way down [m]: most soles have not
struck yet."""
_SPEED = 2.5
"""Speed at which a joint leaves the plan at most [rad/s]."""
_FADE_S = 0.05
"""Time constant with which a leg comes back to its plan once the foot is to carry the robot [s]."""
_STRAIGHT = 0.1
"""Sine of the bend of a knee below which its leg is nearly straight."""
_NOTHING = 1e-5


class HeelStrike:
    """Offsets for the joints of a leg that is set down; allocates nothing that grows.

    Args:
        retargeter: of the robot; knows its legs.
        enabled: whether it acts, as balance feedback does.

    Attributes:
        offset: to add to the reference of the joints, (n,) [rad]; speed: its rate, (n,) [rad/s].
        toes_up: of each foot in its next step ahead, against its plan, (2,) [rad].
    """

    def __init__(self, robot: Robot, retargeter: Retargeter, *, enabled: bool = True) -> None:
        self.enabled = enabled
        self.offset, self.speed = np.zeros(robot.n), np.zeros(robot.n)
        self.toes_up = np.zeros(2)
        self._geometry = retargeter.body.legs
        self._feet, self._half_length = robot.foot_ids, robot.sole_half_size[:, 0].tolist()
        self._rise = [length * math.sin(TOES_UP) for length in self._half_length]
        self._rate, self._step = float(robot.rate_hz), _SPEED / robot.rate_hz
        self._keep = math.exp(-1.0 / (_FADE_S * robot.rate_hz))
        self._acts, self._looks = False, [False, False]
        self._taken = [0.0, 0.0]  # corrections of the steps that are made now
        # How far each foot was ahead of the other when it lifted [m]; one that is first seen in the air goes ahead.
        self._lifted = [-math.inf, -math.inf]
        self._before = np.zeros(robot.n)

    def reset(self) -> None:
        """Let the legs follow their plan at once; what was learnt of the robot is kept."""
        self._looks, self._lifted = [False, False], [-math.inf, -math.inf]
        if self._acts:
            self.offset[:] = self.speed[:] = 0.0
            self._acts = False

    def update(self, estimator: Estimator, reference: Reference, *, measured: bool, hung: bool = False) -> None:
        """Fill `offset` and `speed`.

        Args:
            reference: of this tick.
            measured: the joints have just been measured, and nothing else moves the legs beside their plan.
            hung: the feet are in the air.
        """
        swings = self.enabled and reference.balanced and not hung and bool(reference.contacts.any())
        ahead = [self._ahead(side, reference) if swings else 0.0 for side in range(2)]
        for side in range(2):
            if ahead[side] == 0.0:
                self._looks[side], self._taken[side] = False, float(self.toes_up[side])
        if not self._acts and not any(ahead):
            return
        np.copyto(self._before, self.offset)
        for side, leg in enumerate(self._geometry):
            if ahead[side] == 1.0 and measured:
                self._look(side, estimator, reference)
            own = self.offset[leg.indices]
            wanted = self._keep * own
            if ahead[side]:
                pitch, rise = ahead[side] * self._taken[side], ahead[side] * self._rise[side]
                wanted = self._raised(side, pitch, rise, reference.q)
            move = wanted - own
            self.offset[leg.indices] += np.minimum(np.maximum(move, -self._step), self._step)
        np.subtract(self.offset, self._before, out=self.speed)
        self.speed *= self._rate
        self._acts = True
        if not any(ahead) and np.abs(self.offset).max() <= _NOTHING:
            self.reset()

    def _raised(self, side: int, toes_up: float, rise: float, q: Float) -> Float:
        """Offsets of a leg that pitch its sole about its centre and raise it, hip to ankle, (6,) [rad]; to first order.

        The pitch joints of hip, knee and ankle move it. The ankle, which is above and behind the sole's centre, moves
        back. Sideways angles of hip and ankle are small, and left out. A leg that is nearly straight cannot move its
        ankle so: it turns the sole by the ankle alone.

        Args:
            toes_up: [rad].
            rise: of the sole's centre [m].
            q: planned joint angles, (n,) [rad].
        """
        leg = self._geometry[side]
        hip, knee, ankle = (leg.signs * q[leg.indices])[2:5].tolist()
        thigh = _turned(0.0, -leg.thigh, hip)
        shank = _turned(0.0, -leg.shank, hip + knee)
        sole_x, sole_z = _turned(float(leg.sole[0]), float(leg.sole[2]), hip + knee + ankle)
        leg_x, leg_z = thigh[0] + shank[0], thigh[1] + shank[1]
        # A turn by d about the axis to the left moves a point at (x, z) by d (z, -x).
        determinant = shank[0] * leg_z - leg_x * shank[1]  # thigh times shank times the sine of the knee's bend
        if abs(determinant) < _STRAIGHT * leg.thigh * leg.shank:
            return leg.signs * [0.0, 0.0, 0.0, 0.0, -toes_up, 0.0]
        along, up = toes_up * sole_z, rise - toes_up * sole_x  # ways of the ankle
        by_hip = (along * shank[0] + up * shank[1]) / determinant
        by_knee = -(along * leg_x + up * leg_z) / determinant
        found = leg.signs * [0.0, 0.0, by_hip, by_knee, -toes_up - by_hip - by_knee, 0.0]
        return np.minimum(np.maximum(found, -_MOST_JOINT, out=found), _MOST_JOINT, out=found)

    def _ahead(self, side: int, reference: Reference) -> float:
        """How far a foot in the air that goes ahead is ahead of the other one, over half of its length, in [0, 1]."""
        if reference.contacts[side]:
            self._lifted[side] = math.nan
            return 0.0
        (x, y, _, yaw), (other_x, other_y, _, _) = reference.feet[side].tolist(), reference.feet[1 - side].tolist()
        way = math.cos(yaw) * (x - other_x) + math.sin(yaw) * (y - other_y)
        if math.isnan(self._lifted[side]):
            self._lifted[side] = way
        return min(max(way / self._half_length[side], 0.0), 1.0) if way > self._lifted[side] else 0.0

    def _look(self, side: int, estimator: Estimator, reference: Reference) -> None:
        """Correct the next step by how the soles are to each other, once in a step, shortly before it lands."""
        height = float(reference.feet[side, 2] - reference.feet[1 - side, 2])
        if height >= _LOOKED_AT:
            self._looks[side] = True
        elif self._looks[side]:
            self._looks[side] = False
            missing = TOES_UP + pitch_between(estimator, self._feet[1 - side], self._feet[side])
            self.toes_up[side] = min(max(float(self.toes_up[side]) + _SHARE * missing, -_MOST), _MOST)


def _turned(x: float, z: float, angle: float) -> tuple[float, float]:
    """A point turned about the axis to the left [m, rad]."""
    cos, sin = math.cos(angle), math.sin(angle)
    return x * cos + z * sin, z * cos - x * sin


def pitch_between(estimator: Estimator, stands: int, swings: int) -> float:
    """Pitch of a foot against another one about its own axis to the left, positive toes down [rad]; by body number."""
    data = estimator.data
    up = data.xmat[stands].reshape(3, 3)[:, 2]
    ahead = data.xmat[swings].reshape(3, 3)[:, 0]
    return -math.asin(min(max(float(up @ ahead), -1.0), 1.0))
