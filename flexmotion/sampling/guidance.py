"""`guided`: the estimate of a network that has no guidance as an input."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


def guided(found: Float32, scale: float, manner_scale: float) -> Float32:
    """The estimate under guidance, (1, L); see `training.distillation_task.guided`.

    Args:
        found: estimates with the request, in any manner (of networks with a manner), without a request, (2 or 3, L).
        scale, manner_scale: of the guidance.
    """
    asked = found[-1:] + np.float32(scale) * (found[-2:-1] - found[-1:])
    return asked if len(found) == 2 else asked + np.float32(manner_scale) * (found[:1] - found[1:2])
