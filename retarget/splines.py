"""`Spline`: cubic splines of several curves at once.

`scipy.interpolate` gives the same within rounding; checking its arguments takes longer than all of this.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgtsv

Float = NDArray[np.float64]


class Spline:
    """A cubic spline through points, with continuous second derivatives.

    Args:
        places: of the points, ascending, (K,); two at least.
        values: there, (K, C).
        natural: its ends are without curvature; else the third derivative is continuous at the points next to them
            ("not a knot"), which takes four points.
    """

    def __init__(self, places: Float, values: Float, *, natural: bool) -> None:
        self.places, self.values = places, values
        self._steps = np.diff(places)
        self._slopes = np.diff(values, axis=0) / self._steps[:, None]
        self._bends = self._solve(natural)

    def _solve(self, natural: bool) -> Float:
        """Second derivatives at the points, (K, C)."""
        h, bends = self._steps, np.zeros(self.values.shape)
        if len(h) < 2:
            return bends
        diagonal, below, above = 2.0 * (h[:-1] + h[1:]), h[1:-1].copy(), h[1:-1].copy()
        first, last = h[0] / h[1], h[-1] / h[-2]
        if not natural:
            # The outer ones are linear in the two next to them.
            diagonal[0] += h[0] * (1.0 + first)
            above[0] -= h[0] * first
            diagonal[-1] += h[-1] * (1.0 + last)
            below[-1] -= h[-1] * last
        right = 6.0 * np.diff(self._slopes, axis=0)
        # LAPACK takes no system of one equation.
        bends[1:-1] = right / diagonal[0] if len(right) == 1 else dgtsv(below, diagonal, above, right)[3]
        if not natural:
            bends[0] = bends[1] - first * (bends[2] - bends[1])
            bends[-1] = bends[-2] + last * (bends[-2] - bends[-3])
        return bends

    def at(self, places: Float) -> tuple[Float, Float, Float]:
        """Values, first and second derivatives at places between the first and the last point, (T,) -> (T, C) each."""
        low = np.clip(np.searchsorted(self.places, places, side="right") - 1, 0, len(self._steps) - 1)
        step = self._steps[low][:, None]
        away = (places - self.places[low])[:, None]
        bend = self._bends[low]
        growth = (self._bends[low + 1] - bend) / step
        slope = self._slopes[low] - step * (bend / 2.0 + growth * step / 6.0)
        curvature = bend + growth * away
        value = self.values[low] + away * (slope + away * (bend / 2.0 + growth * away / 6.0))
        return value, slope + away * (bend + growth * away / 2.0), curvature
