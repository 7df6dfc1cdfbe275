"""`WindowChange`: how a window at hand changes with its latent: path, rotations, points, centres of mass."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.constraint_layout import PATH, PLACES, ROTATIONS, ConstraintLayout
from flexmotion.features.joint_groups import PELVIS_SIZE, ROTATION_SIZE
from flexmotion.human.body import Body
from flexmotion.human.human_model import human_model
from flexmotion.sampling.joint_spins import JointSpins, chains, joints_of
from flexmotion.sampling.planted import Holding
from flexmotion.sampling.window_pose import FEET, PELVIS, WindowPose

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

LINEAR = (PATH, ROTATIONS, PLACES)
"""Blocks of constraints that kinematics tell."""


class WindowChange:
    """Derivatives of a planted window by its latent of L numbers.

    Args:
        root, rotations: derivatives of the features of these blocks, (W, 4, L) and (W, 50, L).
        fps: frames per second.
        pose: the window as it is.
        holding: how its feet were held in place, in the frame of the window; None where they were not.

    Attributes:
        fps: frames per second.
        path: derivatives of place and height [leg] and heading [rad] of the pelvis, (W, 4, L).
    """

    def __init__(
        self, root: Float32, rotations: Float32, fps: float, pose: WindowPose, holding: Holding | None
    ) -> None:
        self._root, self._rotations, self.fps, self._pose = root, rotations, fps, pose
        self._spins = JointSpins(pose)
        self._turning = (np.cumsum(root[:, 2], axis=0) / fps)[:, None]
        self.path = self._path(holding)

    def jacobian(self, layout: ConstraintLayout, frames: Indices, columns: Indices) -> Float32:
        """Derivatives of R values, (R, L).

        Args:
            layout: of the constraints.
            frames, columns: of the values, (R,) each; rows of blocks that are not in `LINEAR` are zero.
        """
        found = np.zeros((len(frames), self._root.shape[-1]), np.float32)
        for name in LINEAR:
            cut = layout.blocks[name]
            own = np.flatnonzero((columns >= cut.start) & (columns < cut.stop))
            if not len(own):
                continue
            frame, column = frames[own], columns[own] - cut.start
            if name == PATH:
                found[own] = self.path[frame, column]
            elif name == ROTATIONS:
                found[own] = (self._spins.kept[frame, column][:, None] @ self._rotations[frame])[:, 0]
            else:
                points, number = np.unique(column // 3, return_inverse=True)
                found[own] = self.points(points)[frame, number, column % 3]
        return found

    def points(self, points: Indices) -> Float32:
        """Derivatives of points of the body by their numbers in `layout.POINTS`, (W, P, 3, L) [leg]."""
        return self._relative_points(points) + self.path[:, None, :3]

    def at_segment(self, segment: int, place: Float) -> Float32:
        """Derivatives of a point that is fixed to one of the model's bodies, (W, 3, L) [leg]; `place`: (W, 3) [m]."""
        pose, parents = self._pose, human_model(self._pose.body).model.body_parentid
        weights = np.zeros((len(place), 1, 3, ROTATION_SIZE))
        joints = joints_of(pose.body)
        while segment:
            if segment in joints:
                lever = (place - pose.position[:, segment]) / pose.body.leg
                weights[:, 0, :, joints[segment].columns] += _crossed(self._spins.world[segment], lever)
            segment = int(parents[segment])
        return self._relative(weights, place[:, None])[:, 0] + self.path[:, :3]

    def centre(self, segments: Mask) -> Float32:
        """Derivatives of the centre of mass of some of the model's bodies, (B,) -> (W, 3, L) [leg]."""
        pose, body = self._pose, self._pose.body
        mass = human_model(body).model.body_mass * segments
        centres = pose.centres
        weights = np.zeros((len(pose.yaw), 1, 3, ROTATION_SIZE))
        for segment, joint in joints_of(body).items():
            moved = mass * _beyond(body)[segment]
            if moved.any():
                lever = (np.einsum("b,tbi->ti", moved, centres) - moved.sum() * pose.position[:, segment]) / body.leg
                weights[:, 0, :, joint.columns] += _crossed(self._spins.world[segment], lever / mass.sum())
        place = np.einsum("b,tbi->ti", mass / mass.sum(), centres)
        return self._relative(weights, place[:, None])[:, 0] + self.path[:, :3]

    def _path(self, holding: Holding | None) -> Float32:
        pose, root = self._pose, self._root
        yaw = self._turning[:, 0]
        before = np.concatenate([[0.0], pose.yaw[:-1]]).astype(np.float32)
        yaw_before = np.concatenate([np.zeros_like(yaw[:1]), yaw[:-1]])
        place = (pose.position[:, PELVIS, :2] / pose.body.leg).astype(np.float32)
        step = np.diff(place, axis=0, prepend=np.zeros((1, 2), np.float32))
        cosine, sine = np.cos(before)[:, None], np.sin(before)[:, None]
        ahead, aside = root[:, 0] / self.fps, root[:, 1] / self.fps
        x = cosine * ahead - sine * aside - step[:, 1:] * yaw_before
        y = sine * ahead + cosine * aside + step[:, :1] * yaw_before
        # The heading of a pelvis that is not decoded exactly without its heading.
        own = (self._spins.world[PELVIS][:, 2:].astype(np.float32) @ self._rotations[:, :PELVIS_SIZE])[:, 0]
        path: Float32 = np.stack([np.cumsum(x, axis=0), np.cumsum(y, axis=0), root[:, 3], yaw + own], axis=1)
        if holding is not None:
            feet = self._relative_points(np.array(FEET))[:, :, :2] + path[:, None, :2]
            feet = np.concatenate([np.zeros_like(feet[:1]), feet]).reshape(len(path) + 1, 2, 2, 2, -1)
            path[:, :2] -= holding.shift(feet)
        return path

    def _relative_points(self, points: Indices) -> Float32:
        pose, weights = self._pose, np.zeros((len(self._pose.yaw), len(points), 3, ROTATION_SIZE))
        for row, point in enumerate(points):
            place = pose.points[:, point]
            for segment, columns in ((PELVIS, slice(0, PELVIS_SIZE)), *chains(pose.body)[point]):
                lever = (place - pose.position[:, segment]) / pose.body.leg
                weights[:, row, :, columns] += _crossed(self._spins.world[segment], lever)
        return self._relative(weights, pose.points[:, points])

    def _relative(self, weights: Float, places: Float) -> Float32:
        """Derivatives of places relative to the pelvis, in the axes of the window, (W, P, 3, L) [leg].

        Args:
            weights: of the columns of the block `rotations`, (W, P, 3, 50).
            places: (W, P, 3) [m].
        """
        pose, frames = self._pose, len(weights)
        flat = weights.reshape(frames, -1, ROTATION_SIZE).astype(np.float32)
        moved: Float32 = (flat @ self._rotations).reshape(*weights.shape[:3], -1)
        lever = ((places - pose.position[:, PELVIS, None]) / pose.body.leg).astype(np.float32)
        moved[:, :, 0] -= lever[..., 1, None] * self._turning
        moved[:, :, 1] += lever[..., 0, None] * self._turning
        return moved


@lru_cache(maxsize=8)
def _beyond(body: Body) -> dict[int, Mask]:
    """For each segment that a joint moves, it and all that it carries, (B,)."""
    model = human_model(body).model
    found = {}
    for segment in joints_of(body):
        carried = np.zeros(model.nbody, np.bool_)
        carried[segment] = True
        for number in range(segment + 1, model.nbody):
            carried[number] = carried[model.body_parentid[number]]
        found[segment] = carried
    return found


def _crossed(spin: Float, lever: Float) -> Float:
    """Cross products of (W, 3, K) and (W, 3)."""
    x, y, z = (lever[:, axis, None] for axis in range(3))
    return np.stack(
        [spin[:, 1] * z - spin[:, 2] * y, spin[:, 2] * x - spin[:, 0] * z, spin[:, 0] * y - spin[:, 1] * x], axis=1
    )
