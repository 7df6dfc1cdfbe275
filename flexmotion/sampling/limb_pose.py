"""`LimbPose`: one arm or leg over a window, moved by its own joints alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.spatial.rotations import add_cross

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

    def where(self, frames: NDArray[np.bool_], other: LimbPose) -> LimbPose:
        """The limb as it is in some frames, (W,), as another pose of it is in the others."""
        own = frames[:, None, None]
        return LimbPose(
            np.where(own, self.anchor, other.anchor),
            np.where(own, self.axis, other.axis),
            np.where(own, self.points, other.points),
            self.carried,
        )

    def moved(self, change: Float) -> LimbPose:
        """The limb after its angles have changed by (W, K) [rad].

        A product of exponentials about the hinges as they are (Brockett 1984), from the trunk outwards: what a hinge
        carries is turned by it and then by all before it, the way to it by those before it alone.
        """
        hinges = change.shape[1]
        # Coordinates first in memory, frames last: a fifth of the time of a product for every frame and vector.
        axis, anchor, points = (array.transpose(2, 1, 0) for array in (self.axis, self.anchor, self.points))
        axis = np.ascontiguousarray(axis)
        turn = _turns(axis, np.ascontiguousarray(change.T))
        by = np.empty((3, 3, hinges + 1, len(change)))  # of what the first so many hinges carry
        by[:, :, 0] = np.eye(3)[..., None]
        for hinge in range(hinges):
            np.einsum("ijw,jkw->ikw", by[:, :, hinge], turn[:, :, hinge], out=by[:, :, hinge + 1])
        inner = [max(count - 1, 0) for count in self.carried]  # hinge from which a point's way is counted
        ways = np.concatenate([anchor[:, 1:] - anchor[:, :-1], points - anchor[:, inner], axis], axis=1)
        every = [*range(1, hinges), *self.carried, *range(hinges)]
        found = np.einsum("ijkw,jkw->ikw", by.take(every, axis=2), ways)
        steps, beyond, axis = found[:, : hinges - 1], found[:, hinges - 1 : -hinges], found[:, -hinges:]
        anchor = np.concatenate([anchor[:, :1], steps], axis=1).cumsum(axis=1)
        anchor, axis, points = (
            np.ascontiguousarray(array.transpose(2, 1, 0)) for array in (anchor, axis, anchor[:, inner] + beyond)
        )
        return LimbPose(anchor, axis, points, self.carried)


def _turns(axis: Float, angle: Float) -> Float:
    """Rotation matrices about unit vectors (3, ...) by (...) [rad], (3, 3, ...)."""
    sine, cosine = np.sin(angle), np.cos(angle)
    found = ((1.0 - cosine) * axis)[:, None] * axis
    np.einsum("ii...->i...", found)[...] += cosine
    add_cross(found.transpose(*range(2, found.ndim), 0, 1), (sine * axis).transpose(*range(1, axis.ndim), 0))
    return found
