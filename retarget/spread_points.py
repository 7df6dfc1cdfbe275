"""Points spread evenly over a unit cube: the sequences of Halton and of Sobol, not scrambled.

Equal to those of `scipy.stats.qmc`, whose import takes longer than the rest of a plan's modules together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_BITS = 30
"""Bits of a coordinate of Sobol's sequence."""
_RECURRENCES = (
    (1, 0, (1,)),
    (2, 1, (1, 3)),
    (3, 1, (1, 3, 1)),
    (3, 2, (1, 1, 1)),
    (4, 1, (1, 1, 3, 3)),
    (4, 4, (1, 3, 5, 13)),
    (5, 2, (1, 1, 5, 5, 17)),
    (5, 4, (1, 1, 5, 5, 5)),
    (5, 7, (1, 1, 7, 11, 19)),
    (5, 11, (1, 1, 5, 1, 1)),
    (5, 13, (1, 1, 1, 3, 11)),
)
"""Degree and coefficients of the primitive polynomial, and first direction numbers, of each dimension but the first
(Joe and Kuo, *Constructing Sobol sequences with better two-dimensional projections*, SIAM J. Sci. Comput. 30, 2008)."""
MOST_DIMENSIONS = 1 + len(_RECURRENCES)


def halton(count: int, dimensions: int) -> Float:
    """The first points of Halton's sequence, (count, dimensions): numbers mirrored at the point, in prime bases."""
    return np.stack([_mirrored(count, base) for base in _primes(dimensions)], axis=1)


def sobol(bits: int, dimensions: int) -> Float:
    """The first 2^bits points of Sobol's sequence, (2^bits, dimensions), in the order of Gray code.

    Raises:
        ValueError: more than `MOST_DIMENSIONS`.
    """
    if dimensions > MOST_DIMENSIONS:
        raise ValueError(f"{dimensions} dimensions; the table of Sobol's sequence has {MOST_DIMENSIONS}")
    directions = np.array([_directions(dimension) for dimension in range(dimensions)]).T
    points = np.zeros((2**bits, dimensions), np.int64)
    for index in range(1, 2**bits):
        lowest_zero = (~(index - 1) & index).bit_length() - 1
        points[index] = points[index - 1] ^ directions[lowest_zero]
    return points / 2.0**_BITS


def _primes(count: int) -> list[int]:
    """The first prime numbers."""
    found: list[int] = []
    number = 2
    while len(found) < count:
        if all(number % prime for prime in found):
            found.append(number)
        number += 1
    return found


def _mirrored(count: int, base: int) -> Float:
    """0, 1, 2 ... with their digits in `base` mirrored at the point, (count,)."""
    left, mirrored, place = np.arange(count), np.zeros(count), 1.0
    while left.any():
        place /= base
        mirrored += left % base * place
        left = left // base
    return mirrored


def _directions(dimension: int) -> list[int]:
    """Direction numbers of one dimension, `_BITS`, as whole numbers of 2^-`_BITS`."""
    if not dimension:
        return [1 << (_BITS - 1 - k) for k in range(_BITS)]
    degree, coefficients, first = _RECURRENCES[dimension - 1]
    found = [number << (_BITS - 1 - k) for k, number in enumerate(first)]
    for k in range(degree, _BITS):
        value = found[k - degree] ^ (found[k - degree] >> degree)
        for j in range(1, degree):
            if coefficients >> (degree - 1 - j) & 1:
                value ^= found[k - j]
        found.append(value)
    return found
