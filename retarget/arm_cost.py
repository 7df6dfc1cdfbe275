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

from flexmotion.compiled import packed
from flexmotion.human.kinematics import HumanKinematics
from flexmotion.retarget import arm_loops
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
_IN_THE_BODY = 4.0
"""Most that a pose of a candidate costs for its depth in the body, in squared chords: as much as one segment that
points the other way. Poses on the body's edge win against those in it, and these against an arm that is flung out."""
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
        weights = packed(
            arm_loops.Weights,
            shares=self._shares,
            rest=rest,
            lower=chain.lower,
            upper=chain.upper,
            rest_weight=_REST_WEIGHT,
            damping=_DAMPING,
            held=_HELD,
            in_the_body=_IN_THE_BODY,
        )
        self._loops = chain.arms, clearance.body, weights

    def features(self, poses: ArmPoses) -> Float:
        """What `compare` needs of poses (N, 2, ...), (2, N, 7)."""
        both = np.sum(poses.upper * poses.fore, axis=-1, keepdims=True)
        return np.ascontiguousarray(np.concatenate([poses.upper, poses.fore, both], axis=-1).swapaxes(0, 1))

    def compare(self, targets: ArmTargets, features: Float) -> Float:
        """Costs in directions of poses by their `features` at every frame, less a constant of the frame, (2, F, N)."""
        a, b = self._shares[:, 0], self._shares[:, 1]
        h = targets.hand_weight[..., None]
        # |u - u*|² = 2 - 2 u.u*, and |c|² by u.u*, f.f*, u.f*, f.u* and u.f.
        a, b = a[:, None], b[:, None]
        upper = (1.0 + h * a * a) * targets.upper + h * a * b * targets.fore
        fore = (1.0 + h * b * b) * targets.fore + h * a * b * targets.upper
        wanted = 2.0 * np.concatenate([-upper, -fore, h * a * b], axis=-1)
        costs: Float = wanted.swapaxes(0, 1) @ features.swapaxes(1, 2)
        return costs

    def of(self, targets: ArmTargets, q: Float) -> Float:
        """Cost of poses, equally many of each target in turn, (N, 2, m) [rad]: (N, 2).

        In the body it is `_IN_THE_BODY` more at most.
        """
        return arm_loops.costs(*self._loops, _wanted(targets, q), q)

    def normal(self, targets: ArmTargets, q: Float) -> tuple[Float, Float, Float]:
        """Gauss-Newton equations of half the cost at poses (N, 2, m), as of `of`.

        Joints at a limit that the cost pushes further are held there.

        Returns:
            Matrix (N, 2, m, m) and right side (N, 2, m), so that a step solves matrix x step = right; the cost, (N, 2).
        """
        return arm_loops.normal(*self._loops, _wanted(targets, q), q)

    def improved(self, targets: ArmTargets, q: Float) -> Float:
        """Poses (N, 2, m), as of `of`, after one bounded Gauss-Newton step of each by itself, by directions alone."""
        return arm_loops.improved(*self._loops, _wanted(targets, q), q, LONGEST_STEP)


def _wanted(targets: ArmTargets, q: Float) -> arm_loops.Wanted:
    """The targets of poses (N, 2, m) as the compiled loops take them."""
    if not len(q) or len(q) % len(targets.lean):
        raise ValueError(f"{len(q)} poses of {len(targets.lean)} targets, expected as many of each")
    return packed(arm_loops.Wanted, **vars(targets))


def _unit(vectors: Float) -> Float:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
