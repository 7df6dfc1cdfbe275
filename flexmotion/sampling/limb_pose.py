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

        A product of exponentials about the hinges as they are (Brockett 1984), from the trunk outwards: what a hinge
        carries is turned by it and then by all before it.
        """
        frames, hinges = change.shape
        turn = _turns(self.axis, change)
        # Of what the first so many hinges carry: where it is turned, and where the origin comes to be.
        turned, origin = np.empty((frames, hinges + 1, 3, 3)), np.zeros((frames, hinges + 1, 3))
        turned[:, 0] = np.eye(3)
        away = self.anchor - np.einsum("tkij,tkj->tki", turn, self.anchor)
        for hinge in range(hinges):
            turned[:, hinge + 1] = turned[:, hinge] @ turn[:, hinge]
            origin[:, hinge + 1] = origin[:, hinge] + np.einsum("tij,tj->ti", turned[:, hinge], away[:, hinge])
        by = np.array(self.carried)
        return LimbPose(
            np.einsum("tkij,tkj->tki", turned[:, :-1], self.anchor) + origin[:, :-1],
            np.einsum("tkij,tkj->tki", turned[:, :-1], self.axis),
            np.einsum("tpij,tpj->tpi", turned[:, by], self.points) + origin[:, by],
            self.carried,
        )


def _turns(axis: Float, angle: Float) -> Float:
    """Rotation matrices about unit vectors (..., 3) by (...) [rad], (..., 3, 3)."""
    x, y, z = np.moveaxis(axis, -1, 0)
    sine, cosine = np.sin(angle), np.cos(angle)
    rest = 1.0 - cosine
    found = np.empty((*angle.shape, 3, 3))
    for number, own in enumerate((x, y, z)):
        found[..., number, number] = cosine + rest * own * own
    for row, column, one, other, third in ((0, 1, x, y, z), (1, 2, y, z, x), (2, 0, z, x, y)):
        both, turned = rest * one * other, sine * third
        found[..., row, column], found[..., column, row] = both - turned, both + turned
    return found
