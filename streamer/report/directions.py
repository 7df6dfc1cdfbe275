"""Directions of upper arms, forearms and trunk: those of the human, and those that the robot made in a run.

Arms are seen in the frame of the torso, the trunk in the frame of the heading, as the retargeter sees them. Every tick
is compared, also where the robot cannot reach the human's hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.human.kinematics import HumanKinematics
from flexmotion.human.vectors import unit
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.spatial.heading import matrix_heading
from flexmotion.spatial.rotations import matrices

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Directions:
    """Unit vectors, one row a tick or a frame.

    Attributes:
        upper_arm, forearm: from shoulder to elbow and from elbow to hand, in the torso's frame, (T, 2, 3); left, right.
        trunk: the torso's upward axis in the frame of its heading, (T, 3).
    """

    upper_arm: Float
    forearm: Float
    trunk: Float

    @property
    def segments(self) -> Float:
        """Upper arm and forearm, (T, 2 sides, 2 segments, 3)."""
        return np.stack([self.upper_arm, self.forearm], axis=2)

    def at(self, times: Float, wanted: Float) -> Directions:
        """Linear interpolation from ascending times (T,) to wanted times (K,) [s], constant beyond the ends."""
        place = np.interp(wanted, times, np.arange(len(times)))
        low = np.minimum(place.astype(int), max(len(times) - 2, 0))
        high, share = np.minimum(low + 1, len(times) - 1), (place - low)[:, None]

        def between(vectors: Float) -> Float:
            ratio = share.reshape(len(share), *[1] * (vectors.ndim - 1))
            return unit((1.0 - ratio) * vectors[low] + ratio * vectors[high])

        return Directions(between(self.upper_arm), between(self.forearm), between(self.trunk))

    def __getitem__(self, rows: NDArray[np.int64]) -> Directions:
        """The given rows."""
        return Directions(self.upper_arm[rows], self.forearm[rows], self.trunk[rows])


def human_directions(kinematics: HumanKinematics) -> Directions:
    """Of every frame of a motion."""
    torso = kinematics.torso_rotation[:, None].swapaxes(-1, -2)
    upper = (torso @ (kinematics.elbow - kinematics.shoulder)[..., None])[..., 0]
    fore = (torso @ (kinematics.hand - kinematics.elbow)[..., None])[..., 0]
    return Directions(unit(upper), unit(fore), _upward(kinematics.torso_rotation))


def robot_directions(chain: ArmChain, q: Float, trunk: Float) -> Directions:
    """Of every tick.

    Args:
        q: joint angles, (T, n) [rad].
        trunk: see `Directions`, (T, 3).
    """
    poses = chain.poses(q[:, chain.joints])
    return Directions(poses.upper, poses.fore, trunk)


def standing_directions(robot: Robot, chain: ArmChain) -> Directions:
    """Of the robot in its stand pose, one row."""
    return robot_directions(chain, robot.stand_pose[None], np.array([[0.0, 0.0, 1.0]]))


def trunk_of(base: Float, tilt: Float) -> Float:
    """The torso's upward axis in the frame of its heading, (T, 3).

    Args:
        base: torso position and quaternion w x y z, (T, 7); NaN where unknown.
        tilt: estimated roll and pitch, (T, 2) [rad]: used where the torso's pose is unknown.
    """
    roll, pitched = tilt.T
    estimated = np.column_stack([np.sin(pitched) * np.cos(roll), -np.sin(roll), np.cos(pitched) * np.cos(roll)])
    known = np.isfinite(base).all(axis=1)
    estimated[known] = _upward(matrices(base[known, 3:]))
    return estimated


def angle(one: Float, other: Float) -> Float:
    """Angle between unit vectors (..., 3), (...) [rad]."""
    return np.arctan2(np.linalg.norm(np.cross(one, other), axis=-1), np.sum(one * other, axis=-1))


def pitch(trunk: Float) -> Float:
    """Forward lean of a trunk's direction, (T,) [rad]."""
    return np.arctan2(trunk[:, 0], trunk[:, 2])


def _upward(torso: Float) -> Float:
    """The upward axis of rotations (T, 3, 3) in the frame of their heading, (T, 3)."""
    yaw, up = matrix_heading(torso), torso[:, :, 2]
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.column_stack([cos * up[:, 0] + sin * up[:, 1], cos * up[:, 1] - sin * up[:, 0], up[:, 2]])
