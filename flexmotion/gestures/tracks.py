"""Tracks of a gesture over time: strokes of minimum jerk between poses, over the base's own motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.spatial.transitions import minimum_jerk

Float = NDArray[np.float64]

WAVES = 4
RATES = (0.15, 0.8)
"""Number and frequencies of the sines of `unrest` [Hz]."""


@dataclass(frozen=True)
class Stroke:
    """A stroke from `start` to `end` [s]; what it reaches is held until the next one."""

    start: float
    end: float


def shares(times: Float, strokes: Sequence[Stroke]) -> tuple[NDArray[np.intp], Float]:
    """Stroke of every time and the share of its way that is done.

    Args:
        times: (T,) [s].
        strokes: in their order.

    Returns:
        Index of the newest stroke that has begun, -1 before the first, (T,); share from 0 to 1, (T,).
    """
    starts = np.array([stroke.start for stroke in strokes])
    ends = np.array([stroke.end for stroke in strokes])
    at = np.searchsorted(starts, times, side="right") - 1
    safe = np.maximum(at, 0)
    done = minimum_jerk((times - starts[safe]) / (ends - starts)[safe])
    return at, np.where(at < 0, 0.0, done)


def values(times: Float, strokes: Sequence[Stroke], reached: Sequence[Float | None], base: Float) -> Float:
    """A track of numbers, (T, n).

    Args:
        times: (T,) [s].
        strokes: in their order.
        reached: values that each stroke reaches, (n,); None for the base's.
        base: values of the base, (T, n).
    """
    at, done = shares(times, strokes)
    before, after = base.copy(), base.copy()
    for number, value in enumerate(reached):
        if value is not None:
            after[at == number] = value
            before[at == number + 1] = value
    result: Float = before + done[:, None] * (after - before)
    return result


def rotations(
    times: Float, strokes: Sequence[Stroke], reached: Sequence[Rotation | None], base: Rotation
) -> tuple[Rotation, Float]:
    """A track of rotations along the shortest arcs, and how far each time is from the base (0 to 1), (T,)."""
    at, done = shares(times, strokes)
    before, after = base.as_quat(), base.as_quat()
    away = np.zeros((2, len(times)))
    for number, value in enumerate(reached):
        if value is not None:
            after[at == number], away[1, at == number] = value.as_quat(), 1.0
            before[at == number + 1], away[0, at == number + 1] = value.as_quat(), 1.0
    start = Rotation.from_quat(before)
    arc = (start.inv() * Rotation.from_quat(after)).as_rotvec()
    return start * Rotation.from_rotvec(done[:, None] * arc), away[0] + done * (away[1] - away[0])


def unrest(times: Float, size: float, count: int, rng: np.random.Generator) -> Float:
    """Slow, smooth noise of a held pose: sums of sines with a standard deviation of `size`, (T, count)."""
    rates = 2.0 * np.pi * rng.uniform(*RATES, (WAVES, count))
    phases = rng.uniform(0.0, 2.0 * np.pi, (WAVES, count))
    waves = np.sin(times[:, None, None] * rates + phases).sum(axis=1)
    result: Float = size * np.sqrt(2.0 / WAVES) * waves
    return result
