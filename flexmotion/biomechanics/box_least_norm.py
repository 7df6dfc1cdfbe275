"""Least-norm solution of a few linear equations in many bounded unknowns, by the dual problem.

    min  ½ |x|² + ½ weight |b - A x|²     lower <= x <= upper

The minimiser is x = clip(Aᵀ p, lower, upper) with p = weight (b - A x). These equations, one per row of A, are
piecewise linear and monotone in p; a safeguarded Newton iteration solves them. For A of 5 x 40 or 3 x 210 this takes a
tenth of the time of a general solver, which factors a matrix of the size of x.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

ITERATIONS = 60


def box_least_norm(
    matrix: Float, target: Float, lower: Float, upper: Float, start: Float, weight: float = 10.0
) -> tuple[Float, Float]:
    """The solution x (N,) and the multipliers p (M,), a start for the next, similar problem.

    Args:
        matrix: A, (M, N), with few rows.
        target: b, (M,).
        lower, upper: bounds, (N,).
        start: initial multipliers, (M,).
        weight: of the error of the equations, relative to the norm.
    """
    prices = start
    free, solution, slope = _evaluate(matrix, target, lower, upper, prices, weight)
    for _ in range(ITERATIONS):
        size = np.abs(slope).max()
        if size < 1e-7 * (1.0 + np.abs(target).max()):
            break
        hessian = (matrix * free) @ matrix.T
        hessian[np.diag_indices(len(hessian))] += 1.0 / weight
        step = np.linalg.solve(hessian, slope)
        value = _dual(target, solution, prices, matrix, weight)
        length = 1.0
        # The dual function is concave; a step without sufficient increase is halved (Armijo).
        while True:
            trial = prices + length * step
            free, solution, slope = _evaluate(matrix, target, lower, upper, trial, weight)
            if _dual(target, solution, trial, matrix, weight) >= value - 1e-12 * abs(value) or length < 1e-6:
                break
            length /= 2
        prices = trial
    return solution, prices


def _evaluate(
    matrix: Float, target: Float, lower: Float, upper: Float, prices: Float, weight: float
) -> tuple[NDArray[np.bool_], Float, Float]:
    """Flags of unknowns inside their bounds, the unknowns, and the gradient of the dual function."""
    unbounded = prices @ matrix
    solution = np.minimum(np.maximum(unbounded, lower), upper)
    slope = target - matrix @ solution - prices / weight
    return unbounded == solution, solution, slope


def _dual(target: Float, solution: Float, prices: Float, matrix: Float, weight: float) -> float:
    """The dual function: least value of the Lagrangian over the box."""
    return float(solution @ solution / 2 - prices @ (matrix @ solution - target) - prices @ prices / (2 * weight))
