"""The mirror image of a motion, with left and right swapped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import CONTACT_JOINTS, JOINTS

Float = NDArray[np.float64]

ODD = frozenset({"lumbar_bending", "lumbar_rotation", "neck_bending", "neck_rotation"})
"""Joints of the trunk whose sign changes in the mirror image; those of both sides have the same sign convention."""


def _partner(joint: str) -> str:
    return joint[:-1] + {"l": "r", "r": "l"}[joint[-1]] if joint.endswith(("_l", "_r")) else joint


ORDER = np.array([JOINTS.index(_partner(joint)) for joint in JOINTS])
SIGN = np.array([-1.0 if joint in ODD else 1.0 for joint in JOINTS])

CONTACT_ORDER = np.array([CONTACT_JOINTS.index(_partner(joint)) for joint in CONTACT_JOINTS])

POLAR = np.array([1.0, -1.0, 1.0])
"""Signs of positions and forces mirrored in the sagittal plane y = 0."""

AXIAL = -POLAR
"""Signs of moments and rotation vectors."""


def mirror(motion: Motion) -> Motion:
    """A motion mirrored in the plane y = 0, with its dynamics.

    Activations are dropped: the two sides' muscle paths are not exact mirror images. Joint contact forces are mirrored;
    those computed from the mirrored motion are the same in the legs and differ by .02 body weights at the lumbar joint.
    """
    centres = motion.pressure_centres
    torques, wrenches, contacts, joint_contact = motion.torques, motion.wrenches, motion.contacts, motion.joint_contact
    if torques is not None:
        root = torques[:, :6] * np.concatenate([POLAR, AXIAL])
        torques = np.concatenate([root, torques[:, 6:][:, ORDER] * SIGN], axis=1)
    return replace(
        motion,
        root_position=motion.root_position * POLAR,
        root_quaternion=motion.root_quaternion * [1.0, *AXIAL],
        joints=motion.joints[:, ORDER] * SIGN,
        torques=torques,
        wrenches=None if wrenches is None else wrenches[:, ::-1] * np.concatenate([POLAR, AXIAL]),
        pressure_centres=None if centres is None else centres[:, ::-1] * POLAR,
        contacts=None if contacts is None else contacts[:, ::-1],
        activations=None,
        joint_contact=None if joint_contact is None else joint_contact[:, CONTACT_ORDER] * POLAR,
    )


def mirrored_loads(loads: Float) -> Float:
    """Mirror image of external forces on torso, left hand and right hand, world axes, (T, 3, 3) [N]."""
    return loads[:, [0, 2, 1]] * POLAR
