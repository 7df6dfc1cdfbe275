"""Random numbers that depend on their seed alone, not on earlier draws."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor


def normal(seed: tuple[int, ...], shape: tuple[int, ...]) -> Tensor:
    """Standard normal numbers."""
    return torch.from_numpy(np.random.default_rng(seed).standard_normal(shape, np.float32))


def uniform(seed: tuple[int, ...], shape: tuple[int, ...]) -> Tensor:
    """Uniform numbers in [0, 1)."""
    return torch.from_numpy(np.random.default_rng(seed).random(shape, np.float32))
