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

    def moved(self, change: Float) -> LimbPose:
        """The limb after its angles have changed by (W, K) [rad].

        A product of exponentials about the hinges as they are (Brockett 1984): what the last hinge has turned, the one
        before it turns again.
        """
        anchor, axis, points = self.anchor.copy(), self.axis.copy(), self.points.copy()
        for hinge in reversed(range(change.shape[1])):
            centre = self.anchor[:, hinge, None]
            turn = _turns(self.axis[:, hinge], change[:, hinge])
            beyond = [number for number, count in enumerate(self.carried) if count > hinge]
            points[:, beyond] = (points[:, beyond] - centre) @ turn + centre
            anchor[:, hinge + 1 :] = (anchor[:, hinge + 1 :] - centre) @ turn + centre
            axis[:, hinge + 1 :] = axis[:, hinge + 1 :] @ turn
        return LimbPose(anchor, axis, points, self.carried)


def _turns(axis: Float, angle: Float) -> Float:
    """Transposed rotation matrices about unit vectors (W, 3) by (W,) [rad], (W, 3, 3)."""
    x, y, z = axis.T
    sine, cosine = np.sin(angle), np.cos(angle)
    rest = 1.0 - cosine
    found = np.empty((len(angle), 3, 3))
    found[:, 0, 0], found[:, 1, 1], found[:, 2, 2] = (cosine + rest * own * own for own in (x, y, z))
    for row, column, one, other, third in ((0, 1, x, y, z), (1, 2, y, z, x), (2, 0, z, x, y)):
        found[:, row, column] = rest * one * other + sine * third
        found[:, column, row] = rest * one * other - sine * third
    return found
