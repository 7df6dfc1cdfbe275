"""Two feet that stand still, for tests of what keeps them there."""

from __future__ import annotations

import numpy as np

FPS, FRAMES = 30.0, 32
LOADED = np.ones((FRAMES, 2), np.bool_)


def standing() -> np.ndarray:
    """Heel and toe of two feet that stand still, (1 + W, 2, 2, 3) [m]."""
    feet = np.zeros((1 + FRAMES, 2, 2, 3))
    feet[:, 0, :, 1], feet[:, 1, :, 1], feet[:, :, 1, 0] = 0.1, -0.1, 0.2
    return feet
