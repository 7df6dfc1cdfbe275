"""`WindowChange`: how a window at hand changes with its latent: path, rotations, points, centres of mass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.constraint_layout import PATH, PLACES, ROTATIONS, ConstraintLayout
from flexmotion.features.joint_groups import PELVIS_SIZE
from flexmotion.human.human_model import human_model
from flexmotion.sampling.column_cuts import ColumnCuts
from flexmotion.sampling.joint_spins import JointSpins, carrying
from flexmotion.sampling.planted import Holding
from flexmotion.sampling.window_pose import FEET, PELVIS, WindowPose, point_owners

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

LINEAR = (PATH, ROTATIONS, PLACES)
"""Blocks of constraints that kinematics tell."""


class WindowChange:
    """Derivatives of a planted window by its latent of L numbers.

    Args:
        root: derivatives of the features of the block `root`, (W, 4, L).
        cuts: of those of the block `rotations`.
        fps: frames per second.
        pose: the window as it is.
        holding: how its feet were held in place, in the frame of the window; None where they were not.

    Attributes:
        fps: frames per second.
        path: derivatives of place and height [leg] and heading [rad] of the pelvis, (W, 4, L).
    """

    def __init__(self, root: Float32, cuts: ColumnCuts, fps: float, pose: WindowPose, holding: Holding | None) -> None:
        self._root, self._cuts, self.fps, self._pose = root, cuts, fps, pose
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
                found[own] = (self._spins.kept[frame, column][:, None] @ self._cuts.whole[frame])[:, 0]
            else:
                points, number = np.unique(column // 3, return_inverse=True)
                asked, row = np.unique(frame, return_inverse=True)
                only = slice(None) if len(asked) == len(self.path) else asked
                found[own] = self.points(points, only)[row, number, column % 3]
        return found

    def points(self, points: Indices, frames: Indices | slice = slice(None)) -> Float32:
        """Derivatives of points of the body by their numbers in `layout.POINTS`, (W, P, 3, L) [leg], or of frames."""
        pose = self._pose
        places, owners = pose.points[frames][:, points], np.array(point_owners(pose.body))[points]
        return self._relative(places, *self._weights(places, owners, frames), frames) + self.path[frames, None, :3]

    def at_segment(self, segment: int, place: Float) -> Float32:
        """Derivatives of a point that is fixed to one of the model's bodies, (W, 3, L) [leg]; `place`: (W, 3) [m]."""
        place = place[:, None]
        return self._relative(place, *self._weights(place, np.array([segment])))[:, 0] + self.path[:, :3]

    def centre(self, segments: Mask) -> Float32:
        """Derivatives of the centre of mass of some of the model's bodies, (B,) -> (W, 3, L) [leg]."""
        pose, body = self._pose, self._pose.body
        mass = human_model(body).model.body_mass * segments
        centres, moved = pose.centres, carrying(body).T * mass  # (50, B)
        lever = centres.swapaxes(-1, -2) @ moved.T - moved.sum(axis=1) * self._spins.place
        weights = _crossed(self._spins.world, (lever / (body.leg * mass.sum())).astype(np.float32))[:, None]
        place = np.einsum("b,tbi->ti", mass / mass.sum(), centres)
        return self._relative(place[:, None], weights, self._cuts.whole)[:, 0] + self.path[:, :3]

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
        own = (self._spins.world[:, 2:, :PELVIS_SIZE] @ self._cuts.whole[:, :PELVIS_SIZE])[:, 0]
        path: Float32 = np.stack([np.cumsum(x, axis=0), np.cumsum(y, axis=0), root[:, 3], yaw + own], axis=1)
        if holding is not None:
            path[:, :2] -= self._held(holding, path[:, :2])
        return path

    def _held(self, holding: Holding, path: Float32) -> Float32:
        """Derivatives of what the root makes up for of the slip of the feet, (W, 2, L) [leg].

        What a foot slips in a frame is its place less the one in the frame before. The feet are summed up before they
        are multiplied by derivatives of rotations: two rows a frame and one before it, in place of three a point.

        Args:
            holding: of the feet.
            path: derivatives of the place of a pelvis whose feet are not held, (W, 2, L) [leg].
        """
        pose, frames = self._pose, len(path)
        places, owners = pose.points[:, FEET], np.array(point_owners(pose.body))[FEET]
        weights, rotations = self._weights(places, owners)
        weights = weights[:, :, :2].reshape(frames, -1, rotations.shape[1])
        lever = (places - pose.position[:, PELVIS, None])[..., :2] / pose.body.leg
        turned = np.stack([-lever[..., 1], lever[..., 0]], axis=-1, dtype=np.float32).reshape(frames, -1, 1)
        # As rows: what a frame's feet add to its own step, and what they take from the next one.
        gains = holding.gains.astype(np.float32)
        both = np.concatenate([gains, np.concatenate([gains[1:], np.zeros_like(gains[:1])])], axis=1)
        moved: Float32 = (both @ weights) @ rotations
        moved += (both @ turned) * self._turning
        whole = gains.reshape(frames, 2, len(FEET), 2).sum(axis=2)
        step = moved[:, :2] + whole @ path
        step[1:] -= moved[:-1, 2:] + whole[1:] @ path[:-1]
        return holding.summed(step)

    def _weights(
        self, places: Float, owners: Indices, frames: Indices | slice = slice(None)
    ) -> tuple[Float32, Float32]:
        """How points move with the K columns of the block `rotations` that move any, and derivatives of the columns.

        Args:
            places: of the points, (W, P, 3) [m].
            owners: segments that they are fixed to, (P,).
            frames: of the window.

        Returns:
            (W, P, 3, K) [leg] and (W, K, L).
        """
        body = self._pose.body
        carried = carrying(body)[owners]
        columns = np.flatnonzero(carried.any(axis=0))
        lever = places[..., None].astype(np.float32) - self._spins.place[frames, None][..., columns]
        lever *= (carried[:, None, columns] / body.leg).astype(np.float32)
        return _crossed(self._spins.world[frames, None][..., columns], lever), self._cuts.of(columns)[frames]

    def _relative(
        self, places: Float, weights: Float32, rotations: Float32, frames: Indices | slice = slice(None)
    ) -> Float32:
        """Derivatives of places relative to the pelvis, in the axes of the window, (W, P, 3, L) [leg].

        Args:
            places: (W, P, 3) [m].
            weights, rotations: of columns that move them, (W, P, 3, K) [leg] and (W, K, L).
            frames: of the window.
        """
        pose, turning = self._pose, self._turning[frames]
        flat = weights.reshape(len(weights), -1, rotations.shape[1])
        moved: Float32 = (flat @ rotations).reshape(*weights.shape[:3], -1)
        lever = ((places - pose.position[frames, PELVIS, None]) / pose.body.leg).astype(np.float32)
        moved[:, :, 0] -= lever[..., 1, None] * turning
        moved[:, :, 1] += lever[..., 0, None] * turning
        return moved


def _crossed(spin: Float32, lever: Float32) -> Float32:
    """Cross products over the last axis but one, (..., 3, K)."""
    a, b, c = spin[..., 0, :], spin[..., 1, :], spin[..., 2, :]
    x, y, z = lever[..., 0, :], lever[..., 1, :], lever[..., 2, :]
    found = np.empty(np.broadcast_shapes(spin.shape, lever.shape), np.float32)
    found[..., 0, :] = b * z - c * y
    found[..., 1, :] = c * x - a * z
    found[..., 2, :] = a * y - b * x
    return found
