"""How often something that swings turns back: by what a wave is known, the human's and the robot's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def reversals(signal: NDArray[np.float64], reach: float) -> int:
    """How often a signal turns back by more than `reach`."""
    count, direction, extreme = 0, 0, signal[0]
    for value in signal[1:]:
        if direction >= 0 and value < extreme - reach:
            count, direction, extreme = count + (direction > 0), -1, value
        elif direction <= 0 and value > extreme + reach:
            count, direction, extreme = count + (direction < 0), 1, value
        elif (direction >= 0 and value > extreme) or (direction <= 0 and value < extreme):
            extreme = value
    return count
