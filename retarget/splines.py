"""Cubic splines through values at ascending places, with one end condition or another.

`scipy.interpolate` gives the same within rounding; making and evaluating one of its splines takes .2 to .5 ms, and
every plan makes two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgtsv

Float = NDArray[np.float64]


class Points(NamedTuple):
    """Values of a spline and their first and second derivatives, (T, C) each."""

    value: Float
    first: Float
    second: Float


class Spline:
    """The twice differentiable path of cubics through values.

    Args:
        places: ascending, (N,); two at least, four where the ends are not natural.
        values: (N, C).
        natural: the second derivative is 0 at both ends; else the third is continuous at the second place from either
            end ("not a knot"), which follows a smooth path more closely.

    Raises:
        ValueError: fewer than two places, or four where the ends are not natural.
    """

    def __init__(self, places: Float, values: Float, *, natural: bool) -> None:
        if len(places) < (2 if natural else 4):
            raise ValueError(f"a spline through {len(places)} places, expected {2 if natural else 4} at least")
        width = places[1:] - places[:-1]
        across = width[:, None]
        slope = (values[1:] - values[:-1]) / across
        bends = _second_derivatives(width, slope, natural=natural)
        half, sixth = 0.5 * bends[:-1], (bends[1:] - bends[:-1]) / 6.0
        self._places = places
        # Of each cubic by the distance from its begin, from the constant on, (4, N - 1, C).
        self._cubics = np.array([values[:-1], slope - across * (half + sixth), half, sixth / across])

    def at(self, places: Float) -> Points:
        """The spline at other places (T,), none of them beyond its ends by more than rounding."""
        cubic = np.minimum(np.maximum(self._places.searchsorted(places, side="right"), 1), len(self._places) - 1) - 1
        x = (places - self._places[cubic])[:, None]
        a, b, c, d = self._cubics.take(cubic, axis=1)
        d_x = d * x
        return Points(a + x * (b + x * (c + d_x)), b + x * (2.0 * c + 3.0 * d_x), 2.0 * c + 6.0 * d_x)


def _second_derivatives(width: Float, slope: Float, *, natural: bool) -> Float:
    """Second derivatives at the places, (N, C): the tridiagonal equations of continuous first derivatives there.

    Args:
        width: between the places, (N - 1,); slope: mean first derivative there, (N - 1, C).
    """
    bends = np.zeros((len(width) + 1, slope.shape[1]))
    if len(width) < 2:
        return bends
    diagonal, beside = 2.0 * (width[:-1] + width[1:]), width[1:-1]
    before, after = beside.copy(), beside.copy()
    if not natural:
        # A bend at an end lies on the line through the two beside it.
        near, far = width[0] / width[1], width[-1] / width[-2]
        diagonal[0] += width[0] * (1.0 + near)
        diagonal[-1] += width[-1] * (1.0 + far)
        after[0] -= width[0] * near
        before[-1] -= width[-1] * far
    right = 6.0 * (slope[1:] - slope[:-1])
    bends[1:-1] = dgtsv(before, diagonal, after, right)[3] if len(right) > 1 else right / diagonal
    if not natural:
        bends[0] = bends[1] + near * (bends[1] - bends[2])
        bends[-1] = bends[-2] + far * (bends[-2] - bends[-3])
    return bends
