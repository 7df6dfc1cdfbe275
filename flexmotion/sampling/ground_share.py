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

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.ground_reaction import GROUND
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
    bears: Flags = np.asarray(usable.any(axis=-1))
    two: Flags = np.asarray(bears.all(axis=1))
    lift = np.where(bears.any(axis=1), np.maximum(force[:, 2], 0.0), 0.0)
    lifted = lift > SLIGHT * weight
    wanted = moment[:, [1, 0]] * [-1.0, 1.0] / np.where(lifted, lift, 1.0)[:, None]
    # A foot that bears has a little, so that one that the model forgot can take over.
    loads = np.where(bears, np.maximum(predicted[..., 2], SLIGHT * weight), 0.0)
    share = loads / np.maximum(loads.sum(axis=1, keepdims=True), SLIGHT * weight)
    share, place = _vertical(wanted, soles, usable, share, centres[..., :2], lifted & two)
    vertical = np.where(lifted[:, None], share * lift[:, None], 0.0)
    horizontal, twist = _horizontal(force[:, :2], moment[:, 2], vertical, place, _lever(soles, usable), predicted)
    wrenches = np.zeros((len(force), 2, 6))
    wrenches[..., :2], wrenches[..., 2], wrenches[..., 5] = horizontal, vertical, twist
    on_floor = np.zeros((len(force), 2, 3))
    on_floor[..., :2] = np.where((vertical > 0)[..., None], place, soles.origin)
    return GroundShare(wrenches, on_floor)


def _vertical(
    wanted: Float, soles: Soles, usable: Flags, share: Float, centres: Float, both: Flags
) -> tuple[Float, Float]:
    """Shares of the feet, (T, 2), and their centres of pressure, (T, 2, 2) [m]; `both`: frames with two feet."""
    # A foot in the air keeps its lowest point, so that its bounds exist.
    kept = usable | (soles.height <= soles.height.min(axis=-1, keepdims=True))
    bounds = [
        found
        for along in soles.lattice.T
        for found in (np.where(kept, along, np.inf).min(axis=2), np.where(kept, along, -np.inf).max(axis=2))
    ]
    split = _Split.of(wanted, soles, np.array(bounds).reshape(2, 2, *share.shape), both)
    share, local = share.T, split.local(centres)
    # One foot alone is done in one step.
    share, local, place = split.alternated(share, local, 1)
    missing = np.abs(split.wanted - share[0] * place[0] - share[1] * place[1])
    late = np.flatnonzero(both & (missing.max(axis=0) > MET))
    if len(late):
        share[:, late], _, place[..., late] = split[late].alternated(share[:, late], local[..., late], ROUNDS)
    return share.T, place.transpose(2, 0, 1)


@dataclass(frozen=True)
class _Split:
    """What the vertical force of two feet is to give, and where they can, for N frames, which are the last axis.

    Attributes:
        wanted: zero-moment point, (2, N) [m].
        origin: of the soles, (2 feet, 2, N) [m].
        axes: of the soles, by coordinate: (2 coordinates, 2 feet, 2, N).
        back: rows of the damped inverse of `axes`, by direction in the world: (2 directions, 2 feet, 2, N).
        low, high: bounds of the coordinates, (2 feet, 2, N) [m].
        both: frames with two feet, (N,).
    """

    wanted: Float
    origin: Float
    axes: Float
    back: Float
    low: Float
    high: Float
    both: Flags

    @classmethod
    def of(cls, wanted: Float, soles: Soles, bounds: Float, both: Flags) -> _Split:
        """From arrays with frames first; `bounds`: by coordinate, low and high, (2, 2, N, 2 feet)."""
        axes = np.ascontiguousarray(soles.axes.transpose(3, 1, 2, 0))
        # Damped: a foot that points straight down has no extent on the floor.
        x, y = axes
        a, b, d = ((one * other).sum(axis=1) for one, other in ((x, x), (x, y), (y, y)))
        a, d = a + DAMPED, d + DAMPED
        inverse = np.array([[d, -b], [-b, a]]) / (a * d - b * b)
        low, high = bounds.transpose(1, 3, 0, 2)
        return cls(
            wanted=np.ascontiguousarray(wanted.T),
            origin=np.ascontiguousarray(soles.origin.transpose(1, 2, 0)),
            axes=axes,
            back=(inverse[:, 0, :, None] * x + inverse[:, 1, :, None] * y).transpose(2, 1, 0, 3),
            low=low,
            high=high,
            both=both,
        )

    def __getitem__(self, frames: NDArray[np.intp]) -> _Split:
        """Some frames of it."""
        return _Split(**{item.name: getattr(self, item.name).take(frames, axis=-1) for item in fields(self)})

    def local(self, centres: Float) -> Float:
        """Coordinates on the soles, within their bounds, of centres of pressure (N, 2, 2): (2 feet, 2, N) [m]."""
        away = centres.transpose(1, 2, 0) - self.origin
        along = self.back[0] * away[:, :1] + self.back[1] * away[:, 1:]
        return np.minimum(np.maximum(along, self.low), self.high)

    def alternated(self, share: Float, local: Float, rounds: int) -> tuple[Float, Float, Float]:
        """Centres of pressure, then shares, moved towards the zero-moment point, in turn.

        Args:
            share: of the feet, (2, N).
            local: coordinates of the centres, (2 feet, 2, N) [m].
            rounds: one or more.

        Returns:
            Both, and the centres, (2 feet, 2, N) [m].
        """
        (back_x, back_y), (along_x, along_y) = self.back, self.axes
        share, local = share.copy(), local.copy()
        (left, right), (local_x, local_y) = share, (local[:, :1], local[:, 1:])
        place = self.origin + along_x * local_x + along_y * local_y
        missing = self.wanted - left * place[0] - right * place[1]
        both = bool(self.both.all()) or self.both  # a mask takes as long as the arithmetic
        # Few frames: the time is that of the calls, not of the arithmetic. Arrays are reused, views made once.
        step, moved, square, change = (np.empty_like(one) for one in (share, local, self.wanted, left))
        first, second = place
        for _ in range(rounds):
            np.divide(share, np.maximum(left * left + right * right, SLIGHT), out=step)
            np.multiply(back_x, missing[0], out=moved)
            moved += back_y * missing[1]
            moved *= step[:, None]
            local += moved
            np.maximum(local, self.low, out=local)
            np.minimum(local, self.high, out=local)
            np.multiply(along_x, local_x, out=place)
            np.multiply(along_y, local_y, out=moved)
            place += moved
            place += self.origin
            apart = first - second
            np.subtract(self.wanted, second, out=missing)
            missing -= left * apart
            np.multiply(apart, apart, out=square)
            gained = missing * apart
            np.divide(gained[0] + gained[1], np.maximum(square[0] + square[1], SLIGHT), out=change)
            change += left
            np.maximum(change, 0.0, out=change)
            missing += left * apart
            np.minimum(change, 1.0, out=left, where=both)
            np.subtract(1.0, left, out=right, where=both)
            missing -= left * apart
        return share, local, place


