"""`Tangent`: how path, rotations and points of a window change with its latent, to first order.

The motion that a decoder makes is nearly linear in its latent: Jacobians of different windows differ by 3 % in the
features of motion (and by 70 % and more in those of forces, which are therefore not here). One Jacobian of these
features is enough; forward kinematics, in which the curvature lies, are differentiated in closed form at the motion as
it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.constraint_layout import PATH, PLACES, ROTATIONS, ConstraintLayout
from flexmotion.features.heading_frame import yaw_matrix
from flexmotion.features.inertialise import inertialised
from flexmotion.features.joint_groups import BALLS, HINGES, PELVIS_SIZE, ROTATION_SIZE, sign
from flexmotion.features.layout import Layout
from flexmotion.human.body import Body
from flexmotion.human.human_model import AXES, human_model
from flexmotion.sampling.low_pass import steadied
from flexmotion.sampling.planted import Holding
from flexmotion.sampling.window_pose import FEET, PELVIS, WindowPose, point_owners

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Indices = NDArray[np.intp]

LINEAR = (PATH, ROTATIONS, PLACES)
"""Blocks of constraints that a tangent knows."""

DIFFERENCE = 0.5
"""Change of a number of the latent, which has unit variance, by which a decoder is differentiated."""


@dataclass(frozen=True)
class Tangent:
    """Derivatives of a window's features by its latent of L numbers, not normalised.

    Attributes:
        made: of the block `root` as decoded, before the window is joined to its history, (W, 4, L).
        root: of the block `root`, (W, 4, L).
        rotations: of the block `rotations`, (W, 50, L).
        fps: frames per second.
    """

    made: Float32
    root: Float32
    rotations: Float32
    fps: float

    @classmethod
    def of(cls, jacobian: NDArray[np.float32], history: int, layout: Layout) -> Tangent:
        """Of the window as it leaves the sampler: joined to its history, and low-passed.

        Both are linear in the window, so that its changes are joined to a history without any change.

        Args:
            jacobian: of the decoder's features, not normalised, (W, F, L); of the blocks `root` and `rotations` at
                least.
            history: frames that are known before a window.
            layout: of the features.
        """
        still = np.zeros((history, layout.size), np.float32)
        columns = [steadied(inertialised(one, still, layout), still, layout) for one in np.moveaxis(jacobian, -1, 0)]
        whole = np.stack(columns, axis=-1).astype(np.float32)
        root, rotations = layout.blocks["root"], layout.blocks["rotations"]
        parts = (jacobian[:, root], whole[:, root], whole[:, rotations])
        made, joined, turned = (np.ascontiguousarray(part, np.float32) for part in parts)
        return cls(made, joined, turned, layout.fps)

    @property
    def size(self) -> int:
        """Numbers of the latent, L."""
        return self.root.shape[-1]

    def travel(self, change: Float32, layout: Layout) -> Float32:
        """Change of the features of a window before it is joined to its history: of the block `root` alone, (W, F)."""
        found = np.zeros((len(self.root), layout.size), np.float32)
        found[:, layout.blocks["root"]] = self.made @ change
        return found

    def features(self, change: Float32, layout: Layout) -> Float32:
        """Change of a window's features for a change of its latent, (L,) -> (W, layout.size); forces do not change."""
        found = np.zeros((len(self.root), layout.size), np.float32)
        found[:, layout.blocks["root"]] = self.root @ change
        found[:, layout.blocks["rotations"]] = self.rotations @ change
        return found

    def jacobian(
        self,
        pose: WindowPose,
        holding: Holding | None,
        layout: ConstraintLayout,
        frames: Indices,
        columns: Indices,
    ) -> Float32:
        """Derivatives of R values of a planted window by its latent, (R, L).

        Args:
            pose: the window as it is.
            holding: how its feet were held in place, in the frame of the window; None where they were not.
            layout: of the constraints.
            frames, columns: of the values, (R,) each; columns of the blocks `LINEAR`.
        """
        found = np.zeros((len(frames), self.root.shape[-1]), np.float32)
        spins = _Spins(pose)
        path = self._path(pose, spins, holding)
        for name in LINEAR:
            cut = layout.blocks[name]
            own = np.flatnonzero((columns >= cut.start) & (columns < cut.stop))
            if not len(own):
                continue
            frame, column = frames[own], columns[own] - cut.start
            if name == PATH:
                found[own] = path[frame, column]
            elif name == ROTATIONS:
                found[own] = (spins.kept[frame, column][:, None] @ self.rotations[frame])[:, 0]
            else:
                points, number = np.unique(column // 3, return_inverse=True)
                moved = self._points(pose, spins, points)
                moved += path[:, None, :3]
                found[own] = moved[frame, number, column % 3]
        return found

    def _path(self, pose: WindowPose, spins: _Spins, holding: Holding | None) -> Float32:
        """Derivatives of place and height [leg] and heading [rad] of the pelvis, (W, 4, L)."""
        leg = pose.body.leg
        yaw = np.cumsum(self.root[:, 2], axis=0) / self.fps
        before = np.concatenate([[0.0], pose.yaw[:-1]]).astype(np.float32)
        yaw_before = np.concatenate([np.zeros_like(yaw[:1]), yaw[:-1]])
        place = (pose.position[:, PELVIS, :2] / leg).astype(np.float32)
        step = np.diff(place, axis=0, prepend=np.zeros((1, 2), np.float32))
        cosine, sine = np.cos(before)[:, None], np.sin(before)[:, None]
        ahead, aside = self.root[:, 0] / self.fps, self.root[:, 1] / self.fps
        x = cosine * ahead - sine * aside - step[:, 1:] * yaw_before
        y = sine * ahead + cosine * aside + step[:, :1] * yaw_before
        # The heading of a pelvis that is not decoded exactly without its heading.
        own = (spins.world[PELVIS][:, 2:].astype(np.float32) @ self.rotations[:, :PELVIS_SIZE])[:, 0]
        path = np.stack([np.cumsum(x, axis=0), np.cumsum(y, axis=0), self.root[:, 3], yaw + own], axis=1)
        if holding is not None:
            feet = self._points(pose, spins, np.array(FEET))[:, :, :2] + path[:, None, :2]
            feet = np.concatenate([np.zeros_like(feet[:1]), feet]).reshape(len(path) + 1, 2, 2, 2, -1)
            path[:, :2] -= holding.shift(feet)
        return path

    def _points(self, pose: WindowPose, spins: _Spins, points: Indices) -> Float32:
        """Derivatives of points of the body relative to the pelvis, in the axes of the window, (W, P, 3, L) [leg]."""
        leg, chains, frames = pose.body.leg, _chain(pose.body), len(pose.yaw)
        weights = np.zeros((frames, len(points), 3, ROTATION_SIZE))
        for row, point in enumerate(points):
            place = pose.points[:, point]
            for segment, columns in ((PELVIS, slice(0, PELVIS_SIZE)), *chains[point]):
                weights[:, row, :, columns] += _crossed(spins.world[segment], (place - pose.position[:, segment]) / leg)
        flat = weights.reshape(frames, -1, ROTATION_SIZE).astype(np.float32)
        moved = (flat @ self.rotations).reshape(frames, len(points), 3, -1)
        lever = ((pose.points[:, points] - pose.position[:, PELVIS, None]) / leg).astype(np.float32)
        turning = (np.cumsum(self.root[:, 2], axis=0) / self.fps)[:, None]
        moved[:, :, 0] -= lever[..., 1, None] * turning
        moved[:, :, 1] += lever[..., 0, None] * turning
        return moved


def _crossed(spin: Float, lever: Float) -> Float:
    """Cross products of (W, 3, K) and (W, 3)."""
    x, y, z = (lever[:, axis, None] for axis in range(3))
    return np.stack(
        [spin[:, 1] * z - spin[:, 2] * y, spin[:, 2] * x - spin[:, 0] * z, spin[:, 0] * y - spin[:, 1] * x], axis=1
    )


def decoder_jacobian(decode: Callable[[Float32], Float32], size: int) -> Float32:
    """Derivatives of what a decoder makes by its latent, by differences from the latent of zeros, (W, F, L).

    Args:
        decode: frames (W, F) of a latent (1, L).
        size: of the latent, L.
    """
    middle = decode(np.zeros((1, size), np.float32))
    steps = DIFFERENCE * np.eye(size, dtype=np.float32)
    return np.stack([(decode(step[None]) - middle) / DIFFERENCE for step in steps], axis=-1)


class _Spins:
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
        for segment, joint in _joints(pose.body).items():
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
class _Joint:
    """Columns of a joint in the block `rotations`, and the axis of a hinge; None for a ball."""

    columns: slice
    axis: tuple[float, ...] | None = None


@lru_cache(maxsize=8)
def _joints(body: Body) -> dict[int, _Joint]:
    """Joint that moves a segment, by the segment's index among the bodies of the model; the pelvis' is the root."""
    model = human_model(body).model
    found = {PELVIS: _Joint(slice(0, PELVIS_SIZE))}
    for number, ball in enumerate(BALLS):
        start = PELVIS_SIZE + 6 * number
        found[int(model.jnt_bodyid[model.joint(ball[0]).id])] = _Joint(slice(start, start + 6))
    for number, hinge in enumerate(HINGES):
        column = PELVIS_SIZE + 6 * len(BALLS) + number
        axis = np.abs(AXES[hinge[:-2]]) * sign(hinge)
        found[int(model.jnt_bodyid[model.joint(hinge).id])] = _Joint(slice(column, column + 1), tuple(axis))
    return found


@lru_cache(maxsize=8)
def _chain(body: Body) -> tuple[tuple[tuple[int, slice], ...], ...]:
    """For each of `layout.POINTS`: segments between pelvis and point that a joint moves, and columns of the joint."""
    model, joints = human_model(body).model, _joints(body)
    found = []
    for owner in point_owners(body):
        segments, segment = [], owner
        while segment > PELVIS:
            if segment in joints:
                segments.append((segment, joints[segment].columns))
            segment = int(model.body_parentid[segment])
        found.append(tuple(segments))
    return tuple(found)
