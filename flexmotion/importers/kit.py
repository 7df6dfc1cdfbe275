"""Reader of motion on the 21 joints of KIT-ML, as HumanML3D's tools write them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import MotionFormatError
from flexmotion.importers.capture import Capture

NAMES = (
    *("root", "belly", "thorax", "neck", "head"),
    *("right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist"),
    *("right_hip", "right_knee", "right_ankle", "right_midfoot", "right_toe"),
    *("left_hip", "left_knee", "left_ankle", "left_midfoot", "left_toe"),
)
"""Joints in order: `kit_kinematic_chain` of github.com/EricGuo5513/HumanML3D, right before left."""

FPS = 12.5
"""Frame rate of KIT-ML's joint files [1/s]."""

VECTORS = 251
"""Width of KIT-ML's feature vectors, which are no positions."""


def joints21(array: NDArray[np.generic], path: str) -> Capture:
    """A capture of positions of the 21 joints, (T, 21, 3) in any unit, y up, 12.5 frames per second.

    Raises:
        MotionFormatError: the array has values that are not finite numbers, or no frames.
    """
    if not len(array):
        raise MotionFormatError(f"{path}: no frames")
    if not np.issubdtype(array.dtype, np.number):
        raise MotionFormatError(f"{path}: values of type {array.dtype}, expected numbers")
    positions = array.astype(np.float64)
    bad = np.argwhere(~np.isfinite(positions))
    if len(bad):
        raise MotionFormatError(f"{path}: joint {NAMES[bad[0][1]]!r} is not finite in frame {bad[0][0]}")
    return Capture(path, FPS, NAMES, positions)
