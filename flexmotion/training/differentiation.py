"""Derivatives along the frames of a batch, as `biomechanics.differentiation` computes them in NumPy."""

from __future__ import annotations

from torch import Tensor

from flexmotion.biomechanics.differentiation import HALF


def of_neighbours(signal: Tensor, weights: list[float]) -> Tensor:
    """Weighted sum of neighbours along the frames, (N, T, ...) -> (N, T - 2 HALF, ...)."""
    frames = signal.shape[1] - 2 * HALF
    total = weights[0] * signal[:, :frames]
    for at, weight in enumerate(weights[1:], 1):
        if weight:
            total = total + weight * signal[:, at : at + frames]
    return total
