"""`ground_share`: ground forces on both feet that a motion needs, as near as possible to those that a model predicts.

What the motion needs of the ground as a whole follows from its accelerations. What it leaves open, how much each foot
carries and where, is the model's to say. In closed form, frame by frame:

- vertical: the model's shares of the feet and its centres of pressure, moved until together they give the zero-moment
  point: first the centres, within the soles, then the shares;
- horizontal: in proportion to the vertical force, plus the model's forces that oppose each other, within friction;
- moment about the vertical: in proportion likewise, within what friction under the soles can give; the rest by opposed
  horizontal forces of the two feet.

What no ground can give remains as residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.ground_reaction import GROUND
from flexmotion.compiled import doubles
from flexmotion.sampling.ground_loops import Feet, Sharing, shares
from flexmotion.sampling.soles import Soles

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]

ROUNDS = 10
"""Alternations between centres and shares of two feet; twice as many change no figure of `model/delivered`."""

MET = 5e-4
"""Distance from the zero-moment point at which a frame is done [m]."""

DAMPED = 1e-4
"""Square of the share of a sole's extent on the floor below which places along it are damped."""

SLIGHT = 1e-6
"""Share of the whole force below which there is nothing to share."""


@dataclass(frozen=True)
class GroundShare:
    """Ground reaction on left and right foot.

    Attributes:
        wrenches: force, and moment about `centres`, (T, 2, 6) [N, N·m].
        centres: of pressure, on the floor; below the ankle of a foot in the air, (T, 2, 3) [m].
    """

    wrenches: Float
    centres: Float


def ground_share(
    force: Float, moment: Float, soles: Soles, usable: Flags, predicted: Float, centres: Float, weight: float
) -> GroundShare:
    """Forces of the ground on both feet.

    Args:
        force, moment: that the motion needs in all, the moment about the world's origin, (T, 3) [N, N·m].
        soles: of the motion.
        usable: whether the ground may act at a point of a sole, (T, 2, 12).
        predicted: wrenches of a model, (T, 2, 6) [N, N·m].
        centres: of pressure of the same, (T, 2, 3) [m].
        weight: of the body [N].
    """
    own = doubles
    feet = Feet(
        origin=own(soles.origin),
        axes=own(soles.axes),
        lattice=own(soles.lattice),
        points=own(soles.points),
        height=own(soles.height),
        usable=np.ascontiguousarray(usable),
        predicted=own(predicted),
        centres=own(centres),
    )
    sharing = Sharing(ROUNDS, MET, DAMPED, SLIGHT, SLIGHT * weight, GROUND.friction)
    return GroundShare(*shares(own(force), own(moment), feet, sharing))
