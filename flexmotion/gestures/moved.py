"""`moved`: joint angles of a base, with arms, head and trunk where a gesture moves them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.gestures.plan import Plan
from flexmotion.gestures.tracks import Stroke, rotations, unrest, values
from flexmotion.human.angles import three_angle_rotation, three_angles
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.skeleton import JOINTS, SIDES

Float = NDArray[np.float64]

SHOULDER = ("shoulder_flexion", "shoulder_adduction", "shoulder_rotation")
ARM = (*SHOULDER, "elbow_flexion", "forearm_pronation")
NECK = [JOINTS.index(f"neck_{name}") for name in ("extension", "bending", "rotation")]
LUMBAR = [JOINTS.index(f"lumbar_{name}") for name in ("extension", "bending", "rotation")]

ARM_UNREST, HEAD_UNREST = (0.4, 1.6), (0.2, 0.9)
"""Standard deviation of the slow noise of held arms and of the head; drawn for each motion [degrees]."""


def moved(base: Float, times: Float, plan: Plan, rng: np.random.Generator | None = None) -> Float:
    """Angles within the joints' limits, (T, 26) [rad].

    Args:
        base: angles of the base, (T, 26) [rad].
        times: (T,) [s].
        plan: the gesture.
        rng: random generator of the unrest of held poses; None: they are held still.
    """
    joints = base.copy()
    for side in range(len(SIDES)):
        _arm(joints, times, plan, side, rng)
    ahead = [Stroke(stroke.start - plan.lead, stroke.end - plan.lead) for stroke in plan.strokes]
    for columns, strokes, reached, size in (
        (NECK, ahead, plan.targets.head, 0.0 if rng is None else rng.uniform(*HEAD_UNREST)),
        (LUMBAR, plan.strokes, plan.targets.trunk, 0.0),
    ):
        zero = np.zeros((len(times), 3))
        joints[:, columns] += values(times, strokes, reached, zero)
        if rng is not None:
            away = values(times, strokes, [None if value is None else np.ones(3) for value in reached], zero)
            joints[:, columns] += away * unrest(times, np.radians(size), 3, rng)
    return np.clip(joints, *joint_limits().T)


def moving(plan: Plan) -> list[int]:
    """Joints that a gesture moves, beside those of the legs."""
    found = []
    for side, targets in zip(SIDES, plan.targets.arms, strict=True):
        if any(target is not None for target in targets):
            found += [JOINTS.index(f"{name}_{side}") for name in ARM]
    for columns, reached in ((NECK, plan.targets.head), (LUMBAR, plan.targets.trunk)):
        if any(value is not None for value in reached):
            found += columns
    return found


def _arm(joints: Float, times: Float, plan: Plan, side: int, rng: np.random.Generator | None) -> None:
    """Write one arm's angles into the joints, (T, 26) [rad]."""
    reached = plan.targets.arms[side]
    if all(target is None for target in reached):
        return
    letter = SIDES[side]
    shoulder = [JOINTS.index(f"{name}_{letter}") for name in SHOULDER]
    elbow, pronation = (JOINTS.index(f"{name}_{letter}") for name in ("elbow_flexion", "forearm_pronation"))
    base = three_angle_rotation(joints[:, shoulder], SHOULDER, letter)
    humerus, away = rotations(times, plan.strokes, [None if t is None else t.humerus for t in reached], base)
    noise = np.zeros((len(times), 4))
    if rng is not None:
        noise = away[:, None] * unrest(times, np.radians(rng.uniform(*ARM_UNREST)), 4, rng)
    joints[:, shoulder] = three_angles((humerus * Rotation.from_rotvec(noise[:, :3])).as_matrix(), SHOULDER, letter)
    bend = [None if t is None else np.array([t.elbow]) for t in reached]
    joints[:, elbow] = values(times, plan.strokes, bend, joints[:, [elbow]])[:, 0] + noise[:, 3]
    # The base's pronation may be a turn off from the recipes' range.
    own = joints[:, [pronation]] - 2 * np.pi * np.round(np.median(joints[:, pronation] - np.pi / 2) / (2 * np.pi))
    turn = [None if t is None or t.pronation is None else np.array([t.pronation]) for t in reached]
    joints[:, pronation] = values(times, plan.strokes, _kept(turn, reached), own)[:, 0]


def _kept(turn: list[Float | None], reached: Sequence[object]) -> list[Float | None]:
    """Pronations, where a pose without one keeps that of the pose before."""
    kept = list(turn)
    for at in range(1, len(kept)):
        if kept[at] is None and reached[at] is not None:
            kept[at] = kept[at - 1]
    return kept
