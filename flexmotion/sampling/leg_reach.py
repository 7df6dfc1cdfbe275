"""Legs that bring their ankles or soles to places, in closed form: `reached`, `shifted`.

The knee gives the distance of hip and ankle by the law of cosines, the hip turns the leg by the least rotation, and the
ankle keeps the pitch of the foot, since it has that axis alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from flexmotion.features.joint_groups import BALL_COLUMNS, BALLS, ball_angles, ball_matrices
from flexmotion.human.body import Body
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import SIDES
from flexmotion.human.vectors import cross, unit
from flexmotion.sampling.leg_length import ANKLES, KNEES, knee_at, leg_length, within_reach
from flexmotion.spatial.rotations import add_cross, matrices

Float = NDArray[np.float64]

TILTS = 3
"""Times that a leg is solved for its sole, which tilts with it: moved by .1 m it is 17 mm off, then 3, then .5."""
AHEAD = np.array([1.0, 0.0, 0.0])
SMOOTH = np.array([1, 2, 3, 2, 1]) / 9.0
"""Filter over frames, of changes of a leg's angles."""

HIP_BALLS = [[ball[0] for ball in BALLS].index(f"hip_flexion_{side}") for side in SIDES]
"""Left and right hip among `joint_groups.BALLS`."""


def reached(body: Body, hips: Float, knees: Float, ankles: Float, wanted: Float) -> tuple[Float, Float, Float]:
    """Rotations of the hips, (T, 2, 3, 3), and angles of knees and ankles, (T, 2) each, of legs that reach to ankles.

    Args:
        body: of the human.
        hips: rotations of left and right hip in the pelvis, (T, 2, 3, 3).
        knees, ankles: flexion and dorsiflexion, (T, 2) [rad].
        wanted: from the hips to the ankles in the axes of the pelvis, (T, 2, 3) [m].
    """
    thigh, shank = body.segments.thigh, body.segments.shank
    distance = np.sqrt(np.einsum("tsi,tsi->ts", wanted, wanted))
    bent = knee_at(thigh, shank, within_reach(thigh, shank, leg_length(thigh, shank, knees), distance))
    found = _least_rotation(unit(turned(hips, leg(body, bent))), unit(wanted)) @ hips
    pitch = knees - ankles
    ahead = turned(found.swapaxes(-1, -2), turned(hips, pitched(pitch, AHEAD)))
    more = np.arctan2(-ahead[..., 2], ahead[..., 0]) - pitch
    return found, bent, bent - pitch - (more - 2 * np.pi * np.round(more / (2 * np.pi)))


def shifted(motion: Motion, by: Float, before: Float) -> Motion:
    """The motion with the middle of its soles moved by `by`, as far as the legs reach; feet keep their pitch.

    Args:
        motion: with knees that do not bend backward, as `lowered` leaves them.
        by: of left and right foot, (T, 2, 3) [m].
        before: joint angles of the frame before the first, (26,) [rad].
    """
    body, segments = motion.body, motion.body.segments
    sole = np.array([0.5 * (segments.ball - segments.heel), 0.0, -segments.ankle_height])
    hips = ball_matrices(motion.joints, HIP_BALLS)
    knees, ankles = motion.joints[:, KNEES], motion.joints[:, ANKLES]
    # From hip to ankle, and from there to the sole, in the axes of the pelvis.
    own, beyond = turned(hips, leg(body, knees)), turned(hips, pitched(knees - ankles, sole))
    moves = np.asarray(by.any(axis=-1))
    by = turned(matrices(motion.root_quaternion)[:, None].swapaxes(-1, -2), by)
    found, bent, dorsal, foot = hips, knees, ankles, beyond
    for _ in range(TILTS):
        found, bent, dorsal = reached(body, hips, knees, ankles, own + by + beyond - foot)
        foot = turned(found, pitched(bent - dorsal, sole))
    hips = np.where(moves[..., None, None], found, hips)
    joints = motion.joints.copy()
    joints[:, BALL_COLUMNS[HIP_BALLS]] = ball_angles(hips, before[BALL_COLUMNS[HIP_BALLS]], HIP_BALLS)
    joints[:, KNEES] = np.where(moves, bent, knees)
    joints[:, ANKLES] = np.where(moves, dorsal, ankles)
    return motion.changed(joints=joints)


def smoothly_shifted(motion: Motion, by: Float, before: Float) -> Motion:
    """`shifted` with changes of the angles that are smoothed over frames.

    A leg that is nearly straight bends by degrees for a millimetre. Soles are off by as
    little where `by` changes slowly.
    """
    change = shifted(motion, by, before).joints - motion.joints
    change -= 2 * np.pi * np.round(change / (2 * np.pi))  # other turns of the same hip
    # It begins from none and goes on at its speed: windows follow each other without a jump of that.
    more = len(SMOOTH) // 2
    ahead = 2.0 * change[-1:] - change[-1 - more : -1][::-1]
    whole = np.concatenate([np.zeros((more, change.shape[1])), change, ahead])
    smooth = convolve1d(whole, SMOOTH, axis=0, mode="nearest")[more : more + len(change)]
    low, high = joint_limits().T
    joints = np.clip(motion.joints + smooth, np.minimum(low, motion.joints), np.maximum(high, motion.joints))
    return motion.changed(joints=joints)


def leg(body: Body, knees: Float) -> Float:
    """From hip to ankle in the axes of the thigh, (..., 3) [m], at knee angles (...) [rad]."""
    thigh, shank = body.segments.thigh, body.segments.shank
    found = np.zeros((*knees.shape, 3))
    found[..., 0], found[..., 2] = -shank * np.sin(knees), -thigh - shank * np.cos(knees)
    return found


def pitched(pitch: Float, vector: Float) -> Float:
    """A vector (3,) turned about the left axis by angles (...) [rad], (..., 3)."""
    cosine, sine = np.cos(pitch), np.sin(pitch)
    x, y, z = vector
    found = np.empty((*pitch.shape, 3))
    found[..., 0], found[..., 1], found[..., 2] = cosine * x + sine * z, y, cosine * z - sine * x
    return found


def turned(rotation: Float, vector: Float) -> Float:
    """Vectors (..., 3) turned by rotations (..., 3, 3)."""
    return np.asarray((rotation @ vector[..., None])[..., 0])


def _least_rotation(start: Float, end: Float) -> Float:
    """Rotation of least angle from one unit vector to another, less than half a turn, (..., 3) -> (..., 3, 3)."""
    axis, cosine = cross(start, end), np.einsum("...i,...i->...", start, end)[..., None]
    found: Float = (axis / (1.0 + cosine))[..., None] * axis[..., None, :]
    np.einsum("...ii->...i", found)[...] += cosine
    add_cross(found, axis)
    return found
