"""Checks of what no format rules out and no human does: frames seconds apart, hips a kilometre away, jumps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import MotionFormatError

Float = NDArray[np.float64]

LONGEST_FRAME_S = 0.5
"""Greatest time between two frames [s]; a step takes about as long."""
FASTEST = 15.0
"""Greatest speed of the hips [m/s]; sprinters reach 12."""
SLACK_M = 0.05
"""Room for noise of a recording, from one frame to the next [m]."""
FURTHEST_M = 1000.0
"""Hips that are further than this from the middle of their way, and further than `FASTEST` leads, are damaged [m]."""


def check_rate(path: str, fps: float) -> None:
    """Raise `MotionFormatError` where frames are further apart than `LONGEST_FRAME_S`; `fps`: frames per second."""
    if fps * LONGEST_FRAME_S < 1.0:
        raise MotionFormatError(
            f"{path}: a frame every {1.0 / fps:.4g} s, expected {LONGEST_FRAME_S:g} s at most; "
            "is its time given in milliseconds?"
        )


def check_way(path: str, fps: float, hips: Float, skipped: int = 0) -> list[str]:
    """A warning where the hips jump.

    Args:
        path: of the file, for messages.
        hips: in the room, (T, 3) [m].
        skipped: frames of the file before the first of these.

    Raises:
        MotionFormatError: the hips are where no human gets in the time of the clip.
    """
    away = np.linalg.norm(hips - np.median(hips, axis=0), axis=1)
    furthest = int(np.argmax(away))
    if away[furthest] > max(FURTHEST_M, FASTEST * len(hips) / fps):
        raise MotionFormatError(
            f"{path}: {_frame(furthest + skipped, fps)}: the hips are {away[furthest]:.4g} m from the middle of their "
            f"way, expected {FURTHEST_M:g} m at most: is a number damaged, or the unit another one?"
        )
    moved = np.linalg.norm(np.diff(hips, axis=0), axis=1)
    jumps = np.flatnonzero(moved > FASTEST / fps + SLACK_M)
    if not len(jumps):
        return []
    first = int(jumps[0])
    more = f"; further jumps: {len(jumps) - 1}" if len(jumps) > 1 else ""
    return [
        f"{_frame(first + 1 + skipped, fps)}: the hips jump by {moved[first]:.3g} m, {moved[first] * fps:.3g} m/s "
        f"where a human reaches {FASTEST:g} m/s at most{more}"
    ]


def _frame(index: int, fps: float) -> str:
    """A frame of the file, counted from 1, and its time."""
    return f"frame {index + 1} (at {index / fps:.2f} s)"
