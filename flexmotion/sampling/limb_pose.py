"""`LimbPose`: one arm or leg over a window, moved by its own joints alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.sampling.limb_loops import moved

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
        return LimbPose(
            self.anchor, self.axis, self.points.take(points, axis=1), tuple(self.carried[point] for point in points)
        )

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
        anchor, axis, points, by = (
            np.ascontiguousarray(array) for array in (self.anchor, self.axis, self.points, change)
        )
        return LimbPose(*moved(anchor, axis, points, np.array(self.carried, np.int64), by), self.carried)
