"""`horizontal_shift`, `vertical_shift`: the root's path is shifted so that the ground can give what the motion needs.

Errors of the legs let loaded feet slide, and holding them in place (`planted`) jerks the body: its zero-moment point
leaves the soles by decimetres. Here the whole body, feet included, is shifted by a path d(t) that trades the two:

    min  Σ slip |ḋ|²  +  network |r̈ + d̈ - a|²  +  jerk |r⃛ + d⃛|²     so that the zero-moment point is within the soles

for the root's path r and the accelerations a of the model's own path. Seen from the feet, which move along, the
zero-moment point moves by -(z_c / (z̈_c + g)) d̈ for a height z_c of the centre of mass, and seen from feet that stay by
d more (M. Vukobratovic, B. Borovac, "Zero-moment point: thirty five years of its life", Int. J. Humanoid Robotics 1(1),
2004): the problem is a quadratic programme in d. It is solved by the alternating direction method of multipliers
(S. Boyd et al., Foundations and Trends in Machine Learning 3(1), 2011), in which a frame's constraint is a projection
on a polygon. Frames before the window are fixed, so the shift begins without a jump of place or speed. The vertical
path is shifted before, by the same terms with |d|² for the floor in place of the slip, so that the ground is pressed
on, not pulled at.

Over feet that stay, a body falls away from a zero-moment point that is just kept inside, as an inverted pendulum does.
Of windows that end standing, the capture point x + ẋ/ω at the end is therefore kept inside as well, at the cost of
frames before (N. Scianca et al., "MPC for humanoid gait generation: stability and feasibility", IEEE Trans. Robotics
36(4), 2020: the boundedness condition). A body that walks keeps its mean velocity v after the window: x + (ẋ - v)/ω is
led to where that of people is beside the middle of their feet (`walking.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

from flexmotion.biomechanics.differentiation import HALF, second_derivative
from flexmotion.biomechanics.smoothing import CUTOFF, DIFFERENCES
from flexmotion.compiled import doubles
from flexmotion.sampling.balance_loops import Ends, Frames, Limits, brought, heights, places, shifted
from flexmotion.sampling.soles import DIRECTIONS, NOWHERE, OUTWARD
from flexmotion.sampling.walking import Walks
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Balance:
    """Weights of the problem; accelerations have the weight 1.

    Attributes:
        slip: a body that slips slower than this frequency [Hz] does so rather than accelerate.
        floor: the same of the height above the floor [Hz].
        network: weight of the accelerations of the model's path.
        ease: penalty factor of the method: of an acceleration that the ground cannot give, in one iteration.
        rounds: iterations.
        margin: distance that the zero-moment point keeps from the edge of the soles [m].
        standing_margin: the same of a body that stands: no foot slips for it.
        least: least vertical acceleration of the ground's force, relative to gravity.
        capture: weight of the capture point at the end, relative to that of a zero-moment point in one frame.
    """

    slip: float = 0.8
    floor: float = 1.5
    network: float = 0.3
    ease: float = 3.0
    rounds: int = 10
    margin: float = 0.025
    standing_margin: float = 0.05
    least: float = 0.15
    capture: float = 200.0


BALANCE = Balance()

STILL = replace(BALANCE, standing_margin=BALANCE.margin)
"""Of a body whose pelvis and legs are still: nothing but its arms and head accelerates it. People that are to nod stand
nearer to their toes than 5 cm, and were moved to and fro by 5 mm."""

LIGHT = 0.1
"""With less vertical force than this share of the body's weight a frame has no zero-moment point to speak of."""

RELAXED = 1.6
"""Over-relaxation of the method: 1.5 to 1.8 is usual (Boyd et al., 3.4.3)."""

FASTEST = 4.0
"""Greatest speed of the shift [m/s]: a request that no ground can satisfy moves the body no faster."""

MOSTLY = 0.5
"""A body stands on a region of which more than this share stays."""

CALM = 3
"""Frames over which the speed at the end of a window is measured."""

PROJECTIONS = 2
"""Half-planes that a point is brought behind, the farthest first, in one iteration."""

