"""Closed-form inverse kinematics of a six-axis leg: hip yaw, roll, pitch, knee, ankle pitch, ankle roll.

After Kajita et al., *Introduction to Humanoid Robotics* (2014), section 2.5.2: where the three hip axes meet in one
point and the two ankle axes in another, knee and ankle follow from the triangle hip-knee-ankle, and the hip from the
remaining rotation. Compiled, over any number of rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import ANY, FLOATS, compiled, fields, packed
from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot
from flexmotion.retarget.leg_check import check_height, check_order, check_poses

Float = NDArray[np.float64]

CHAIN = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
_AXES = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0], [1, 0, 0]], dtype=float)
SIDE_NAMES = ("left", "right")
_OFFSET_TOLERANCE = 1e-3
"""Largest distance between axes that should intersect [m]: the error at the foot is of that size."""
_REACH = 0.9985
"""Share of the leg's full length that is used: near 1 the knee's speed is unbounded."""
_LEAST_REACH = 1e-3
"""Least distance from hip to ankle, beyond the difference of thigh and shank [m]."""


@dataclass(frozen=True)
class Leg:
    """Geometry of one leg, read from the robot's model in its zero pose.

    Attributes:
        indices: columns of the six joints in the robot's order, (6,).
        signs: +1 or -1 for each joint: direction of the model's axis along the canonical one (z, x, y, y, y, x).
        hip: centre of the hip axes in the torso frame, (3,) [m].
        thigh, shank: lengths [m].
        sole: centre of the sole in the frame of the ankle centre, (3,) [m].
    """

    indices: NDArray[np.int64]
    signs: Float
    hip: Float
    thigh: float
    shank: float
    sole: Float

    @classmethod
    def of(cls, robot: Robot, side: str) -> Leg:
        """Read the leg of `side` ("left" or "right").

        Raises:
            RetargetError: the joints between torso and foot are not the six of the mapping in its order, their axes are
                not yaw-roll-pitch-pitch-pitch-roll or miss their intersection by over 1 mm, the knee bends backward, or
                poses of the sole are not reached again by the angles found for them; or the leg is shorter than the
                robot file's standing height.
        """
        chain = robot.chain(f"{side}_leg")
        indices = np.array([chain[part] for part in CHAIN])
        names = [robot.joint_names[i] for i in indices]
        model = robot.model
        foot = SIDE_NAMES.index(side)
        body = robot.foot_ids[foot]
        check_order(robot, side, names, body)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        torso = robot.torso_id
        to_torso = data.xmat[torso].reshape(3, 3).T
        joints = [model.joint(name).id for name in names]
        axes = data.xaxis[joints] @ to_torso.T
        anchors = (data.xanchor[joints] - data.xpos[torso]) @ to_torso.T
        signs = np.sum(axes * _AXES, axis=1)
        if np.any(np.abs(np.abs(signs) - 1.0) > 1e-6):
            worst = names[int(np.argmin(np.abs(signs)))]
            raise RetargetError(
                f"{robot.file}: joint {worst!r} of the {side} leg does not turn about the axis of a "
                "yaw-roll-pitch-knee-pitch-roll leg in the model's zero pose; this retargeter needs such legs"
            )
        yaw, roll, pitch, knee, ankle_pitch, ankle_roll = anchors
        hip = np.array([yaw[0], yaw[1], roll[2]])
        ankle = np.array([ankle_pitch[0], ankle_roll[1], ankle_roll[2]])
        misses = {
            "hip_roll": roll[1] - hip[1],
            "hip_pitch (fore-aft)": pitch[0] - hip[0],
            "hip_pitch (height)": pitch[2] - hip[2],
            "knee": knee[0] - hip[0],
            "ankle_pitch (fore-aft)": ankle_pitch[0] - hip[0],
            "ankle_pitch (height)": ankle_pitch[2] - ankle[2],
            "ankle_roll": ankle[1] - hip[1],
        }
        for joint, miss in misses.items():
            if abs(miss) > _OFFSET_TOLERANCE:
                raise RetargetError(
                    f"{robot.file}: {side} {joint} misses the leg's common axis by {1e3 * miss:.1f} mm; "
                    "the closed-form leg allows 1 mm"
                )
        sole = (data.xpos[body] + data.xmat[body].reshape(3, 3) @ robot.soles[foot] - data.xpos[torso]) @ to_torso.T
        leg = cls(
            indices=indices,
            signs=np.sign(signs),
            hip=hip,
            thigh=float(hip[2] - knee[2]),
            shank=float(knee[2] - ankle[2]),
            sole=sole - ankle,
        )
        check_height(robot, side, leg.length)
        check_poses(robot, side, leg.indices, leg.signs, leg.knee_range, leg.solve)
        return leg

    @property
    def length(self) -> float:
        """Longest hip-to-ankle distance that is used [m]."""
        return _REACH * (self.thigh + self.shank)

    @property
    def knee_range(self) -> tuple[float, float]:
        """Least and greatest knee angle that `solve` gives, positive where the shank turns back [rad]."""
        return self._knee(self.length), self._knee(abs(self.thigh - self.shank) + _LEAST_REACH)

    def _knee(self, reach: float) -> float:
        """Knee angle at a distance from hip to ankle [m]: law of cosines [rad]."""
        cosine = (reach**2 - self.thigh**2 - self.shank**2) / (2 * self.thigh * self.shank)
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def solve(
        self, torso_position: Float, torso_rotation: Float, sole_position: Float, sole_rotation: Float
    ) -> tuple[Float, Float]:
        """Joint angles for a pose of the sole.

        Args:
            torso_position: (T, 3) [m]; torso_rotation: (T, 3, 3), both in the world.
            sole_position: centre of the sole, (T, 3) [m]; sole_rotation: (T, 3, 3).

        Returns:
            Angles with the model's signs, (T, 6) [rad], and the missing length of the leg, (T,) [m]. It is 0 where the
            target is within reach; else the ankle is on the line from the hip to its target.
        """
        angles, missing = self._alone.solve(torso_position, torso_rotation, sole_position[None], sole_rotation[None])
        return angles[0], missing[0]

    @cached_property
    def _alone(self) -> Legs:
        return Legs((self,))


class Legs:
    """Several legs of a robot, solved at once.

    Attributes:
        indices: columns of their joints in the robot's order, (S, 6).
    """

    def __init__(self, legs: Sequence[Leg]) -> None:
        self.indices = np.stack([leg.indices for leg in legs])
        self._geometry = packed(
            _Geometry, **{name: np.array([getattr(leg, name) for leg in legs]) for name in _Geometry._fields}
        )

    def solve(
        self, torso_position: Float, torso_rotation: Float, sole_position: Float, sole_rotation: Float
    ) -> tuple[Float, Float]:
        """Joint angles for poses of the soles; arguments of `Leg.solve`.

        Args:
            sole_position: centres of the soles, (S, T, 3) [m]; sole_rotation: (S, T, 3, 3).

        Returns:
            As `Leg.solve`, (S, T, 6) [rad] and (S, T) [m].
        """
        number, rows = len(self.indices), len(torso_position)
        if torso_rotation.shape != (rows, 3, 3) or sole_rotation.shape != (number, rows, 3, 3):
            raise ValueError(
                f"{rows} rows of {number} legs, found rotations {torso_rotation.shape}, {sole_rotation.shape}"
            )
        if sole_position.shape != (number, rows, 3):
            raise ValueError(f"{rows} rows of {number} legs, found soles {sole_position.shape}")
        return _solve(self._geometry, torso_position, torso_rotation, sole_position, sole_rotation)


class _Geometry(NamedTuple):
    """Geometry of several legs, as of `Leg`, (S, ...)."""

    signs: Float
    hip: Float
    sole: Float
    thigh: Float
    shank: Float
    length: Float


@compiled(fields(_Geometry, *[FLOATS[2]] * 3, *[FLOATS[1]] * 3), ANY[2], ANY[3], ANY[3], ANY[4])
def _solve(
    legs: _Geometry, torso_position: Float, torso_rotation: Float, sole_position: Float, sole_rotation: Float
) -> tuple[Float, Float]:
    """`Legs.solve`."""
    number, rows = len(legs.thigh), len(torso_position)
    angles, missing = np.empty((number, rows, 6)), np.empty((number, rows))
    away, middle = np.empty(3), np.empty(3)
    for leg in range(number):
        thigh, shank = legs.thigh[leg], legs.shank[leg]
        least = abs(thigh - shank) + _LEAST_REACH
        for t in range(rows):
            torso, sole = torso_rotation[t], sole_rotation[leg, t]
            for i in range(3):
                away[i] = torso_position[t, i] - sole_position[leg, t, i]
                for j in range(3):
                    away[i] += torso[i, j] * legs.hip[leg, j]
            ahead, aside, below = legs.sole[leg, 0], legs.sole[leg, 1], legs.sole[leg, 2]
            for j in range(3):
                ahead += sole[j, 0] * away[j]
                aside += sole[j, 1] * away[j]
                below += sole[j, 2] * away[j]
            across = aside * aside + below * below
            distance = math.sqrt(ahead * ahead + across)
            reach = min(max(distance, least), legs.length[leg])
            cosine = (reach * reach - thigh * thigh - shank * shank) / (2.0 * thigh * shank)
            knee = math.acos(min(max(cosine, -1.0), 1.0))
            roll = math.atan2(aside, below)
            pitch = math.atan2(-ahead, math.sqrt(across))
            pitch -= math.atan2(thigh * math.sin(knee), shank + thigh * math.cos(knee))
            # The hip's rotation is torso.T @ sole @ Rx(-roll) @ Ry(-pitch - knee); only parts of it are needed.
            cos, sin = math.cos(roll), math.sin(roll)
            middle[:] = 0.0
            first, last = 0.0, 0.0
            for j in range(3):
                turned = cos * sole[j, 1] - sin * sole[j, 2]
                for i in range(3):
                    middle[i] += torso[j, i] * turned
                first += torso[j, 2] * sole[j, 0]
                last += torso[j, 2] * (sin * sole[j, 1] + cos * sole[j, 2])
            cos, sin = math.cos(pitch + knee), math.sin(pitch + knee)
            found = angles[leg, t]
            found[0] = math.atan2(-middle[0], middle[1])
            found[1] = math.asin(min(max(middle[2], -1.0), 1.0))
            found[2] = math.atan2(-cos * first - sin * last, cos * last - sin * first)
            found[3], found[4], found[5] = knee, pitch, roll
            for joint in range(6):
                found[joint] *= legs.signs[leg, joint]
            missing[leg, t] = abs(distance - reach)
    return angles, missing
