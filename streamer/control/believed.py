"""`Believed`: sensor values within their range and without single jumps. `Suspicion`: how often they were not."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.masks import every, some

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

_FORGIVEN = 0.1
"""Wrong readings that one good reading makes up for: a sensor that is wrong more often than one time in ten becomes a
fault, one that is wrong one time in a hundred does not."""
_MOST = 4
"""Highest level, over the patience: above it, so that a sensor that goes on is a fault however large the patience is,
and bounded: one that was wrong for minutes is believed again after 30 times as many good readings as the patience."""

_RETURNS = 4
"""Readings in which the way back from a sudden step is believed: as many as an impact explains, and one."""
_SUDDEN = 0.5
"""Share of the greatest change that is believed at once from which on a change is sudden."""


class Suspicion:
    """Counts wrong readings of m sensors; good ones in between count against them.

    Args:
        m: number of sensors.
        patience: level above which a sensor counts as one that goes on, `max_stale_reads` of the robot file.

    Attributes:
        level: wrong readings in a row, reduced by good ones, (m,).
        raised: whether a level is above 0.
        total: all wrong readings so far.
    """

    def __init__(self, m: int, patience: int) -> None:
        self.level = np.zeros(m)
        self.total, self.raised = 0, False
        self._most = float(_MOST * patience)

    def reset(self) -> None:
        """Forget the level; the total stays."""
        self.level.fill(0.0)
        self.raised = False

    def note(self, wrong: Bool, asked: Bool) -> None:
        """Take which sensors that were asked gave a wrong reading, (m,) each."""
        if some(wrong):
            self.total += int(np.count_nonzero(wrong & asked))
        elif not self.raised:
            return
        self.level[asked & wrong] += 1.0
        np.minimum(self.level, self._most, out=self.level)
        good = asked & ~wrong
        self.level[good] = np.maximum(self.level[good] - _FORGIVEN, 0.0)
        self.raised = bool(self.level.any())


class Believed:
    """The last m values that can be.

    A value outside its range is never believed. A step is believed once it is repeated. A sudden one that was believed
    may have been wrong all the same, and so may the next: for some readings the way back is believed too.

    Args:
        m: number of values.
        lowest, highest: the range, (m,).
        step: greatest change that is believed at once, of all or of each, (m,).
        agreeing: readings in a row that must agree on a larger one; None: it is never believed.

    Attributes:
        value: (m,); NaN before the first.
    """

    def __init__(
        self, m: int, lowest: Float, highest: Float, *, step: Float | float = math.inf, agreeing: int | None = 2
    ) -> None:
        self.value = np.full(m, np.nan)
        self._lowest, self._highest, self._step, self._agreeing = lowest, highest, step, agreeing
        self._bounded = bool(np.isfinite(step).all())
        self._candidate, self._repeats = np.full(m, np.nan), np.zeros(m, np.int64)
        self._none = np.zeros(m, np.bool_)
        self._before, self._returns = np.full(m, np.nan), 0  # values before a sudden step, and readings left

    def forget(self) -> None:
        """The next values are believed if they are in their range."""
        self.value.fill(np.nan)
        self._candidate.fill(np.nan)
        self._repeats.fill(0)
        self._returns = 0

    def take(self, values: Float, widened: float = 1.0, explained: Float | float = 0.0) -> Bool:
        """Replace the values that are not believed by the last believed ones, in place; which they were, (m,).

        The result must not be changed. NaN (unknown) is left as it is.

        Args:
            widened: multiplies the step that is believed at once.
            explained: is added to it.
        """
        if not self._returns and self._usual(values, widened):
            np.copyto(self.value, values)
            return self._none
        with np.errstate(invalid="ignore"):
            outside, step = (values < self._lowest) | (values > self._highest), widened * self._step
            away = np.abs(values - self.value)
            wrong = outside | (away > step + explained)
            if self._returns:
                self._returns -= 1
                wrong &= outside | (np.abs(values - self._before) > step)
            # A second one does not hide the way back to before the first, unless it is larger than either may be.
            if (~wrong & (away > (step if self._returns else _SUDDEN * step))).any():
                np.copyto(self._before, self.value)
                self._returns = _RETURNS
            if wrong.any() and self._agreeing is not None:
                again = wrong & ~outside & (np.abs(values - self._candidate) <= self._step)
                self._repeats = np.where(again, self._repeats + 1, 1)
                np.copyto(self._candidate, values)
                wrong &= ~(again & (self._repeats >= self._agreeing))
            elif self._repeats.any():
                self._candidate.fill(np.nan)
                self._repeats.fill(0)
        np.copyto(self.value, values, where=~wrong & ~np.isnan(values))
        np.copyto(values, self.value, where=wrong & ~np.isnan(self.value))
        return wrong

    def _usual(self, values: Float, widened: float) -> bool:
        """Whether all values are known, inside the range and near the last ones: none is sudden or being repeated."""
        inside = every((values >= self._lowest) & (values <= self._highest))
        if not inside or some(self._repeats):
            return False
        return not self._bounded or every(np.abs(values - self.value) <= _SUDDEN * widened * self._step)
