"""Motion made by a bundle window after window, each on from the last, with conditions that change on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.concatenate import concatenate
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition

ROOMY = 1000
"""Seeds between two roll-outs: more than a roll-out has windows."""


class MakesMotion(Protocol):
    """What a roll-out needs of `flexmotion.sampling.sampler.Sampler`."""

    @property
    def fps(self) -> float:
        """Frames per second."""
        ...

    @property
    def remembers(self) -> int:
        """Frames of a history that tell all."""
        ...

    def standing(self) -> Motion:
        """To begin with."""
        ...

    def sample(self, history: Motion, condition: Condition, seed: int) -> Motion:
        """The frames after a history."""
        ...


@dataclass(frozen=True)
class Cue:
    """From a moment on [s], what is asked for."""

    at_s: float
    condition: Condition


@dataclass(frozen=True)
class RollOut:
    """Motion on from standing.

    Attributes:
        motion: without the standing that it began from.
        joins: first frames of its windows but the first, (K,).
        cued: whether something else is asked for from that window on, (K,).
    """

    motion: Motion
    joins: NDArray[np.intp]
    cued: NDArray[np.bool_]


def always(text: str | None = None, velocity: tuple[float, float, float] | None = None) -> list[Cue]:
    """One thing asked for from beginning to end."""
    return [Cue(0.0, Condition(text, velocity))]


def roll_out(sampler: MakesMotion, cues: Sequence[Cue], seconds: float, seed: int) -> RollOut:
    """Motion from standing; a window that reaches past a cue is cut there, as the live system does.

    Args:
        sampler: of a bundle.
        cues: in the order of their time, the first at 0.
        seconds: how long.
        seed: of all noise.

    Raises:
        ValueError: what the model made is not finite, or cues are out of order.
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
        found = sampler.sample(past, cues[cue].condition, seed * ROOMY + number)[: end - done]
        if number:
            joins.append(done)
            cued.append(done == starts[cue])
        parts.append(found)
        past = concatenate([past, found])[-sampler.remembers :]
        done += len(found)
        number += 1
    return RollOut(concatenate(parts), np.array(joins, np.intp), np.array(cued, np.bool_))
