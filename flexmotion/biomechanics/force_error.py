"""Estimated standard error of the ground force on each foot.

Three sources are independent, so their squares add up:

- **Share.** In double support kinematics determine the sum of both feet's forces, hardly the share of each.
- **Force.** An error of accelerations, in proportion to the force.
- **Residual.** What the first pass did not explain, before the path is shifted, on the feet that carry load.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

FLAGGED = 0.1
"""A foot's force with a greater estimated error is flagged [body weights]."""

SHARE, FORCE, RESIDUAL = 0.25, 0.04, 1.0
"""Weight of each source."""


def force_error(forces: Float, residual: Float) -> Float:
    """Standard error of the force on left and right foot, (T, 2) [body weights].

    Args:
        forces: on both feet, (T, 2, 3) [body weights].
        residual: force that the first pass did not explain, (T, 3) [body weights].
    """
    size = np.linalg.norm(forces, axis=-1)
    total = np.maximum(size.sum(axis=1, keepdims=True), 1e-9)
    share = size / total
    split = SHARE * total * share * (1 - share)
    unexplained = RESIDUAL * np.linalg.norm(residual, axis=-1, keepdims=True) * np.maximum(share, 0.1)
    found: Float = np.sqrt(split**2 + (FORCE * size) ** 2 + unexplained**2)
    return found