def _horizontal(
    force: Float, moment: Float, vertical: Float, place: Float, lever: Float, predicted: Float
) -> tuple[Float, Float]:
    """Horizontal forces, (T, 2, 2) [N], and moments about the vertical, (T, 2) [N·m]."""
    lift = vertical.sum(axis=1)
    share = vertical / np.where(lift > 0, lift, 1.0)[:, None]
    limit = GROUND.friction * vertical
    size = np.hypot(force[:, 0], force[:, 1])
    given = force * np.minimum(1.0, GROUND.friction * lift / np.maximum(size, SLIGHT))[:, None]
    common = share[..., None] * given[:, None]
    sum_predicted = predicted[..., :2].sum(axis=1)
    opposed = predicted[:, 0, :2] - share[:, :1] * sum_predicted
    both: Flags = np.asarray((vertical > 0).all(axis=1))
    opposed = _within_friction(np.where(both[:, None], opposed, 0.0), common, limit)
    horizontal = common + np.stack([opposed, -opposed], axis=1)

    needed = moment - (place[..., 0] * horizontal[..., 1] - place[..., 1] * horizontal[..., 0]).sum(axis=1)
    twist_limit = GROUND.friction * vertical * lever
    twist = np.minimum(np.maximum(share * needed[:, None], -twist_limit), twist_limit)
    # The rest by opposed forces across the line between the feet.
    apart = place[:, 0] - place[:, 1]
    across = np.stack([-apart[:, 1], apart[:, 0]], axis=1) / np.maximum((apart**2).sum(axis=1), SLIGHT)[:, None]
    rest = np.where(both, needed - twist.sum(axis=1), 0.0)
    pair = _within_friction(across * rest[:, None], horizontal, limit)
    return horizontal + np.stack([pair, -pair], axis=1), twist


def _within_friction(opposed: Float, common: Float, limit: Float) -> Float:
    """Opposed forces (T, 2) reduced until the force of neither foot exceeds its friction."""
    room = np.maximum(limit - np.hypot(common[..., 0], common[..., 1]), 0.0).min(axis=1)
    size = np.hypot(opposed[:, 0], opposed[:, 1])
    found: Float = opposed * np.minimum(1.0, room / np.maximum(size, SLIGHT))[:, None]
    return found


def _lever(soles: Soles, usable: Flags) -> Float:
    """Mean distance of the usable points from their centre, (T, 2) [m]: lever of friction about it."""
    weight = usable / np.maximum(usable.sum(axis=-1, keepdims=True), 1)
    away = soles.points - np.einsum("tfp,tfpi->tfi", weight, soles.points)[:, :, None]
    found: Float = np.einsum("tfp,tfp->tf", weight, np.hypot(away[..., 0], away[..., 1]))
    return found