NOTHING = Ends(False, 0.0, CALM, 1.0, np.zeros(2), np.zeros(DIRECTIONS), 0.0)
"""Nothing is asked of the capture point."""

_NO_SHARES = np.zeros(0)


@dataclass(frozen=True)
class Needs:
    """What a motion needs of the ground, N frames of which the first are known.

    Attributes:
        known: number of frames that stay as they are.
        fps: frames per second.
        root: path of the root, (N, 3) [m].
        planned: accelerations of the model's own path, used from the second frame of the window to the last but one,
            (N, 3) [m/s²].
        force: on the whole body, over its mass, (N, 3) [m/s²].
        moment: about the world's origin, over the body's mass, (N, 3) [m²/s²].
        centre: of mass, (N, 3) [m].
    """

    known: int
    fps: float
    root: Float
    planned: Float
    force: Float
    moment: Float
    centre: Float

    def shifted(self, shift: Float) -> Needs:
        """The needs of the motion shifted by (N, 3) [m]."""
        own = doubles
        more = acceleration(shift, self.fps)
        root, force, moment, centre = shifted(
            own(shift), more, own(self.root), own(self.force), own(self.moment), own(self.centre)
        )
        return Needs(self.known, self.fps, root, self.planned, force, moment, centre)


def acceleration(shift: Float, fps: float) -> Float:
    """Second derivative of a shift, (N, K) [m] -> (N, K) [m/s²]; by a matrix that is made once for every length."""
    found: Float = _second(len(shift), fps) @ shift
    return found


def vertical_shift(needs: Needs, borne: Flags, settings: Balance = BALANCE) -> Float:
    """Shift of the height of every frame, (N,) [m]; zero in known frames.

    Args:
        needs: of the motion.
        borne: whether a foot is within reach of the floor, (N,); else nothing but gravity acts on the body.
        settings: weights.
    """
    terms = _terms(len(needs.root), needs.known, needs.fps, settings)
    start = terms.wanted(needs, slice(2, 3))
    return heights(
        terms.height_inverse @ start,
        terms.height_free @ start,
        needs.force[terms.rows, 2].copy(),
        terms.constrained,
        terms.height_gain,
        terms.height_answer,
        np.ascontiguousarray(borne[terms.rows]),
        settings.least * GRAVITY,
        needs.known,
        _limits(settings, needs.fps),
    )[:, 0]


def horizontal_shift(
    needs: Needs,
    bounds: Float,
    stays: Float | None = None,
    settings: Balance = BALANCE,
    *,
    stands: bool = False,
    walks: Walks | None = None,
) -> Float:
    """Shift of the place of every frame, (N, 2) [m]; zero in known frames.

    Args:
        needs: after the vertical shift.
        bounds: of the region under the soles, as of `Soles.bounds`, (N, 32) [m].
        stays: share of the region that stays where it is, (N,): of feet that legs bring back to where they are asked to
            be. None: all of it moves along.
        settings: weights.
        stands: whether the body is to stand at the end. Where most of the region stays then, its capture point is kept
            inside.
        walks: how it goes on over a region that stays. None: no place is asked of its capture point.
    """
    terms = _terms(len(needs.root), needs.known, needs.fps, settings)
    stands = stands and stays is not None and bool(stays[-2] > MOSTLY and bounds[-2, 0] > NOWHERE / 2)
    margin = settings.standing_margin if stands else settings.margin
    frames = Frames(needs.known, terms.rows.start, LIGHT * GRAVITY, NOWHERE / 2, margin, settings.ease, OUTWARD)
    ends = NOTHING
    if stands or walks is not None:
        frequency = float(np.sqrt(GRAVITY / needs.centre[-1, 2]))
        ends = Ends(
            asked=True,
            ahead=needs.fps / (CALM * frequency),
            calm=CALM,
            # The last frame has no zero-moment point of its own, nor a region that was judged.
            stays=1.0 if walks is not None or stays is None else float(stays[-2]),
            taken=NOTHING.taken if walks is None else walks.velocity / frequency,
            bounds=bounds[-2] - margin if walks is None else walks.place @ OUTWARD,
            weight=settings.capture * settings.ease * frequency**4,
        )
    start, limits, own = terms.wanted(needs, slice(2)), _limits(settings, needs.fps), doubles
    outside, free, base, moved, edge, given, hessian, right = places(
        own(needs.force),
        own(needs.moment),
        own(needs.centre),
        _NO_SHARES if stays is None else own(stays),
        own(bounds),
        terms.second,
        terms.place,
        start,
        terms.place_free @ start,
        frames,
        ends,
        limits,
    )
    if not outside:
        return free
    # Positive definite as the sum of squares that it is.
    _, solved, failed = dposv(hessian, right.T, overwrite_b=True)
    if failed:
        raise np.linalg.LinAlgError("the balance of a window has no solution: its motion is not finite")
    return brought(base, moved, edge, given, np.ascontiguousarray(solved.T), frames, limits)


