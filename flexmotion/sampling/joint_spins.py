"""`JointSpins`: how the segments of a window turn with the features of their joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.heading_frame import yaw_matrix
from flexmotion.features.joint_groups import BALLS, HINGES, PELVIS_SIZE, ROTATION_SIZE, sign
from flexmotion.human.body import Body
from flexmotion.human.human_model import AXES, human_model
from flexmotion.sampling.window_pose import PELVIS, WindowPose, point_owners

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]


class JointSpins:
    """How segments turn with the columns of their joints.

    With the first two columns a and b of a joint's rotation, orthonormal, and z the third, the joint turns by
    (b' z, -a' z, a' y) in the axes of the segment that it moves.

    Args:
        pose: of the window.

    Attributes:
        world: segment -> rotation in the axes of the window [rad] per unit of the joint's columns, (W, 3, 6) or of a
            hinge (W, 3, 1).
    """

    def __init__(self, pose: WindowPose) -> None:
        joints = joints_of(pose.body)
        parent = human_model(pose.body).model.body_parentid
        self._balls = [segment for segment, joint in joints.items() if joint.axis is None]  # the pelvis first
        self._joints = joints
        turn = pose.rotation[:, self._balls]
        above = pose.rotation[:, parent[self._balls]]
        above[:, 0] = yaw_matrix(pose.yaw)  # the pelvis is decoded without its heading
        self._own = above.swapaxes(-1, -2) @ turn
        self._local = np.zeros((*turn.shape[:2], 3, 6))
        y, z = self._own[..., 1], self._own[..., 2]
        self._local[..., 0, 3:], self._local[..., 1, :3], self._local[..., 2, :3] = z, -z, y
        world = turn @ self._local
        self.world: dict[int, Float] = {segment: world[:, row] for row, segment in enumerate(self._balls)}
        for segment, joint in joints.items():
            if joint.axis is not None:
                self.world[segment] = (pose.rotation[:, segment] @ np.array(joint.axis))[..., None]

    @cached_property
    def kept(self) -> Float32:
        """Change of the columns of the block `rotations` by which they remain rotations, (W, 50, 50)."""
        own, local = self._own, self._local.copy()
        about = own[:, 0] @ local[:, 0]
        about[:, 2] = 0.0  # without its heading
        local[:, 0] = own[:, 0].swapaxes(-1, -2) @ about
        first = own[..., 1:2] * local[..., 2:, :] - own[..., 2:] * local[..., 1:2, :]
        second = own[..., 2:] * local[..., :1, :] - own[..., :1] * local[..., 2:, :]
        found = np.zeros((len(own), ROTATION_SIZE, ROTATION_SIZE), np.float32)
        changes = np.concatenate([first, second], axis=-2)
        for segment, joint in self._joints.items():
            row = self._balls.index(segment) if joint.axis is None else None
            found[:, joint.columns, joint.columns] = 1.0 if row is None else changes[:, row]
        return found


@dataclass(frozen=True)
class MovedBy:
    """Columns of a joint in the block `rotations`, and the axis of a hinge; None for a ball."""

    columns: slice
    axis: tuple[float, ...] | None = None


@lru_cache(maxsize=8)
def joints_of(body: Body) -> dict[int, MovedBy]:
    """Joint that moves a segment, by the segment's index among the bodies of the model; the pelvis' is the root."""
    model = human_model(body).model
    found = {PELVIS: MovedBy(slice(0, PELVIS_SIZE))}
    for number, ball in enumerate(BALLS):
        start = PELVIS_SIZE + 6 * number
        found[int(model.jnt_bodyid[model.joint(ball[0]).id])] = MovedBy(slice(start, start + 6))
    for number, hinge in enumerate(HINGES):
        column = PELVIS_SIZE + 6 * len(BALLS) + number
        axis = np.abs(AXES[hinge[:-2]]) * sign(hinge)
        found[int(model.jnt_bodyid[model.joint(hinge).id])] = MovedBy(slice(column, column + 1), tuple(axis))
    return found


@lru_cache(maxsize=8)
def chains(body: Body) -> tuple[tuple[tuple[int, slice], ...], ...]:
    """For each of `layout.POINTS`: segments between pelvis and point that a joint moves, and columns of the joint."""
    model, joints = human_model(body).model, joints_of(body)
    found = []
    for owner in point_owners(body):
        segments, segment = [], owner
        while segment > PELVIS:
            if segment in joints:
                segments.append((segment, joints[segment].columns))
            segment = int(model.body_parentid[segment])
        found.append(tuple(segments))
    return tuple(found)
