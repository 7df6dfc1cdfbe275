"""`limb_tension`: how tense arms and neck of a human are, from their joint torques and speeds.

No muscle of an arm or of the neck is known: the muscle models are of legs and trunk. What is known of such a joint is
its torque, and the stiffness of a human's shoulder and elbow rises in proportion to that (Gomi and Osu, *Task-dependent
viscoelasticity of human multijoint arm and its spatial characteristics for interaction with environments*, Journal of
Neuroscience 18(21), 1998). The torque that holds a limb against gravity is left out: a robot has it from its plan, at
any stiffness. A limb in fast motion is counted as tense too: it is about to be slowed down.

    tension = min(1, max(effort / `FULL_EFFORT`, speed / `FULL_SPEED`))
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.differentiation import derivative
from flexmotion.biomechanics.inverse_dynamics import joint_torques
from flexmotion.biomechanics.segment_motion import SegmentMotion, segments_at_rest
from flexmotion.biomechanics.strength import STRENGTH
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, ROOT_DOFS, SIDES

Float = NDArray[np.float64]

LIMBS = ("left_arm", "right_arm", "head")
"""Limbs whose tension is measured, in the order of its columns; names as of the chains of a robot file."""

FULL_EFFORT, FULL_SPEED = 0.1, 5.0
"""Torque beyond gravity's over the joints' strength, and speed [rad/s], each of which alone is full tension.

95 % of what the shipped model's most forceful and fastest arms do: .12 in running, 4.8 to 5.9 rad/s in raising both
arms. Medians: standing .003 and .04, waving .023 and .9, walking .02 and 1.5, a salute that is held .027 and .2.
"""

_COLUMNS = tuple(
    [JOINTS.index(name) for name in JOINTS if name.partition("_")[0] in parts and name.endswith(end)]
    for parts, end in (
        *((("shoulder", "elbow", "forearm"), f"_{side}") for side in SIDES),
        (("neck",), ""),
    )
)
"""Columns of `skeleton.JOINTS` of each limb."""


def limb_tension(motion: Motion, known: Mapping[str, Float] | None = None) -> Float | None:
    """Tension of each of `LIMBS` in every frame, (T, 3) in [0, 1]; None for a motion without torques.

    Of arms and neck the torques do not depend on the ground's forces.

    Args:
        known: as of `segments_at_rest`.
    """
    if motion.torques is None:
        return None
    segments = segments_at_rest(motion, known)
    nothing = np.zeros((len(motion), len(SIDES), 6))
    held = joint_torques(motion.body, segments, nothing, nothing[..., :3])
    root = len(ROOT_DOFS)
    beyond = (motion.torques[:, root:] - held[:, root:]) / _joint_strength(motion)
    effort = np.stack([np.linalg.norm(beyond[:, own], axis=1) for own in _COLUMNS], axis=1)
    return np.minimum(np.maximum(effort / FULL_EFFORT, _speeds(motion, segments) / FULL_SPEED), 1.0)


def _joint_strength(motion: Motion) -> Float:
    """Greatest torque of each of `skeleton.JOINTS` of a motion's human, (26,) [N·m]."""
    return motion.body.mass * np.array([STRENGTH[name.partition("_")[0]] for name in JOINTS])


def _speeds(motion: Motion, segments: SegmentMotion) -> Float:
    """Speeds of the wrists about their shoulders and of the head about the neck, in the torso's frame, (T, 3) [rad/s].

    A wrist's is its speed over the arm's length: angles of a shoulder change fast near gimbal lock.
    """
    index, sizes = human_model(motion.body).body_index, motion.body.segments
    torso = segments.rotation[:, index["torso"]]
    found = np.empty((len(motion), len(LIMBS)))
    for side, name in enumerate(SIDES):
        reach = segments.position[:, index[f"hand_{name}"]] - segments.position[:, index[f"humerus_{name}"]]
        local = np.einsum("tji,tj->ti", torso, reach)
        found[:, side] = np.linalg.norm(derivative(local, motion.fps), axis=1) / (sizes.upper_arm + sizes.forearm)
    head = np.einsum("tji,tjk->tik", torso, segments.rotation[:, index["head"]])
    # Each of the three axes of a frame that turns at w moves at |w x axis|, whose squares sum to 2 w².
    found[:, -1] = np.linalg.norm(derivative(head, motion.fps), axis=(1, 2)) / np.sqrt(2.0)
    return found
