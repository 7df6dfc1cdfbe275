"""Motion sampled window after window, each from the last one, with conditions that change on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.concatenate import concatenate
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition

SEEDS = 1000
"""Seeds of a roll-out: more than it has windows."""


class MotionSampler(Protocol):
    """The part of `flexmotion.sampling.sampler.Sampler` that a roll-out needs."""

    @property
    def fps(self) -> float:
        """Frames per second."""
        ...

    @property
    def remembers(self) -> int:
        """Frames of a history that the next window depends on."""
        ...

    def standing(self) -> Motion:
        """A standing history."""
        ...

    def sample(self, history: Motion, condition: Condition, seed: int) -> Motion:
        """The window after a history."""
        ...


@dataclass(frozen=True)
class Cue:
    """A condition from a moment on [s]."""

    at_s: float
    condition: Condition


@dataclass(frozen=True)
class RollOut:
    """Motion that begins from standing.

    Attributes:
        motion: without the standing history.
        joins: first frames of its windows but the first, (K,).
        cued: whether the condition changes at that join, (K,).
    """

    motion: Motion
    joins: NDArray[np.intp]
    cued: NDArray[np.bool_]


def always(text: str | None = None, velocity: tuple[float, float, float] | None = None) -> list[Cue]:
    """One condition from beginning to end."""
    return [Cue(0.0, Condition(text, velocity))]


def roll_out(sampler: MotionSampler, cues: Sequence[Cue], seconds: float, seed: int) -> RollOut:
    """Motion from standing; a window that reaches past a cue is cut there, as in the live system.

    Args:
        sampler: of windows.
        cues: in the order of their times, the first at 0.
        seconds: length of the motion [s].
        seed: of all noise.

    Raises:
        ValueError: sampled motion is not finite, or cues are out of order.
    """
    starts = [round(cue.at_s * sampler.fps) for cue in cues]
    if not starts or starts[0] != 0 or starts != sorted(set(starts)):
        raise ValueError(f"cues begin at frames {starts}, expected growing numbers from 0")
    total = round(seconds * sampler.fps)
    past, parts, joins, cued = sampler.standing(), [], [], []
    done = number = 0
    while done < total:
        cue = int(np.searchsorted(starts, done, side="right")) - 1
        end = min([total, *starts[cue + 1 : cue + 2]])
        found = sampler.sample(past, cues[cue].condition, seed * SEEDS + number)[: end - done]
        if number:
            joins.append(done)
            cued.append(done == starts[cue])
        parts.append(found)
        past = concatenate([past, found])[-sampler.remembers :]
        done += len(found)
        number += 1
    return RollOut(concatenate(parts), np.array(joins, np.intp), np.array(cued, np.bool_))
