"""`settled`: signals that come to rest from where they are, as smoothly as people do.

A sampled window is a little off the one before it, by millimetres and tenths of degrees. Led back within a quarter of a
second (`features/inertialise.py`), that is a start at every join: hands of held poses jerked by 6 m/s³ there, those of
people by .3. A body that rests has time.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

KNOWN = 3
"""Frames of which place, speed and acceleration are taken."""


def stopped(before: Float, frames: int, fps: float, seconds: float) -> Float:
    """Signals that come to rest on their way, without coming back, (T, n).

    They do for `settled` where they are to go on for twice the way of their speed in the time constant.

    Args:
        before: at least one frame, (K, n).
        frames, fps, seconds: see `settled`.
    """
    rate = (before[-1] - before[-2] if len(before) > 1 else np.zeros_like(before[-1])) * fps
    return settled(before, before[-1] + 2.0 * seconds * rate, frames, fps, seconds)


def settled(before: Float, place: Float, frames: int, fps: float, seconds: float) -> Float:
    """Signals that go from where they are to a place; place, speed and acceleration are continuous, (T, n).

    What they are off at the join, x, v and a, decays by a critically damped filter of third order:

        (x + (v + y x) t + (a + 2 y v + y² x) t² / 2) exp(-y t),    y = 1 / seconds

    Args:
        before: the signals before, at least one frame, (K, n).
        place: where they are to rest, (n,).
        frames: T.
        fps: frames per second.
        seconds: time constant.
    """
    first, middle, last = (before[max(len(before) - back, 0)] for back in (3, 2, 1))
    rate, bend = 1.0 / (seconds * fps), last - 2 * middle + first
    # Differences backwards are those half a frame, and a frame, before the last one.
    off, speed = last - place, last - middle + 0.5 * bend
    found: Float = place + _decays(frames, rate) @ [
        off,
        speed + rate * off,
        0.5 * (bend + 2 * rate * speed + rate**2 * off),
    ]
    return found


@lru_cache(maxsize=32)
def _decays(frames: int, rate: float) -> Float:
    """What a place, a speed and half an acceleration become over frames, (T, 3)."""
    time = np.arange(1, frames + 1)[:, None]
    return time ** np.arange(3) * np.exp(-rate * time)
