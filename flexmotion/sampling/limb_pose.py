"""`LimbPose`: one arm or leg over a window, moved by its own joints alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


@dataclass(frozen=True)
class LimbPose:
    """A limb of K hinges, from the trunk outwards, over W frames.

    Attributes:
        anchor, axis: of the hinges, (W, K, 3) [m] and unit vectors.
        points: of the limb, (W, P, 3) [m].
        carried: for each point the number of hinges that move it, (P,).
    """

    anchor: Float
    axis: Float
    points: Float
    carried: tuple[int, ...]

    def only(self, points: NDArray[np.intp]) -> LimbPose:
        """The limb with some of its points alone."""
        return LimbPose(self.anchor, self.axis, self.points[:, points], tuple(self.carried[point] for point in points))

    def moved(self, change: Float) -> LimbPose:
        """The limb after its angles have changed by (W, K) [rad].

        A product of exponentials about the hinges as they are (Brockett 1984), from the trunk outwards: what a hinge
        carries is turned by it and then by all before it.
        """
        frames, hinges = change.shape
        own = np.zeros((frames, hinges, 4, 4))
        own[..., :3, :3] = turn = _turns(self.axis, change)
        own[..., :3, 3] = self.anchor - np.einsum("tkij,tkj->tki", turn, self.anchor)
        own[..., 3, 3] = 1.0
        moved = np.empty((frames, hinges + 1, 4, 4))  # of what the first so many hinges carry
        moved[:, 0] = np.eye(4)
        for hinge in range(hinges):
            np.matmul(moved[:, hinge], own[:, hinge], out=moved[:, hinge + 1])
        places = np.concatenate([self.anchor, self.points], axis=1)
        by = moved[:, [*range(hinges), *self.carried], :3]
        found = np.einsum("tkij,tkj->tki", by[..., :3], places) + by[..., 3]
        axis = np.einsum("tkij,tkj->tki", by[:, :hinges, :, :3], self.axis)
        return LimbPose(found[:, :hinges], axis, found[:, hinges:], self.carried)


def _turns(axis: Float, angle: Float) -> Float:
    """Rotation matrices about unit vectors (..., 3) by (...) [rad], (..., 3, 3)."""
    sine, cosine = np.sin(angle), np.cos(angle)
    found = ((1.0 - cosine)[..., None] * axis)[..., None] * axis[..., None, :]
    for number in range(3):
        after, last = (number + 1) % 3, (number + 2) % 3
        along = sine * axis[..., number]
        found[..., number, number] += cosine
        found[..., after, last] -= along
        found[..., last, after] += along
    return found
