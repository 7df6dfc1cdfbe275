"""Windows that take over without a jerk: what pose and speed would jump at a join dies away in the window.

Inertialisation (Bollo, GDC 2018) by a critically damped spring (Holden, "Spring-It-On", 2020): with the jump x of the
pose and v of its speed at the last known frame, the window is moved by

    (x + (v + y x) t) exp(-y t),    y = 2 ln 2 / half-life
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.layout import Layout

Float32 = NDArray[np.float32]

HALF_LIFE_S = 0.15
"""Long enough that the jerk at joins is hardly more than within windows, short beside a step."""


def inertialised(frames: Float32, history: Float32, layout: Layout) -> Float32:
    """A window, moved so that it goes on from a history evenly.

    Of the root's speeds, of which the path is the sum, only the jump itself is known; velocities, forces and the like
    stay as they are.

    Args:
        frames: features of the window, not normalised, (W, layout.size), W >= 2.
        history: of the frames before, likewise, (H, layout.size); with less than two nothing is known of speed, and the
            window stays as it is.
        layout: of both.
    """
    if len(history) < 2:
        return frames
    blocks = layout.blocks
    root = blocks["root"].start
    pose = [root + 3, *_columns(blocks["rotations"]), *_columns(blocks["positions"])]
    rate = 2.0 * np.log(2.0) / (HALF_LIFE_S * layout.fps)
    time = np.arange(1, len(frames) + 1)[:, None]
    moved = frames.copy()

    # The frame before the window as the window has it, against the one that was.
    before = 2.0 * frames[0, pose] - frames[1, pose]
    jump = history[-1, pose] - before
    speed = (history[-1, pose] - history[-2, pose]) - (frames[1, pose] - frames[0, pose])
    moved[:, pose] += (jump + (speed + rate * jump) * time) * np.exp(-rate * time)

    travel = slice(root, root + 3)
    fading = (1.0 + rate * (time - 1)) * np.exp(-rate * (time - 1))
    moved[:, travel] += fading * (history[-1, travel] - frames[0, travel])
    return moved


def _columns(block: slice) -> range:
    return range(block.start, block.stop)
