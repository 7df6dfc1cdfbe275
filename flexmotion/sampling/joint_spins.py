"""`JointSpins`: how the segments of a window turn with the features of their joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.heading_frame import yaw_matrix
from flexmotion.features.joint_groups import BALLS, HINGES, PELVIS_SIZE, ROTATION_SIZE, sign
from flexmotion.human.body import Body
from flexmotion.human.human_model import AXES, human_model
from flexmotion.sampling.window_pose import PELVIS, WindowPose, point_owners

Float = NDArray[np.float64]


class JointSpins:
    """How segments turn with the columns of their joints.

    With the first two columns a and b of a joint's rotation, orthonormal, and z the third, the joint turns by
    (b' z, -a' z, a' y) in the axes of the segment that it moves.

    Args:
        pose: of the window.

    Attributes:
        world: segment -> rotation in the axes of the window [rad] per unit of the joint's columns, (W, 3, 6) or of a
            hinge (W, 3, 1).
        kept: change of the columns of the block `rotations` that remain rotations, (W, 50, 50).
    """

    def __init__(self, pose: WindowPose) -> None:
        frames = len(pose.rotation)
        self.world: dict[int, Float] = {}
        self.kept = np.zeros((frames, ROTATION_SIZE, ROTATION_SIZE), np.float32)
        for segment, joint in joints_of(pose.body).items():
            turn = pose.rotation[:, segment]
            if joint.axis is not None:
                self.world[segment] = (turn @ np.array(joint.axis))[..., None]
                self.kept[:, joint.columns, joint.columns] = 1.0
                continue
            if segment == PELVIS:
                own = yaw_matrix(-pose.yaw) @ turn
            else:
                parent = int(human_model(pose.body).model.body_parentid[segment])
                own = pose.rotation[:, parent].swapaxes(-1, -2) @ turn
            y, z, none = own[..., 1], own[..., 2], np.zeros((frames, 3))
            local = np.stack(
                [np.concatenate([none, z], axis=1), np.concatenate([-z, none], axis=1),
                 np.concatenate([y, none], axis=1)], axis=1)  # fmt: skip
            self.world[segment] = turn @ local
            if segment == PELVIS:  # its rotation is without its heading
                about = own @ local
                about[:, 2] = 0.0
                local = own.swapaxes(-1, -2) @ about
            first = own[..., 1:2] * local[:, 2:] - own[..., 2:] * local[:, 1:2]
            second = own[..., 2:] * local[:, :1] - own[..., :1] * local[:, 2:]
            self.kept[:, joint.columns, joint.columns] = np.concatenate([first, second], axis=1)


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
