"""`overlaid`: a planned gesture over the motion of a base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.dataset.gestures.legs import lowered_pelvis
from flexmotion.dataset.gestures.plan import Plan
from flexmotion.dataset.gestures.tracks import Stroke, rotations, unrest, values
from flexmotion.human.angles import three_angle_rotation, three_angles
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES

Float = NDArray[np.float64]

SHOULDER = ("shoulder_flexion", "shoulder_adduction", "shoulder_rotation")
NECK = [JOINTS.index(f"neck_{name}") for name in ("extension", "bending", "rotation")]
LUMBAR = [JOINTS.index(f"lumbar_{name}") for name in ("extension", "bending", "rotation")]

ARM_UNREST, HEAD_UNREST = (0.4, 1.6), (0.2, 0.9)
"""Standard deviation of the slow noise of held arms and of the head; drawn for each motion [degrees]."""


def overlaid(base: Motion, plan: Plan, rng: np.random.Generator) -> Motion:
    """The base with the gesture: its arms, head, trunk and knees where the gesture moves them, the base's elsewhere.

    Args:
        base: at least as long as the plan.
        plan: the gesture.
        rng: random generator of the unrest of held poses.
    """
    times = np.arange(len(base)) / base.fps
    joints = base.joints.copy()
    for side in range(len(SIDES)):
        _arm(joints, times, plan, side, rng)
    ahead = [Stroke(stroke.start - plan.lead, stroke.end - plan.lead) for stroke in plan.strokes]
    for columns, strokes, reached, size in (
        (NECK, ahead, plan.targets.head, rng.uniform(*HEAD_UNREST)),
        (LUMBAR, plan.strokes, plan.targets.trunk, 0.0),
    ):
        zero = np.zeros((len(times), 3))
        moved = values(times, strokes, reached, zero)
        away = values(times, strokes, [None if value is None else np.ones(3) for value in reached], zero)
        joints[:, columns] += moved + away * unrest(times, np.radians(size), 3, rng)
    joints = np.clip(joints, *joint_limits().T)
    motion = replace(
        base, joints=joints, torques=None, wrenches=None, activations=None, joint_contact=None, contacts=None
    )
    down, tilt = values(times, plan.strokes, plan.targets.down, np.zeros((len(times), 2))).T
    if not down.any():
        return motion
    # People keep their balance: over the feet, where they stood.
    return lowered_pelvis(motion, down * base.body.leg, tilt, forward(base).com)


def _arm(joints: Float, times: Float, plan: Plan, side: int, rng: np.random.Generator) -> None:
    """Write one arm's angles into the joints, (T, 26) [rad]."""
    reached = plan.targets.arms[side]
    if all(target is None for target in reached):
        return
    letter = SIDES[side]
    shoulder = [JOINTS.index(f"{name}_{letter}") for name in SHOULDER]
    elbow, pronation = (JOINTS.index(f"{name}_{letter}") for name in ("elbow_flexion", "forearm_pronation"))
    base = three_angle_rotation(joints[:, shoulder], SHOULDER, letter)
    humerus, away = rotations(times, plan.strokes, [None if t is None else t.humerus for t in reached], base)
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
