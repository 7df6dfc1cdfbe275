"""Removal of the slow drift of a recorded floor under the feet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.floor import clip_floor
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.signals import fill

Float = NDArray[np.float64]

STILL = 0.25
"""Greatest speed of a standing point of the sole [m/s]."""

DRIFT = 0.04
"""Greatest distance of a standing foot from the clip's floor [m]; farther, it stands on a stair or a chair."""

WIDTH_S = 1.0
"""Standard deviation of the Gaussian average over time [s]."""


def on_level_floor(motion: Motion) -> Motion:
    """The motion with its floor at z = 0 wherever it stands on it."""
    human = forward(motion)
    floor = clip_floor(human, motion.fps)
    points = np.concatenate([human.heel, human.toe], axis=1)
    if len(motion) < 3:
        return replace(motion, root_position=motion.root_position - [0.0, 0.0, floor])
    speed = np.linalg.norm(np.gradient(points, axis=0), axis=-1) * motion.fps
    height = points[..., 2] - floor
    standing = ((speed < STILL) & (np.abs(height) < DRIFT)).astype(np.float64)
    count = standing.sum(axis=1)
    mean = (standing * height).sum(axis=1) / np.maximum(count, 1.0)
    drift = fill(mean[:, None], count, WIDTH_S * motion.fps)[:, 0] if count.any() else np.zeros(len(motion))
    lowered = motion.root_position.copy()
    lowered[:, 2] -= floor + drift
    return replace(motion, root_position=lowered)
