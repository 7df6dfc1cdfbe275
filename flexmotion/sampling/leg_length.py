"""Feet moved by the legs at constant pitch: `lowered` down or up by stretching or bending them, `shifted` anywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.joint_groups import BALL_COLUMNS, BALLS, ball_angles, ball_matrices
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.human.vectors import cross, unit
from flexmotion.spatial.rotations import matrices

Float = NDArray[np.float64]

STRAIGHT = np.radians(3.0)
"""Least knee flexion that stretching leads to [rad]."""
MOST_BENT = np.radians(140.0)

TILTS = 3
"""Times that a leg is solved. Its foot tilts with it: a sole that is moved by .1 m is 17 mm off, then 3, then .5."""
AHEAD = np.array([1.0, 0.0, 0.0])

_HIPS, _KNEES, _ANKLES = (
    [JOINTS.index(f"{name}_{side}") for side in SIDES] for name in ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")
)
_HIP_BALLS = [[ball[0] for ball in BALLS].index(f"hip_flexion_{side}") for side in SIDES]


def lowered(motion: Motion, down: Float, hip: Float, ankle: Float) -> Motion:
    """The motion with its feet lowered by `down`, as far as the legs reach.

    Each ankle moves along the line from its hip, in the plane of the knee; thigh and shank turn by the law of cosines.
    Knees that bend backward are straightened, since a leg could jump between the two solutions.

    Args:
        down: of left and right foot, negative for up, (T, 2) [m].
        hip, ankle: joint centres of the motion, (T, 2, 3) [m].
    """
    thigh, shank = motion.body.segments.thigh, motion.body.segments.shank
    line = hip - ankle
    length = np.linalg.norm(line, axis=-1)
    # An inclined leg stretches by more than the foot is lowered; the bound keeps nearly level legs from stretching far.
    steep = np.maximum(line[..., 2] / np.maximum(length, 1e-6), 0.5)
    knee = motion.joints[:, _KNEES]
    least, most = (_length(thigh, shank, np.asarray(bend)) for bend in (MOST_BENT, STRAIGHT))
    own = _length(thigh, shank, knee)
    wanted = np.clip(own + down / steep, np.minimum(least, own), np.maximum(most, own))
    cosine = (wanted**2 - thigh**2 - shank**2) / (2.0 * thigh * shank)
    bent = np.where(wanted == own, np.maximum(knee, 0.0), np.arccos(np.clip(cosine, -1.0, 1.0)))
    turned = _behind(thigh, shank, bent) - _behind(thigh, shank, knee)
    joints = motion.joints.copy()
    joints[:, _KNEES] = bent
    joints[:, _HIPS] += turned
    joints[:, _ANKLES] += (bent - knee) - turned
    return replace(motion, joints=joints)


def shifted(motion: Motion, by: Float, before: Float) -> Motion:
    """The motion with the middle of its soles moved by `by`, as far as the legs reach; feet keep their pitch.

    The knee gives the distance of hip and ankle by the law of cosines, the hip turns the leg by the least rotation.

    Args:
        by: of left and right foot, (T, 2, 3) [m].
        before: joint angles of the frame before the first, (26,) [rad].
    """
    segments = motion.body.segments
    thigh, shank = segments.thigh, segments.shank
    sole = np.array([0.5 * (segments.ball - segments.heel), 0.0, -segments.ankle_height])
    balls = ball_matrices(motion.joints)
    hip, knee, ankle = balls[:, _HIP_BALLS], motion.joints[:, _KNEES], motion.joints[:, _ANKLES]
    # From hip to ankle, and from there to the sole, in the axes of the pelvis.
    own, beyond = _turned(hip, _leg(thigh, shank, knee)), _turned(hip, _pitched(knee - ankle, sole))
    by = _turned(matrices(motion.root_quaternion)[:, None].swapaxes(-1, -2), by)
    least, most = (_length(thigh, shank, np.asarray(bend)) for bend in (MOST_BENT, STRAIGHT))
    length = np.linalg.norm(own, axis=-1)
    least, most = np.minimum(least, length), np.maximum(most, length)
    moves, turned, bent, dorsal, foot = np.asarray(by.any(axis=-1)), hip, knee, ankle, beyond
    for _ in range(TILTS):  # a leg that turns tilts its foot, which moves the sole against the ankle
        wanted = own + by + beyond - foot
        cosine = np.clip(np.linalg.norm(wanted, axis=-1), least, most) ** 2 - thigh**2 - shank**2
        bent = np.arccos(np.clip(cosine / (2.0 * thigh * shank), -1.0, 1.0))
        turned = _least_rotation(unit(_turned(hip, _leg(thigh, shank, bent))), unit(wanted)) @ hip
        ahead = _turned(turned.swapaxes(-1, -2), _turned(hip, _pitched(knee - ankle, AHEAD)))
        pitch = np.arctan2(-ahead[..., 2], ahead[..., 0])
        dorsal, foot = bent - pitch, _turned(turned, _pitched(pitch, sole))
    balls[:, _HIP_BALLS] = np.where(moves[..., None, None], turned, hip)
    joints = motion.joints.copy()
    joints[:, BALL_COLUMNS[_HIP_BALLS]] = ball_angles(balls, before[BALL_COLUMNS])[:, _HIP_BALLS]
    joints[:, _KNEES] = np.where(moves, bent, knee)
    joints[:, _ANKLES] = np.where(moves, dorsal, ankle)
    return replace(motion, joints=joints)


def _pitched(pitch: Float, vector: Float) -> Float:
    """A vector (3,) turned about the left axis by angles (...) [rad], (..., 3)."""
    cosine, sine = np.cos(pitch), np.sin(pitch)
    x, y, z = vector
    return np.stack([cosine * x + sine * z, np.full_like(pitch, y), cosine * z - sine * x], axis=-1)


def _leg(thigh: float, shank: float, knee: Float) -> Float:
    """From hip to ankle in the axes of the thigh, (..., 3) [m]."""
    return np.stack([-shank * np.sin(knee), np.zeros_like(knee), -thigh - shank * np.cos(knee)], axis=-1)


def _turned(rotation: Float, vector: Float) -> Float:
    return np.asarray((rotation @ vector[..., None])[..., 0])


def _least_rotation(start: Float, end: Float) -> Float:
    """Rotation of least angle from one unit vector to another, less than half a turn, (..., 3) -> (..., 3, 3)."""
    axis = cross(start, end)
    x, y, z, none = axis[..., 0], axis[..., 1], axis[..., 2], np.zeros(axis.shape[:-1])
    skew = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(*none.shape, 3, 3)
    cosine = np.einsum("...i,...i->...", start, end)[..., None, None]
    found: Float = np.eye(3) + skew + skew @ skew / (1.0 + cosine)
    return found


def _length(thigh: float, shank: float, knee: Float) -> Float:
    """Distance of hip and ankle at a knee angle [m]."""
    found: Float = np.sqrt(thigh**2 + shank**2 + 2.0 * thigh * shank * np.cos(knee))
    return found


def _behind(thigh: float, shank: float, knee: Float) -> Float:
    """Angle at the hip from the thigh back to the ankle [rad]."""
    found: Float = np.arctan2(shank * np.sin(knee), thigh + shank * np.cos(knee))
    return found
