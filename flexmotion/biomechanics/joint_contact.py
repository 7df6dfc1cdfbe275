"""Joint contact forces between bones, from inverse dynamics and muscle forces.

The contact force is the force that the segments beyond a joint need, less those of the ground and of the muscles that
cross the joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

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

STANCE = (0.3, 1.2)
"""Duration of a stance phase of walking [s]."""


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


def compression(contact: Float, crossings: Sequence[str], weight: float) -> Float:
    """Compression along the segments of contact forces (T, C, 3) [N], (T, C) [body weights]."""
    # The lumbar joint carries the segment above it, every other joint the segment below.
    up = np.array([1.0 if name == "lumbar" else -1.0 for name in crossings])
    found: Float = up * contact[..., 2] / weight
    return found


def stance_peaks(
    values: Float, crossings: Sequence[str], contacts: NDArray[np.bool_], good: NDArray[np.bool_], fps: float
) -> Float:
    """Peak of each crossing's values as mean over the stance phases of its leg, (C,); NaN without one.

    Stance phases begin and end within the clip, last as long as in walking, and have good frames only. The lumbar
    joint has those of the left leg.

    Args:
        values: such as `compression`, (T, C).
        crossings: names of the C joints.
        contacts: whether left and right foot carry load, (T, 2).
        good: frames that count, (T,).
        fps: frames per second.
    """
    peaks: list[float] = []
    for column, name in enumerate(crossings):
        foot = SIDES.index(name[-1]) if name[-2] == "_" else 0
        edges = np.flatnonzero(np.diff(contacts[:, foot].astype(int)))
        phases = [
            slice(first + 1, last + 1)
            for first, last in pairwise(edges)
            if contacts[first + 1, foot] and STANCE[0] <= (last - first) / fps <= STANCE[1]
        ]
        own = [float(values[phase, column].max()) for phase in phases if good[phase].all()]
        peaks.append(float(np.mean(own)) if own else np.nan)
    return np.array(peaks)
