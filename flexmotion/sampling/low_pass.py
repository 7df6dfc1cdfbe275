"""`continued`: a window low-passed so that it continues the frames before it.

The smoothing spline of `biomechanics.smoothing`, with the frames before the window as they are: of all windows that
follow them, the one that minimises

    Σ |x - y|²  +  penalty Σ |D³ x|²,    D³: third differences, those across the join included

for a window y. It has no delay, and needs no frame behind the window. The solution is linear in y and in the last three
frames before it; its matrices depend on the number of frames alone.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.smoothing import CUTOFF, DIFFERENCES
from flexmotion.features.layout import Layout

Float = NDArray[np.float64]

ORDER = len(DIFFERENCES) - 1

SLOW_CUTOFF = 2.0
"""Cut-off of windows in which a pose is held, and of squats and crouches [Hz]. A sampled pose trembles: hands jerk by
15 m/s³ where those of people jerk by .5; with 2 Hz 6, with 1 Hz no less, and with .5 Hz windows do not follow each
other smoothly. Squats jerk by 20, with 2 Hz by 9, clips by 2. All points of the body: docs/decisions.md."""


def continued(window: NDArray, before: NDArray, fps: float, cutoff: float) -> Float:
    """The window, low-passed.

    Args:
        window: signals, (T, ...).
        before: the same signals in the frames before it, at least one, (K, ...).
        fps: frames per second.
        cutoff: frequency at which half of a signal is left [Hz]; from half of `fps` on nothing is removed.
    """
    if cutoff >= fps / 2 or not len(window):
        return np.asarray(window, np.float64)
    last = before[max(0, len(before) - ORDER) :]
    own, known = _operators(len(window), len(last), fps, cutoff)
    found: Float = own @ window.reshape(len(window), -1) + known @ last.reshape(len(last), -1)
    return found.reshape(window.shape)


def steadied(
    frames: NDArray[np.float32], history: NDArray[np.float32], layout: Layout, cutoff: float = CUTOFF
) -> NDArray[np.float32]:
    """Features of a window with rotations and turning low-passed, (W, layout.size).

    The data contain nothing above their cut-off; a decoder's noise there is an acceleration of several m/s².

    Args:
        frames: features of the window, not normalised, (W, layout.size).
        history: features of the frames before, likewise, (H, layout.size); without any the window is unchanged.
        layout: of both.
        cutoff: that of the data, or a lower one [Hz].
    """
    if not len(history):
        return frames
    moved = frames.copy()
    turning = layout.blocks["root"].start + 2
    for columns in (layout.blocks["rotations"], slice(turning, turning + 1)):
        moved[:, columns] = continued(frames[:, columns], history[:, columns], layout.fps, cutoff)
    return moved


@lru_cache(maxsize=8)
def _operators(frames: int, known: int, fps: float, cutoff: float) -> tuple[Float, Float]:
    """Matrices of the solution: of the window (T, T), and of the known frames before it (T, K)."""
    total = frames + known
    third = sum(weight * np.eye(total - ORDER, total, offset) for offset, weight in enumerate(DIFFERENCES))
    penalty = (2.0 * np.sin(np.pi * cutoff / fps)) ** (-2 * ORDER)
    own, before = third[:, known:], third[:, :known]
    normal = np.eye(frames) + penalty * own.T @ own
    return np.linalg.inv(normal), -np.linalg.solve(normal, penalty * own.T @ before)
