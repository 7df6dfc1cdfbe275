"""`RestingFeet`: feet that rest on the floor while a body stands, and where they stay while it is balanced.

Balance shifts a body by centimetres. Feet that move along slide, and a body that leans over the edge of its soles is
only kept up by an acceleration, which the next window goes on from: a bow that was asked for a minute went 60 m. A
person that stands brings its body over its feet instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.differentiation import derivative
from flexmotion.biomechanics.sole import NEARNESS, REACH
from flexmotion.features.constraint_layout import PLACES
from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor
from flexmotion.features.layout import POINTS
from flexmotion.human.skeleton import SIDES
from flexmotion.sampling.limb_closing import STAYS

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]

ENDS = ("heel", "toe")


@dataclass(frozen=True)
class RestingFeet:
    """Heel and toe of left and right foot that rest, over W frames.

    Attributes:
        rests: whether they do, (W, 2, 2).
        places: where they are in the planted window, in the world, (W, 2, 2, 3) [m].
        away: from there to where they stay, on the floor, (W, 2, 2, 2) [m]; 0 where they do not rest.
    """

    rests: Flags
    places: Float
    away: Float

    @classmethod
    def of(cls, feet: Float, contacts: Flags, fps: float) -> RestingFeet:
        """Of a planted window: ends that are low and slow rest, whatever the contacts say.

        An end that rests from the frame before the window on stays where it was there, and one that comes to rest stays
        at its mean place.

        Args:
            feet: heel and toe of both feet in the frame before it, then in each frame, (W + 1, 2, 2, 3) [m].
            contacts: feet that carry load, (W, 2).
            fps: frames per second.
        """
        velocity = derivative(feet, fps)
        speed = np.hypot(velocity[..., 0], velocity[..., 1])
        loaded = np.concatenate([contacts[:1], contacts])
        reach = np.where(loaded, REACH, NEARNESS.height)[..., None]
        rests = (feet[..., 2] < reach) & (speed < NEARNESS.speed)
        away = np.zeros((*rests.shape, 2))
        for foot, end in np.ndindex(rests.shape[1:]):
            for spell in _spells(rests[:, foot, end]):
                own = feet[spell, foot, end, :2]
                away[spell, foot, end] = (own[0] if spell.start == 0 else own.mean(axis=0)) - own
        return cls(rests[1:], feet[1:], away[1:])

    def beside(self, constraints: Constraints) -> RestingFeet:
        """Those of which no place is asked in the window."""
        places = constraints.mask[:, constraints.layout.blocks[PLACES]].reshape(len(self.rests), len(POINTS), 3)
        free = [not places[:, [POINTS.index(f"{point}_{side}") for point in ("ankle", *ENDS)]].any() for side in SIDES]
        return replace(self, rests=self.rests & np.array(free)[:, None], away=self.away * np.array(free)[:, None, None])

    def reached(self, feet: Float) -> RestingFeet:
        """Those that legs brought to within `STAYS` of where they stay, of heel and toe now, (W, 2, 2, 3) [m]."""
        away = self.away + self.places[..., :2] - feet[..., :2]
        rests = self.rests & (np.linalg.norm(away, axis=-1) < STAYS)
        return RestingFeet(rests, feet, away * rests[..., None])

    @property
    def stands(self) -> Flags:
        """Feet of which an end rests, (W, 2)."""
        return np.asarray(self.rests.any(axis=2))

    @property
    def shift(self) -> Float:
        """How far their feet are moved on the floor, (W, 2, 2) [m]."""
        found: Float = self.away.sum(axis=2) / np.maximum(self.rests.sum(axis=2), 1)[..., None]
        return found

    def asked(self, constraints: Constraints, anchor: Anchor) -> Constraints:
        """Constraints, and that resting ends are where they stay.

        Args:
            constraints: of the window.
            anchor: the frame before it.
        """
        places = self.places.copy()
        places[..., :2] += self.away
        return _with_ends(constraints, self.rests, anchor.local(places))


def standing_on(feet: Float, constraints: Constraints, anchor: Anchor) -> Constraints:
    """Constraints, and that both feet are at places in all frames of the window.

    Args:
        feet: heel and toe of both feet in the world, (W, 2, 2, 3) [m].
        constraints: of the window.
        anchor: the frame before it.
    """
    return _with_ends(constraints, np.ones(feet.shape[:3], np.bool_), anchor.local(feet))


def _with_ends(constraints: Constraints, told: Flags, places: Float) -> Constraints:
    """Constraints, and that heel and toe of both feet are at places, (W, 2, 2, 3) [m], in some frames, (W, 2, 2)."""
    ends = [f"{name}_{side}" for side in SIDES for name in ENDS]
    frames = len(told)
    return constraints.places(ends, told.reshape(frames, -1), places.reshape(frames, -1, 3))


def _spells(flags: Flags) -> list[slice]:
    """Runs of true values."""
    if flags.all():
        return [slice(0, len(flags))]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return [slice(start, stop) for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)]
