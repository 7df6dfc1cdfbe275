"""`ArmPath`: joint angles of both arms over a window, near the human's directions and with little acceleration.

Minimises the sum over frames of `ArmCost`, of squared joint accelerations and of squared joint speeds beyond what the
joints can do, by Gauss-Newton steps on the whole window: where an arm must go round a singular pose it begins early
enough. Differences couple up to three frames, so that the equations are banded and take time linear in the frames.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpbsv

from flexmotion.retarget import arm_loops
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.retarget.arm_cost import LONGEST_STEP, ArmCost, ArmTargets

Float = NDArray[np.float64]

_BANDWIDTH = 30.0
"""Movements of directions faster than this are smoothed [rad/s]; a quick wave has 15."""
_SPEED_WEIGHT = 300.0
"""Cost of a squared radian that a joint moves further in a frame than it can."""
_STEPS = 6
"""Most Gauss-Newton steps."""
_DAMPED, _HARDER, _SOFTER = 3.0, 4.0, 0.5
"""Damping of a frame whose last step raised its cost, in squared chords a squared radian, and its factors where a step
raises the cost again or lowers it (after Marquardt 1963): arms on an edge of the body went to and fro across it."""
_ARRIVED = 0.02
"""The steps end when no joint moves further than this [rad]."""


class ArmPath:
    """Refines configurations of both arms of one robot over a window.

    Args:
        chain: the arms.
        cost: of their poses.
        speed: greatest speed of each arm joint, (2, m) [rad/s].
    """

    def __init__(self, chain: ArmChain, cost: ArmCost, speed: Float) -> None:
        self.chain, self.cost, self.speed = chain, cost, speed

    def refine(self, targets: ArmTargets, q: Float, before: Float | None, fps: float) -> Float:
        """Joint angles of each frame, (F, 2, m) [rad].

        Args:
            targets: of each frame.
            q: where to start, (F, 2, m) [rad].
            before: joint angles of the two frames before the first, oldest first, (2, 2, m) [rad], which the path
                continues; None: it begins freely.
            fps: frames a second.
        """
        frames, _, count = q.shape
        lower, upper = self.chain.lower, self.chain.upper
        weight, reach = (fps / _BANDWIDTH) ** 4, self.speed / fps
        known = np.zeros((0, 2, count)) if before is None else before
        damping, cost = np.zeros((frames, 2)), np.full((frames, 2), np.inf)
        for _ in range(_STEPS):
            matrix, right, found = self.cost.normal(targets, q)
            damping = np.where(found > cost, np.maximum(_HARDER * damping, _DAMPED), _SOFTER * damping)
            cost = found
            line = np.concatenate([known, q])
            bands, sides = arm_loops.path_equations(matrix, right, line, damping, weight, reach, _SPEED_WEIGHT)
            _, step, failed = dpbsv(bands, sides, lower=1)
            if failed:
                raise np.linalg.LinAlgError(f"the equations of the arms' path are not positive definite (row {failed})")
            step = step.reshape(2, frames, count).swapaxes(0, 1)
            # All frames of an arm by the same share: the path stays smooth.
            step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.abs(step).max(axis=(0, 2), keepdims=True), 1e-12))
            moved = np.minimum(np.maximum(q + step, lower), upper)
            far = np.abs(moved - q).max()
            q = moved
            if far < _ARRIVED:
                break
        return q
