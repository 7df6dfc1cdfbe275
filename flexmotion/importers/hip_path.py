"""`HipPath`: where a person goes whose frames are relative to its hips, by the foot that stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion

Float = NDArray[np.float64]

LOWER_M = 0.02
"""The other foot becomes the one that stands where it is lower by this [m]."""


class HipPath:
    """Holds the lower foot where it is, and moves the hips instead; its sole is on the floor, so there is no flight."""

    def __init__(self) -> None:
        self._side = 0
        self._place = np.zeros(2)
        self._sole: Float | None = None

    def __call__(self, pose: Motion) -> Motion:
        """A pose, one frame with its hips over the origin, at its place."""
        human = forward(pose)
        points = np.stack([human.heel[0], human.toe[0]])
        lowest = points[:, :, 2].min(axis=0)
        middle = points.mean(axis=0)[:, :2]
        if self._sole is not None:
            self._place = self._place + self._sole[self._side] - middle[self._side]
        if lowest[1 - self._side] < lowest[self._side] - LOWER_M:
            self._side = 1 - self._side
        self._sole = middle
        shift = np.array([*self._place, -lowest.min()])
        return replace(pose, root_position=pose.root_position + shift)
