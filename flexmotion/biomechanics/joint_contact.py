"""Joint contact forces between bones, from inverse dynamics and muscle forces.

The contact force is the force that the segments beyond a joint need, less those of the ground and of the muscles that
cross the joint.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.dynamics import Dynamics
from flexmotion.biomechanics.inverse_dynamics import effort
from flexmotion.biomechanics.opensim_names import FROM_Y_UP
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
"""Joint -> segment beyond it, and one of its joint coordinates."""


def joint_contact_forces(found: Dynamics, muscles: MuscleState) -> Float:
    """Force on the segment beyond each of `muscles.crossings`, in that segment's axes, (T, 7, 3) [N].

    z points along the segment to the joint: compression is negative z at hip and knee, and positive z at the lumbar
    joint, which carries the torso. The axes of the knee are rotated by up to 7° (glide of its model).
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
        # The muscle models' segments have OpenSim's axes.
        contact[:, column] = needed - muscles.muscle_pull[:, column] @ FROM_Y_UP.T
    return contact
