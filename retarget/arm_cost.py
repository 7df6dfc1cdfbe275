"""`ArmCost`: how far poses of the arms are from the directions of the human's upper arms and forearms.

The cost of a pose is |u - u*|² + |f - f*|² + h |c|², with unit vectors u of the upper arm and f of the forearm, and c
the distance of the hand from where the human's would be on the robot's segments, over arm length: c = a (u - u*) +
b (f - f*) with the segments' shares a, b of the arm. The weight h is that of the hand: an arm that cannot have both
directions then errs in those that keep the hand in its place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.kinematics import HumanKinematics
from flexmotion.retarget.arm_chain import ArmChain, ArmPoses
from flexmotion.retarget.arm_clearance import BodyClearance
from flexmotion.spatial.heading import matrix_heading

Float = NDArray[np.float64]

_HAND_WEIGHT = 1.0
"""Weight of the position of a hand that matters."""
_RAISED = (0.9, 1.5)
"""A hand matters by how far the line from the shoulder to it is raised from hanging: from not at all to wholly [rad].
Hands that wave, reach or point are raised; those of a swinging or hanging arm are not."""
_DAMPING = 0.02
"""Added to the curvature of the cost by a joint; keeps steps bounded where an arm is straight."""
LONGEST_STEP = 0.6
"""Longest Gauss-Newton step of a joint [rad]."""
_REST_WEIGHT = 1e-3
"""Cost of a squared radian away from the stand pose: decides where directions leave an arm free."""
_HELD = 1e6
"""Curvature of a joint that a limit holds."""


@dataclass(frozen=True)
class ArmTargets:
    """What both arms follow, by frame, in the torso frame.

    Attributes:
        upper, fore: unit vectors of the human's upper arms and forearms, (..., 2, 3).
        hand_weight: weight of the position of the hand, (..., 2).
        lean: pitch of the robot's trunk forward, (...) [rad].
    """

    upper: Float
    fore: Float
    hand_weight: Float
    lean: Float

    @classmethod
    def of(cls, human: HumanKinematics, chain: ArmChain, most_lean: float = 0.5 * np.pi) -> ArmTargets:
        """Targets of each frame for the arms of a robot; without elbow both segments are from shoulder to hand.

        Args:
            most_lean: greatest pitch of the robot's trunk [rad].
        """
        torso = human.torso_rotation[:, None].swapaxes(-1, -2)
        whole = _unit((torso @ (human.hand - human.shoulder)[..., None])[..., 0])
        raised = np.arccos(np.clip(-whole[..., 2], -1.0, 1.0))
        low, high = _RAISED
        share = np.clip((raised - low) / (high - low), 0.0, 1.0)
        weight = _HAND_WEIGHT * share * share * (3.0 - 2.0 * share)
        up, yaw = human.torso_rotation[:, :, 2], matrix_heading(human.torso_rotation)
        lean = np.clip(np.arctan2(np.cos(yaw) * up[:, 0] + np.sin(yaw) * up[:, 1], up[:, 2]), 0.0, most_lean)
        if not chain.has_elbow:
            return cls(whole, whole, weight, lean)
        upper = _unit((torso @ (human.elbow - human.shoulder)[..., None])[..., 0])
        fore = _unit((torso @ (human.hand - human.elbow)[..., None])[..., 0])
        return cls(upper, fore, weight, lean)

    def frames(self, rows: NDArray[np.int64]) -> ArmTargets:
        """Those of some frames."""
        return ArmTargets(self.upper[rows], self.fore[rows], self.hand_weight[rows], self.lean[rows])

    def repeated(self, count: int) -> ArmTargets:
        """The same for several poses of each frame, (F, count, 2, ...)."""
        return ArmTargets(
            *(
                np.repeat(array[:, None], count, axis=1)
                for array in (self.upper, self.fore, self.hand_weight, self.lean)
            )
        )


class ArmCost:
    """Cost of poses of both arms of one robot.

    Args:
        chain: the arms.
        clearance: keeps them out of the body.
        rest: joint angles that they have where nothing else decides, (2, m) [rad].
    """

    def __init__(self, chain: ArmChain, clearance: BodyClearance, rest: Float) -> None:
        self.chain, self.clearance, self.rest = chain, clearance, rest
        self._shares = chain.lengths / chain.lengths.sum(axis=1, keepdims=True)

    def compare(self, targets: ArmTargets, upper: Float, fore: Float) -> Float:
        """Costs in directions of every pose (C, S, 2, 3) at every frame, (F, C, S, 2)."""
        cells, samples = upper.shape[:2]
        out = np.empty((len(targets.upper), cells, samples, 2))
        for side, (a, b) in enumerate(self._shares):
            h = targets.hand_weight[:, side, None]
            # |u - u*|² = 2 - 2 u.u*, and |c|² by u.u*, f.f*, u.f*, f.u* and u.f.
            own = np.concatenate([upper[:, :, side], fore[:, :, side]], axis=-1).reshape(-1, 6)
            us, fs = targets.upper[:, side], targets.fore[:, side]
            wanted = np.concatenate(
                [(1.0 + h * a * a) * us + h * a * b * fs, (1.0 + h * b * b) * fs + h * a * b * us], axis=1
            )
            both = np.sum(own[:, :3] * own[:, 3:], axis=1)
            cost = -2.0 * (wanted @ own.T) + 2.0 * a * b * h * both
            cost += 4.0 + 2.0 * h * (a * a + b * b) + 2.0 * a * b * h * np.sum(us * fs, axis=1, keepdims=True)
            out[..., side] = cost.reshape(len(us), cells, samples)
        return out

    def of(self, targets: ArmTargets, q: Float) -> Float:
        """Cost of poses (..., 2, m), one for each target, in directions alone, (..., 2)."""
        residual, _ = self._directions(targets, self.chain.poses(q))
        return np.sum(residual**2, axis=-1)

    def normal(
        self, targets: ArmTargets, q: Float, lower: Float, upper: Float, *, clear: bool = True
    ) -> tuple[Float, Float]:
        """Gauss-Newton equations of half the cost at poses (..., 2, m).

        Joints at a limit, (2, m) [rad], that the cost pushes further are held there.

        Returns:
            Matrix (..., 2, m, m) and right side (..., 2, m), so that a step solves matrix x step = right.
        """
        poses = self.chain.poses(q)
        residual, jacobian = self._directions(targets, poses)
        if clear:
            depth, slope = self.clearance.residual(poses, targets.lean)
            residual = np.concatenate([residual, depth], axis=-1)
            jacobian = np.concatenate([jacobian, slope], axis=-1)
        matrix = jacobian @ jacobian.swapaxes(-1, -2)
        right = -(jacobian @ residual[..., None])[..., 0] - _REST_WEIGHT * (q - self.rest)
        held = ((q <= lower) & (right < 0.0)) | ((q >= upper) & (right > 0.0))
        free = (~held).astype(float)
        matrix *= free[..., None] * free[..., None, :]
        diagonal = np.einsum("...ii->...i", matrix)
        diagonal += _DAMPING + _REST_WEIGHT + _HELD * held
        return matrix, right * free

    def improved(self, targets: ArmTargets, q: Float) -> Float:
        """Poses (..., 2, m) after one bounded Gauss-Newton step of each by itself, by directions alone."""
        lower, upper = self.chain.lower, self.chain.upper
        matrix, right = self.normal(targets, q, lower, upper, clear=False)
        step = np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], dtype=np.float64)
        return np.clip(q + _bounded(step), lower, upper)

    def _directions(self, targets: ArmTargets, poses: ArmPoses) -> tuple[Float, Float]:
        """Residuals (..., 2, 9) and their derivatives by the joints, (..., 2, m, 9)."""
        upper, fore = poses.upper - targets.upper, poses.fore - targets.fore
        a, b = self._shares[:, :1], self._shares[:, 1:]
        root = np.sqrt(targets.hand_weight)[..., None]
        residual = np.concatenate([upper, fore, root * (a * upper + b * fore)], axis=-1)
        du, df = poses.upper_jacobian, poses.fore_jacobian
        hand = root[..., None] * (a[..., None] * du + b[..., None] * df)
        return residual, np.concatenate([du, df, hand], axis=-1)


def _bounded(step: Float) -> Float:
    """Steps (..., m) shortened so that no joint moves further than `LONGEST_STEP`."""
    longest = np.abs(step).max(axis=-1, keepdims=True)
    return step * np.minimum(1.0, LONGEST_STEP / np.maximum(longest, 1e-12))


def _unit(vectors: Float) -> Float:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
