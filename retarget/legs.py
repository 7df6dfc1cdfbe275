"""Closed-form inverse kinematics of a six-axis leg: hip yaw, roll, pitch, knee, ankle pitch, ankle roll.

After Kajita et al., *Introduction to Humanoid Robotics* (2014), section 2.5.2: where the three hip axes meet in one
point and the two ankle axes in another, knee and ankle follow from the triangle hip-knee-ankle, and the hip from the
remaining rotation. Vectorised over any number of rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

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
        self._signs = np.stack([leg.signs for leg in legs])[:, None]
        # Coordinates first, then legs, then one row.
        self._hip, self._sole = (
            np.stack([getattr(leg, name) for leg in legs], axis=1)[..., None] for name in ("hip", "sole")
        )
        self._thigh, self._shank, self._length = (
            np.array([[getattr(leg, name)] for leg in legs]) for name in ("thigh", "shank", "length")
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
        # Coordinates first in memory: numpy is fastest along a long last axis. Matrices are (row, column, S, T).
        torso = np.ascontiguousarray(torso_rotation.transpose(1, 2, 0))[:, :, None]
        sole = np.ascontiguousarray(sole_rotation.transpose(2, 3, 0, 1))
        hip = torso_position.T[:, None] + (torso * self._hip).sum(axis=1)
        ahead, aside, below = self._sole + (sole * (hip - sole_position.transpose(2, 0, 1))[:, None]).sum(axis=0)
        across = aside * aside + below * below
        distance = np.sqrt(ahead * ahead + across)
        thigh, shank = self._thigh, self._shank
        reach = np.minimum(np.maximum(distance, np.abs(thigh - shank) + _LEAST_REACH), self._length)
        cosine = (reach * reach - thigh**2 - shank**2) / (2 * thigh * shank)
        knee = np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0))
        ankle_roll = np.arctan2(aside, below)
        lean = np.arctan2(-ahead, np.sqrt(across))
        ankle_pitch = lean - np.arctan2(thigh * np.sin(knee), shank + thigh * np.cos(knee))
        # The hip's rotation is torso.T @ sole @ Rx(-ankle_roll) @ Ry(-ankle_pitch - knee); only parts of it are needed.
        cos, sin = np.cos(ankle_roll), np.sin(ankle_roll)
        left, top, up = sole[:, 1], sole[:, 2], torso[:, 2]
        middle = (torso * (cos * left - sin * top)[:, None]).sum(axis=0)
        first = (up * sole[:, 0]).sum(axis=0)
        last = (up * (sin * left + cos * top)).sum(axis=0)
        bend = ankle_pitch + knee
        cos, sin = np.cos(bend), np.sin(bend)
        angles = np.empty((*reach.shape, len(CHAIN)))
        angles[..., 0] = np.arctan2(-middle[0], middle[1])
        angles[..., 1] = np.arcsin(np.minimum(np.maximum(middle[2], -1.0), 1.0))
        angles[..., 2] = np.arctan2(-cos * first - sin * last, cos * last - sin * first)
        angles[..., 3], angles[..., 4], angles[..., 5] = knee, ankle_pitch, ankle_roll
        angles *= self._signs
        return angles, np.abs(distance - reach)
