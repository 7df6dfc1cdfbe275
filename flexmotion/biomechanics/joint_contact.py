"""Joint contact forces: what bones press on each other with, once muscles pull across the joint.

The segments beyond a joint need a force; muscles that cross it, and the ground, give a part; the joint gives the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.dynamics import Dynamics
from flexmotion.biomechanics.inverse_dynamics import effort
from flexmotion.biomechanics.segment_motion import carried
from flexmotion.biomechanics.static_optimisation import MuscleState
from flexmotion.human.human_model import human_model
from flexmotion.human.skeleton import JOINTS, SIDES

Float = NDArray[np.float64]

BEYOND = {
    "hip": ("femur", "hip_flexion"),
    "knee": ("tibia", "knee_flexion"),
    "ankle": ("talus", "ankle_dorsiflexion"),
    "lumbar": ("torso", "lumbar_extension"),
}
"""Joint -> segment beyond it, and a coordinate of ours that turns it."""

# The muscle models' segments have x forward, y up, z right.
FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def joint_contact_forces(found: Dynamics, muscles: MuscleState) -> Float:
    """Force on the segment beyond each of `muscles.crossings`, in that segment's axes, (T, 7, 3) [N].

    z points along the segment to the joint: a compressed hip or knee has a negative z, a compressed lumbar joint, whose
    torso stands on it, a positive one. The knee's axes are turned by up to 7° (its model's glide).
    """
    body, segments = found.motion.body, found.segments
    assert found.motion.wrenches is not None
    force = effort(segments, body, found.loads).force.copy()
    index = human_model(body).body_index
    for foot, name in enumerate(SIDES):
        force[:, index[f"calcaneus_{name}"]] -= found.motion.wrenches[:, foot, :3]
    across = np.einsum("jb,tbi->tji", carried(body), force)
    contact = np.empty((len(found.motion), len(muscles.crossings), 3))
    for column, crossing in enumerate(muscles.crossings):
        base, _, side = crossing.partition("_")
        suffix = f"_{side}" if side else ""
        segment, coordinate = BEYOND[base]
        rotation = segments.rotation[:, index[segment + suffix]]
        needed = np.einsum("tji,tj->ti", rotation, across[:, JOINTS.index(coordinate + suffix)])
        contact[:, column] = needed - muscles.muscle_pull[:, column] @ FROM_Y_UP.T
    return contact
