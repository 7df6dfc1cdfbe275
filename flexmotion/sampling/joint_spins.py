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
from flexmotion.sampling.window_pose import PELVIS, WindowPose

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]


class JointSpins:
    """How segments turn with the columns of their joints, and about which places.

    With the first two columns a and b of a joint's rotation, orthonormal, and z the third, the joint turns by
    (b' z, -a' z, a' y) in the axes of the segment that it moves.

    Args:
        pose: of the window.

    Attributes:
        world: rotation in the axes of the window [rad] per unit of each column of the block `rotations`, (W, 3, 50).
        place: of the joint of each column, (W, 3, 50) [m].
    """

    def __init__(self, pose: WindowPose) -> None:
        joints, frames = joints_of(pose.body), len(pose.yaw)
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
        balls = (turn @ self._local).swapaxes(1, 2).reshape(frames, 3, -1)
        hinges, axes = _hinges(pose.body)
        turns = np.einsum("tsij,sj->tis", pose.rotation[:, hinges], axes)
        # Single precision, as the derivatives that they are multiplied by.
        self.world: Float32 = np.concatenate([balls, turns], axis=-1, dtype=np.float32)
        self.place: Float32 = pose.position.swapaxes(1, 2).astype(np.float32)[..., column_segments(pose.body)]

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
def _hinges(body: Body) -> tuple[list[int], Float]:
    """Segments that hinges move, and the hinges' axes in them, (8, 3); in the order of `joint_groups.HINGES`."""
    axes = {segment: joint.axis for segment, joint in joints_of(body).items() if joint.axis is not None}
    return list(axes), np.array(list(axes.values()))


@lru_cache(maxsize=8)
def column_segments(body: Body) -> NDArray[np.intp]:
    """Segment that the joint of a column moves, (50,)."""
    found = np.zeros(ROTATION_SIZE, np.intp)
    for segment, joint in joints_of(body).items():
        found[joint.columns] = segment
    return found


@lru_cache(maxsize=8)
def carrying(body: Body) -> NDArray[np.bool_]:
    """Whether the joint of a column moves a segment, itself or one that carries it, (B, 50)."""
    parents, own = human_model(body).model.body_parentid, column_segments(body)
    found = np.zeros((len(parents), ROTATION_SIZE), np.bool_)
    for segment in range(PELVIS, len(parents)):
        found[segment] = found[parents[segment]] | (own == segment)
    return found
