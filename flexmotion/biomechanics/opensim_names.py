"""Names and axes of OpenSim, as in the full-body model of Rajagopal et al. (IEEE Trans. Biomed. Eng. 63(10), 2016).

OpenSim's axes are x forward, y up, z right; angles have the signs of that model (knee flexion and dorsiflexion are
positive). Names that the model lacks (neck and head) are the project's own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS

Float = NDArray[np.float64]

FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From OpenSim's axes to x forward, y left, z up."""

COORDINATES = {
    "knee_flexion": "knee_angle",
    "ankle_dorsiflexion": "ankle_angle",
    "shoulder_flexion": "arm_flex",
    "shoulder_adduction": "arm_add",
    "shoulder_rotation": "arm_rot",
    "elbow_flexion": "elbow_flex",
    "forearm_pronation": "pro_sup",
}
"""Joints whose coordinate has another name in OpenSim."""

BODIES = {"calcaneus": "calcn"}
"""Segments with another name in OpenSim."""

JOINT_OF_BODY = {
    "pelvis": "ground_pelvis",
    "torso": "back",
    "head": "neck",
    "femur": "hip",
    "tibia": "knee",
    "talus": "ankle",
    "calcaneus": "subtalar",
    "toes": "mtp",
    "humerus": "acromial",
    "ulna": "elbow",
    "radius": "radioulnar",
    "hand": "radius_hand",
}
"""Name of the joint between a segment and its parent."""

ROOT_ROTATIONS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation")
"""Body-fixed rotations of the pelvis about z, x and y."""
ROOT_TRANSLATIONS = ("pelvis_tx", "pelvis_ty", "pelvis_tz")


def y_up(vectors: Float) -> Float:
    """Vectors in OpenSim's axes, (..., 3) -> (..., 3)."""
    return vectors @ FROM_Y_UP


def y_up_rotation(matrices: Float) -> Float:
    """Rotations in OpenSim's axes, of world and segment alike, (..., 3, 3) -> (..., 3, 3)."""
    return FROM_Y_UP.T @ matrices @ FROM_Y_UP


def coordinate_name(joint: str) -> str:
    """OpenSim's name of a joint of `JOINTS`."""
    return _renamed(joint, COORDINATES)


def body_name(segment: str) -> str:
    """OpenSim's name of a segment."""
    return _renamed(segment, BODIES)


def joint_name(segment: str) -> str:
    """OpenSim's name of the joint between a segment and its parent."""
    return _renamed(segment, JOINT_OF_BODY)


def _renamed(name: str, names: dict[str, str]) -> str:
    base, mark, side = name.rpartition("_")
    if mark and side in ("l", "r"):
        return f"{names.get(base, base)}_{side}"
    return names.get(name, name)


def coordinates(motion: Motion) -> dict[str, Float]:
    """Value of every coordinate over time: rotations [rad], then translations [m] of the pelvis, then joints [rad]."""
    euler = _pelvis(motion).as_euler("ZXY")
    rotations = np.unwrap(euler, axis=0).T
    translations = y_up(motion.root_position).T
    values = dict(zip((*ROOT_ROTATIONS, *ROOT_TRANSLATIONS), (*rotations, *translations), strict=True))
    return values | {coordinate_name(joint): motion.joints[:, column] for column, joint in enumerate(JOINTS)}


def generalised_forces(motion: Motion) -> dict[str, Float]:
    """Generalised force of every coordinate over time, named as by OpenSim's inverse dynamics [N·m, N].

    Those of the pelvis are the residuals. Moments about the axes of the pelvis become those about the axes of its three
    rotations.

    Args:
        motion: with torques.
    """
    assert motion.torques is not None
    pelvis = _pelvis(motion)
    tilt = pelvis.as_euler("ZXY")[:, 0]
    # In the world: the first rotation's axis is fixed, the second's turned by the first, the third's the segment's own.
    axes = np.stack(
        [
            np.tile([0.0, 0.0, 1.0], (len(motion), 1)),
            np.stack([np.cos(tilt), np.sin(tilt), np.zeros(len(motion))], axis=-1),
            pelvis.as_matrix()[:, :, 1],
        ],
        axis=1,
    )
    moment = pelvis.apply(y_up(motion.torques[:, 3:6]))
    rotations = np.einsum("tai,ti->at", axes, moment)
    translations = y_up(motion.torques[:, :3]).T
    found = {f"{name}_moment": values for name, values in zip(ROOT_ROTATIONS, rotations, strict=True)}
    found |= {f"{name}_force": values for name, values in zip(ROOT_TRANSLATIONS, translations, strict=True)}
    joints = motion.torques[:, -len(JOINTS) :].T
    return found | {f"{coordinate_name(joint)}_moment": values for joint, values in zip(JOINTS, joints, strict=True)}


def _pelvis(motion: Motion) -> Rotation:
    matrices = Rotation.from_quat(motion.root_quaternion, scalar_first=True).as_matrix()
    return Rotation.from_matrix(y_up_rotation(matrices))
