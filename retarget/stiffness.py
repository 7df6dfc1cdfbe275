"""`LimbStiffness`: how stiff arms and head follow, by the tension of the human's limbs.

A limb that is as tense as a human's ever is has the stiffness of the robot file, one without tension the file's
`least_stiffness` of it. A limb has all of its stiffness where it does not follow a human of known tension: in a stop,
on the way to a target of its own, after a motion without torques. Where a tension is asked for by itself, the limb has
that one, whatever it follows. Legs always have all.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.tension import LIMBS, limb_tension
from flexmotion.configs.robot import Robot
from flexmotion.human.filters import recursive
from flexmotion.retarget.view import HumanView

Float = NDArray[np.float64]

SMOOTH_S = 0.15
"""Time constant of the low-pass over the tension, which is read as much ahead, so that it does not lag [s]."""


class LimbStiffness:
    """Stiffness over the rows of plans of one robot."""

    def __init__(self, robot: Robot) -> None:
        chains = robot.mapping.chains()
        self._joints = [list(robot.chain(limb).values()) if limb in chains else [] for limb in LIMBS]
        self._n, self._least = robot.n, robot.config.least_stiffness
        self._keeps = float(np.exp(-1.0 / (SMOOTH_S * robot.rate_hz)))

    def tension(
        self, before: Float, view: HumanView | None, rows: int, led: NDArray[np.bool_], asked: Mapping[int, float]
    ) -> Float:
        """Tension of each of `tension.LIMBS` in every row, (T, 3) in [0, 1].

        Args:
            before: tension one row before the first, (3,).
            view: the human that is followed; None: a stop.
            rows: of the plan.
            led: joints that follow a path of their own, (n,).
            asked: see `Restrictions.tension`.
        """
        targets = np.ones((rows, len(LIMBS)))
        if view is not None and self._least < 1.0:
            found = limb_tension(view.window.motion, view.window.arrays)
            if found is not None:
                ticks = view.tick + np.arange(view.follow, dtype=float)
                targets[: view.follow] = view.window.at(found, view.seconds(ticks) + SMOOTH_S)
        for limb, joints in enumerate(self._joints):
            if led[joints].any():
                targets[:, limb] = 1.0
        for limb, share in asked.items():
            targets[:, limb] = share
        smooth = recursive([1.0 - self._keeps], [-self._keeps], targets, self._keeps * before[None])
        return np.clip(smooth, 0.0, 1.0)

    def shares(self, tension: Float) -> Float:
        """Stiffness as a share of the robot file's, (T, n) in [`least_stiffness`, 1], for tensions (T, 3)."""
        found = np.ones((len(tension), self._n))
        for limb, joints in enumerate(self._joints):
            found[:, joints] = self._least + (1.0 - self._least) * tension[:, limb, None]
        return found
