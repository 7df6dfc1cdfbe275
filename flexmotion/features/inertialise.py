"""Continuous joins of windows: jumps of pose and speed at a join decay within the window.

Inertialisation (Bollo, GDC 2018) by a critically damped spring (Holden, "Spring-It-On", 2020): for jumps x of the pose
and v of its speed at the last known frame the window is shifted by

    (x + (v + y x) t) exp(-y t),    y = 2 ln 2 / half-life
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.layout import Layout
from flexmotion.spatial.transitions import decaying

Float32 = NDArray[np.float32]

HALF_LIFE_S = 0.15
"""Long enough that the jerk at joins hardly exceeds that within windows, short relative to a step."""


def inertialised(frames: Float32, history: Float32, layout: Layout) -> Float32:
    """The window, shifted so that pose and speed continue those of a history.

    Of the root's velocities, whose sum is the path, only the jump is removed. Velocities of points, forces and other
    blocks are unchanged.

    Args:
        frames: features of the window, not normalised, (W, layout.size), W >= 2.
        history: features of the frames before, likewise, (H, layout.size); with fewer than two the speed is unknown
            and the window is unchanged.
        layout: of both.
    """
    if len(history) < 2:
        return frames
    blocks = layout.blocks
    root = blocks["root"].start
    # Height, rotations and positions follow each other: a slice, since lists of columns copy.
    pose = slice(root + 3, blocks["positions"].stop)
    rate = 2.0 * np.log(2.0) / (HALF_LIFE_S * layout.fps)
    time = np.arange(1, len(frames) + 1)[:, None]
    moved = frames.copy()

    # The frame before the window, extrapolated from the window, against the last known one.
    before = 2.0 * frames[0, pose] - frames[1, pose]
    jump = history[-1, pose] - before
    speed = (history[-1, pose] - history[-2, pose]) - (frames[1, pose] - frames[0, pose])
    moved[:, pose] += decaying(jump, speed, rate, time)

    travel = slice(root, root + 3)
    fading = (1.0 + rate * (time - 1)) * np.exp(-rate * (time - 1))
    moved[:, travel] += fading * (history[-1, travel] - frames[0, travel])
    return moved
