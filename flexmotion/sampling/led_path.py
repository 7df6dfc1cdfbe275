"""`led_along`: joints of a window that follow a path of their own, over what its other joints do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.spatial.transitions import decaying

Float = NDArray[np.float64]

JOINING_S = 0.2
"""Time constant with which joints that were elsewhere come to the path [s]."""

KNOWN = 2
"""Frames of the path before the window."""


def led_along(window: Motion, before: Motion, path: Float, columns: Sequence[int]) -> Motion:
    """The window with some joints along a path; angles and speeds go on from those before it.

    Args:
        window: as sampled, T frames.
        before: the motion up to the window, at least one frame.
        path: angles of those joints, from `KNOWN` frames before the window on, (KNOWN + T, C) [rad].
        columns: the joints, C.
    """
    known = before.joints[max(0, len(before) - KNOWN) :, columns]
    away = known - path[KNOWN - len(known) : KNOWN]
    rate, turns = (away[-1] - away[0]) * window.fps, 2 * np.pi * np.round(away[-1] / (2 * np.pi))
    passed = np.arange(1, len(window) + 1)[:, None] / window.fps
    joints = window.joints.copy()
    joining = decaying(away[-1] - turns, rate, 1.0 / JOINING_S, passed)
    joints[:, columns] = path[KNOWN:] + turns + joining  # angles go on where they are, however often an arm has turned
    return window.changed(joints=joints)
