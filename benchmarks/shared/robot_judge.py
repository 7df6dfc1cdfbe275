"""`Done`: how much of what the human does the robot did, and whether that makes the kind of motion.

The human's excursion from the stand and the robot's are compared as vectors over all times and channels of a run, once
the robot's lag is taken off: how much of the human's the robot made, and how much what it made is like it. Gestures
that are no poses have strokes, such as those of a wave or a nod. They are what changes within a second, and are
compared by themselves as well: raised hands do not wave.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from benchmarks.shared.robot_motion import SAMPLED_HZ, Part
from flexmotion.text.phrases import is_pose, limbs

Float = NDArray[np.float64]

LEAST, STROKES_LEAST = 0.5, 0.4
"""Share of the human's excursion, and of its strokes, that the robot makes at least."""
LIKE, STROKES_LIKE = 0.72, 0.45
"""Least cosine between the human's excursion and the robot's: an arm that goes up instead of aside has .71; between
their strokes, which the robot's servos, and what keeps its arms off its body, change more.

OP3 makes .59 and more of every kind that its joints allow, at cosines from .74 (a shrug; else .82), strokes .49 and
more at .53, and of a tilt of the head, for which it has no joint, .09 at most, at .2 (seeds 0, 1, 1000 to 1004)."""
LAG_S = 0.4
"""Longest lag that is taken off [s]."""
STROKE_S = 1.0
"""What changes within this time is a stroke [s]."""


@dataclass(frozen=True)
class Done:
    """How a robot made one part.

    Attributes:
        share, like: of the excursion: the robot's along the human's, over the human's; the cosine between them.
        strokes, strokes_like: likewise of what changes within `STROKE_S`; None: of no account.
    """

    share: float
    like: float
    strokes: float | None
    strokes_like: float | None

    @property
    def makes(self) -> bool:
        """Whether it did what makes the kind of motion."""
        if self.share < LEAST or self.like < LIKE:
            return False
        if self.strokes is None or self.strokes_like is None:
            return True
        return self.strokes >= STROKES_LEAST and self.strokes_like >= STROKES_LIKE

    @classmethod
    def of(cls, part: Part, *, has_strokes: bool) -> Done:
        """Measure a part. `has_strokes`: whether they are compared."""
        if not has_strokes:
            return cls(*_compared(part), None, None)
        return cls(*_compared(part), *_compared(Part(_changing(part.human), _changing(part.robot))))


def deciding(kind: str, parts: Mapping[str, Part]) -> Done:
    """How the robot made the part that decides whether it did a kind of motion.

    A walked turn is judged by its turn or its way, whichever is worse. A kind that the legs make is judged by the legs:
    a crouch bends them, and lowers the head too. Any other kind is judged by the part that the robot made best: one
    part of an answer, or of a dance, is enough.
    """
    has_strokes = not is_pose(kind) and not {"way", "turn"} & set(parts)
    made = {name: Done.of(part, has_strokes=has_strokes) for name, part in parts.items()}
    if "turn" in made:
        return min(made.values(), key=lambda one: (one.makes, one.share))
    if "leg" in made and "leg" in (limbs(kind) or ()):
        return made["leg"]
    return max(made.values(), key=lambda one: (one.makes, one.share))


def _compared(part: Part) -> tuple[float, float]:
    """The share and the cosine, at the lag at which the cosine is greatest."""
    lags = range(min(round(LAG_S * SAMPLED_HZ), len(part.human) - 2) + 1)
    found = [_at_lag(part.human[: len(part.human) - lag], part.robot[lag:]) for lag in lags]
    return max(found, key=lambda one: one[1])


def _at_lag(human: Float, robot: Float) -> tuple[float, float]:
    along, own, made = float((human * robot).sum()), float((human**2).sum()), float((robot**2).sum())
    return (along / own if own else 0.0), (along / np.sqrt(own * made) if own and made else 0.0)


def _changing(values: Float) -> Float:
    """Values without their mean over `STROKE_S` around each time, (T, C)."""
    return np.asarray(values - uniform_filter1d(values, round(STROKE_S * SAMPLED_HZ), axis=0, mode="nearest"))
