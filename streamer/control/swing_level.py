"""`SwingLevel`: a leg that swings keeps its direction in the world, and its sole stays level, when the torso tilts.

A plan has the torso where it should be. Where a push tilts it, a swing leg that follows the plan tilts with it: a foot
ahead strikes the ground too soon and with its toes, one aside is still in the air when it should carry the robot. Here
the foot stays where the plan has it under its hip, which takes it to where the robot is falling to, as high over the
other sole as planned, and level. It gets no nearer to the other foot, and no further from it, than steps may.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.estimator import Estimator, roll_pitch
from flexmotion.streamer.control.reference import Reference

Float = NDArray[np.float64]

_DEAD = 0.065
"""Smaller tilts beyond the plan are ignored [rad]. Three clips of unpushed walks tilt by at most .068 rad in mid-swing
(99 %: .062), and for a moment by .11 when a foot strikes. With .03 a walk lost a tenth of its way."""
_SWAY = 0.025
"""A robot that tilts by more, and whose divergent component is this far from its plan, was pushed: all of its tilt is
made up for until the foot lands [m]. Less the band, a foot of a robot pushed inward struck the ground toes first."""
_MOST = 0.25
"""Most of it that is made up for [rad]."""
_LIFT = 0.03
"""Most by which the foot is lifted or lowered for it [m]."""
_MOST_JOINT = 0.6
"""Most that a joint leaves the plan [rad]."""
_SPEED = 3.0
"""Speed at which a joint leaves the plan at most [rad/s]; hips of brisk swings make as much."""
_FADE_S = 0.1
"""Time constant with which a leg comes back to its plan once it carries the robot [s]."""
_NOTHING = 1e-6


class SwingLevel:
    """Offsets for the joints of the leg that swings; allocates nothing that grows.

    Args:
        retargeter: knows how far the robot's feet may be from each other.
        enabled: whether it acts, as balance feedback does.

    Attributes:
        offset: to add to the reference of the joints, (n,) [rad]; speed: its rate, (n,) [rad/s].
    """

    def __init__(self, robot: Robot, retargeter: Retargeter, *, enabled: bool = True) -> None:
        self.enabled = enabled
        self.offset, self.speed = np.zeros(robot.n), np.zeros(robot.n)
        self._legs = [np.array(list(robot.chain(f"{side}_leg").values())) for side in ("left", "right")]
        body, capture = retargeter.body, retargeter.capture
        self._geometry = body.legs
        self._nearest, self._farthest = capture.nearest.tolist(), capture.farthest.tolist()
        self._rate = float(robot.rate_hz)
        self._step, self._keep = _SPEED / robot.rate_hz, math.exp(-1.0 / (_FADE_S * robot.rate_hz))
        self._acts = self._pushed = False
        self._before, self._origin = np.zeros(robot.n), np.zeros((1, 3))
        self._quaternion, self._planned, self._tilted = np.zeros(4), np.zeros(9), np.zeros(9)

    def reset(self) -> None:
        """Let the legs follow their plan at once."""
        if self._acts:
            self.offset[:] = self.speed[:] = 0.0
            self._acts = self._pushed = False

    def update(self, estimator: Estimator, reference: Reference, *, hung: bool = False) -> bool:
        """Fill `offset` and `speed` for the newest estimate.

        Args:
            reference: of this tick.
            hung: the feet are in the air: there is no tilt to speak of.

        Returns:
            Whether any joint has an offset.
        """
        swings = self.enabled and reference.balanced and estimator.has_imu and not (hung or reference.contacts.all())
        roll, pitch = self._tilt(estimator, reference) if swings else (0.0, 0.0)
        if swings and max(abs(roll), abs(pitch)) > _DEAD:
            ahead, left = (estimator.dcm - reference.dcm).tolist()
            self._pushed = self._pushed or math.hypot(ahead, left) > _SWAY
        self._pushed = swings and self._pushed
        if not self._pushed:
            roll, pitch = _beyond(roll), _beyond(pitch)
        if not self._acts and roll == 0.0 and pitch == 0.0:
            return False
        np.copyto(self._before, self.offset)
        for side, leg in enumerate(self._legs):
            if swings and not reference.contacts[side]:
                move = self._solve(side, roll, pitch, reference) - self.offset[leg]
                self.offset[leg] += np.minimum(np.maximum(move, -self._step), self._step)
            else:
                self.offset[leg] *= self._keep
        np.subtract(self.offset, self._before, out=self.speed)
        self.speed *= self._rate
        self._acts = True
        if np.abs(self.offset).max() <= _NOTHING:
            self.reset()
        return self._acts

    def _tilt(self, estimator: Estimator, reference: Reference) -> tuple[float, float]:
        """Roll and pitch of the torso beyond the plan [rad]."""
        roll, pitch = estimator.tilt.tolist()
        planned_roll, planned_pitch = roll_pitch(reference.base[3:])
        return roll - planned_roll, pitch - planned_pitch

    def _solve(self, side: int, roll: float, pitch: float, reference: Reference) -> Float:
        """Offsets of the leg in the air, hip to ankle, for a tilt beyond the plan, (6,) [rad]."""
        leg, feet = self._geometry[side], reference.feet
        yaw = 0.5 * float(feet[0, 3] + feet[1, 3])
        cos, sin = math.cos(yaw), math.sin(yaw)
        roll, pitch = min(max(roll, -_MOST), _MOST), min(max(pitch, -_MOST), _MOST)
        # Rotation of the torso as planned, and that of the tilt, about the axes ahead and left.
        mujoco.mju_quat2Mat(self._planned, reference.base[3:])
        planned = self._planned.reshape(3, 3)
        angle = math.hypot(roll, pitch)
        axis = np.array([cos * roll - sin * pitch, sin * roll + cos * pitch, 0.0]) / max(angle, 1e-9)
        mujoco.mju_axisAngle2Quat(self._quaternion, axis, angle)
        mujoco.mju_quat2Mat(self._tilted, self._quaternion)
        tilt = self._tilted.reshape(3, 3)
        # Seen from the torso's origin, in the world: the foot that tilts with the torso, and where it should be.
        foot, other = feet[side, :3] - reference.base[:3], feet[1 - side, :3] - reference.base[:3]
        hip = planned @ leg.hip
        rigid, wanted = tilt @ foot, foot + tilt @ hip - hip
        move = wanted - rigid
        away = 1.0 if side == 0 else -1.0
        x, y = (foot - other)[:2].tolist()
        ahead = self._within(0, cos * x + sin * y, cos * float(move[0]) + sin * float(move[1]))
        aside = away * self._within(1, away * (cos * y - sin * x), away * (cos * float(move[1]) - sin * float(move[0])))
        target = np.empty((1, 3))
        target[0, 0] = rigid[0] + cos * ahead - sin * aside
        target[0, 1] = rigid[1] + sin * ahead + cos * aside
        height = float((tilt @ other)[2] + foot[2] - other[2])
        target[0, 2] = min(max(height, float(wanted[2]) - _LIFT), float(wanted[2]) + _LIFT)
        cos, sin = math.cos(float(feet[side, 3])), math.sin(float(feet[side, 3]))
        level = np.array([[[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]])
        angles, _ = leg.solve(self._origin, (tilt @ planned)[None], target, level)
        found: Float = np.clip(angles[0] - reference.q[self._legs[side]], -_MOST_JOINT, _MOST_JOINT)
        return found

    def _within(self, axis: int, planned: float, move: float) -> float:
        """A move of the foot, bounded so that it stays as far from the other foot as steps may be."""
        low, high = min(self._nearest[axis], planned), max(self._farthest[axis], planned)
        return min(max(move, low - planned), high - planned)


def _beyond(value: float) -> float:
    return math.copysign(max(abs(value) - _DEAD, 0.0), value)