def _limits(settings: Balance, fps: float) -> Limits:
    return Limits(RELAXED, settings.rounds, PROJECTIONS, FASTEST / fps)


@dataclass(frozen=True)
class _Terms:
    """Matrices that depend on the number of frames alone; N frames, M of them unknown.

    Attributes:
        rows: frames with a constraint: all whose accelerations the window changes, but the last.
        second: second derivative of a shift, (N, M).
        follow: gradient of the penalty of accelerations by those of the model's path, (M, N).
        stay: gradient of the same penalty, and of that of the jerk, by the root's path, (M, N).
        place: Hessian of the horizontal problem without constraints, (M, M), and its inverse `place_free`.
        height_free, height_inverse: inverse Hessians of the vertical problem without and with constraints, (M, M).
        constrained: `second` of the R frames of `rows`, (R, M).
        height_gain, height_answer: shift of the height by accelerations that the ground can give, (M, R), and
            accelerations by these, (R, R).
    """

    rows: slice
    second: Float
    follow: Float
    stay: Float
    place: Float
    place_free: Float
    height_free: Float
    height_inverse: Float
    constrained: Float
    height_gain: Float
    height_answer: Float

    def wanted(self, needs: Needs, axes: int | slice) -> Float:
        """Negative gradient of the objective at no shift, by one axis (M,) or several (M, K)."""
        found: Float = self.follow @ needs.planned[:, axes] - self.stay @ needs.root[:, axes]
        return found


@lru_cache(maxsize=32)
def _second(frames: int, fps: float) -> Float:
    """Matrix of the second derivative, (N, N)."""
    return second_derivative(np.eye(frames), fps)


@lru_cache(maxsize=8)
def _terms(frames: int, known: int, fps: float, settings: Balance) -> _Terms:
    unknown = frames - known
    whole = _second(frames, fps)
    second = np.ascontiguousarray(whole[:, known:])
    tracked = np.zeros(frames)
    tracked[known + 1 : -1] = settings.network
    order = len(DIFFERENCES) - 1
    third = sum(weight * np.eye(frames - order, frames, place) for place, weight in enumerate(DIFFERENCES)) * fps**order
    jerk = third[:, known:].T @ third / (2.0 * np.pi * CUTOFF) ** 2
    first = (np.eye(unknown) - np.eye(unknown, k=-1)) * fps
    follow = second.T * tracked
    stay = follow @ whole + jerk
    shared = stay[:, known:]
    place = shared + (2.0 * np.pi * settings.slip) ** 2 * first.T @ first
    height = shared + (2.0 * np.pi * settings.floor) ** 4 * np.eye(unknown)
    rows = slice(max(known - HALF, 0), frames - 1)
    constrained = second[rows]
    height_inverse = np.linalg.inv(height + settings.ease * constrained.T @ constrained)
    height_gain = settings.ease * height_inverse @ constrained.T
    return _Terms(
        rows=rows,
        second=second,
        follow=follow,
        stay=stay,
        place=place,
        place_free=np.linalg.inv(place),
        height_free=np.linalg.inv(height),
        height_inverse=height_inverse,
        constrained=constrained,
        height_gain=height_gain,
        height_answer=constrained @ height_gain,
    )
