"""Legs that bring their ankles or soles to places, in closed form: `reached`, `shifted`.

The knee gives the distance of hip and ankle by the law of cosines, the hip turns the leg by the least rotation, and the
ankle keeps the pitch of the foot, since it has that axis alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import doubles
from flexmotion.features.joint_groups import BALL_COLUMNS, BALLS, ball_angles, ball_matrices
from flexmotion.human.body import Body
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import SIDES
from flexmotion.sampling import leg_loops
from flexmotion.sampling.leg_length import ANKLES, KNEES, lengths
from flexmotion.sampling.leg_loops import eased

Float = NDArray[np.float64]

TILTS = 3
"""Times that a leg is solved for its sole, which tilts with it: moved by .1 m it is 17 mm off, then 3, then .5."""
SMOOTH = np.array([1, 2, 3, 2, 1]) / 9.0
"""Filter over frames, of changes of a leg's angles."""

HIP_BALLS = [[ball[0] for ball in BALLS].index(f"hip_flexion_{side}") for side in SIDES]
"""Left and right hip among `joint_groups.BALLS`."""
_HIPS = BALL_COLUMNS[HIP_BALLS]


def reached(body: Body, hips: Float, knees: Float, ankles: Float, wanted: Float) -> tuple[Float, Float, Float]:
    """Rotations of the hips, (T, 2, 3, 3), and angles of knees and ankles, (T, 2) each, of legs that reach to ankles.

    Args:
        body: of the human.
        hips: rotations of left and right hip in the pelvis, (T, 2, 3, 3).
        knees, ankles: flexion and dorsiflexion, (T, 2) [rad].
        wanted: from the hips to the ankles in the axes of the pelvis, (T, 2, 3) [m].
    """
    own = doubles
    return leg_loops.reached(lengths(body), own(hips), own(knees), own(ankles), own(wanted))


def shifted(motion: Motion, by: Float, before: Float) -> Motion:
    """The motion with the middle of its soles moved by `by`, as far as the legs reach; feet keep their pitch.

    Args:
        motion: with knees that do not bend backward, as `lowered` leaves them.
        by: of left and right foot, (T, 2, 3) [m].
        before: joint angles of the frame before the first, (26,) [rad].
    """
    hips, bent, dorsal = leg_loops.moved(
        lengths(motion.body),
        ball_matrices(motion.joints, HIP_BALLS),
        doubles(motion.joints[:, KNEES]),
        doubles(motion.joints[:, ANKLES]),
        doubles(by),
        doubles(motion.root_quaternion),
        TILTS,
    )
    joints = motion.joints.copy()
    joints[:, _HIPS] = ball_angles(hips, before[_HIPS], HIP_BALLS)
    joints[:, KNEES], joints[:, ANKLES] = bent, dorsal
    return motion.changed(joints=joints)


def smoothly_shifted(motion: Motion, by: Float, before: Float) -> Motion:
    """`shifted` with changes of the angles that are smoothed over frames.

    A leg that is nearly straight bends by degrees for a millimetre. Soles are off by as
    little where `by` changes slowly.
    """
    changed = shifted(motion, by, before).joints
    return motion.changed(joints=eased(doubles(motion.joints), changed, SMOOTH, joint_limits()))


def turned(rotation: Float, vector: Float) -> Float:
    """Vectors (..., 3) turned by rotations (..., 3, 3)."""
    return np.asarray((rotation @ vector[..., None])[..., 0])
