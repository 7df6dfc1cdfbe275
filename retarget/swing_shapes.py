"""Shapes of swings: how far a foot is on its way, and how high, so that the servos can swing it in the shortest time.

Both are cubic splines over the phase. Their control points and the duration are found by sequential linear programming:
what the swing asks of the servos is linear in small changes of them, and so is the height that the floor asks for. The
result depends on the robot alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import linprog

from flexmotion.retarget.swing_effort import SwingEffort
from flexmotion.spatial.transitions import minimum_jerk

Float = NDArray[np.float64]

_DEGREE, _PIECES = 3, 13
"""Of the splines; with seven pieces swings are 5 % longer."""
_FIRST_S, _LEAST_S = 0.5, 0.15
"""Duration with which the search begins, and the least [s]."""


@dataclass(frozen=True)
class _Search:
    """Linear programmes, and how far each may move control points and duration [s]: `decay` of the one before."""

    rounds: int
    trust: float
    decay: float
    trust_s: float


_WIDE, _NEAR = _Search(10, 0.08, 0.75, 0.25), _Search(5, 0.06, 0.65, 0.1)
"""From an even swing, and from the shape of a travel that is nearly the same."""
_ROOM = 1.08
"""Duration with which the second begins, over that of the shape that it begins with."""
_STEEPNESS = 0.7
"""1: a parabola over the way. Less: higher where the foot is about to land. The toes of a nominal OP3 strike 28 ms
early, and what was left of the way is lost: of its fastest walks it made .183 m/s with 1, .198 with .7 and .199 with
.5, four runs each; swings are 2 % longer."""
_DIFFERENCE = 1e-4
"""Step of the finite differences."""
_PENALTY = 20.0
"""Price of a broken constraint [s]."""
TOLERANCE = 0.02
"""By how much the best swing may pass the constraints."""


@dataclass(frozen=True)
class Basis:
    """Splines that begin and end at rest: control points of their middle, their ends are fixed.

    Args:
        phase: where they are evaluated, (R,) in [0, 1].

    Attributes:
        middle: of the free control points, (R, k).
        end: of those that are 1 where the spline ends at 1, (R,).
    """

    middle: Float
    end: Float

    @classmethod
    def at(cls, phase: Float) -> Basis:
        """Evaluate them at phases."""
        ends = np.zeros(_DEGREE), np.ones(_DEGREE)
        knots = np.concatenate([ends[0], np.linspace(0.0, 1.0, _PIECES + 1), ends[1]])
        values = BSpline.design_matrix(np.clip(phase, 0.0, 1.0), knots, _DEGREE).toarray()
        # Two points at an end are its position and speed.
        return cls(values[:, 2:-2], values[:, -2:].sum(axis=1))

    def progress(self, shape: Shape) -> Float:
        """Share of the way of a shape, (R,)."""
        found: Float = self.end + self.middle @ shape.progress
        return found

    def height(self, shape: Shape) -> Float:
        """Height of a shape over the clearance, (R,)."""
        found: Float = self.middle @ shape.height
        return found

    @property
    def free(self) -> int:
        """Number of free control points."""
        return self.middle.shape[1]


@dataclass(frozen=True)
class Shape:
    """Control points of progress and of height over clearance, (k,) each, and the duration of the swing [s]."""

    progress: Float
    height: Float
    seconds: float

    def points(self, longer: float) -> Float:
        """All control points and the duration, this many times as long, (2 k + 1,)."""
        return np.concatenate([self.progress, self.height, [longer * self.seconds]])


def between(one: Shape, other: Shape) -> Shape:
    """The mean of two shapes."""
    return Shape(*(0.5 * (a + b) for a, b in zip(vars(one).values(), vars(other).values(), strict=True)))


def floor_clearance(progress: Float) -> Float:
    """Height over the floor that a foot must have over its way, over the robot's clearance, (...)."""
    return np.maximum(4.0 * progress * (1.0 - progress), 0.0) ** _STEEPNESS


def fastest_shape(effort: SwingEffort, travel: Float, near: Shape | None = None) -> Shape | None:
    """The shape with the shortest swing; None where none was found that the servos can make.

    Args:
        effort: what swings ask of the robot's servos.
        travel: of the foot, (3,) [m, m, rad].
        near: that of a travel a little shorter or longer. The shape found from it is of its kind, so that shapes
            between the two are nearly as fast: there are several local optima.
    """
    basis, clearance = Basis.at(effort.phase), effort.gait.clearance
    k = basis.free
    search = _WIDE if near is None else _NEAR
    x = _even(basis, effort.phase) if near is None else near.points(_ROOM)
    best, shortest = None, np.inf
    for number in range(search.rounds):
        tried = np.concatenate([x[None], x + _DIFFERENCE * np.eye(len(x))])
        p, z = basis.end + tried[:, :k] @ basis.middle.T, tried[:, k:-1] @ basis.middle.T
        asked = effort.asked(p, clearance * z, np.broadcast_to(travel, (len(tried), 3)), tried[:, -1])
        asked = np.nan_to_num(asked.reshape(len(tried), -1), nan=9.0)
        # Each row: at most 0.
        values = np.hstack([asked - 1.0, -asked - 1.0, floor_clearance(p) - z, -z])
        excess = float(values[0].max())
        if excess < TOLERANCE and x[-1] < shortest:
            best, shortest = x, float(x[-1])
        close = values[0] > -1.0
        slopes = (values[1:, close] - values[0, close]).T / _DIFFERENCE
        trust = np.full(len(x), search.trust * search.decay**number)
        trust[-1] = search.trust_s * search.decay**number
        least = np.append(-trust, 0.0)
        least[len(x) - 1] = max(-trust[-1], _LEAST_S - x[-1])
        solved = linprog(
            np.concatenate([np.zeros(len(x) - 1), [1.0, _PENALTY]]),
            A_ub=np.column_stack([slopes, np.full(len(slopes), -1.0)]),
            b_ub=-values[0, close],
            bounds=list(zip(least.tolist(), [*trust.tolist(), np.inf], strict=True)),
        )
        if solved.x is None:
            break
        x = x + solved.x[:-1]
    return None if best is None else Shape(best[:k], best[k:-1], shortest)


def _even(basis: Basis, phase: Float) -> Float:
    """Control points and duration of an even swing with which a search begins, (2 k + 1,)."""
    first = minimum_jerk(phase)
    progress = np.linalg.lstsq(basis.middle, first - basis.end, rcond=None)[0]
    height = np.linalg.lstsq(basis.middle, 1.2 * floor_clearance(first), rcond=None)[0]
    return np.concatenate([progress, height, [_FIRST_S]])
