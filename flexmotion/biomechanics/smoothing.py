"""Low-pass filter for motion; rotations are filtered as quaternions, which have no gimbal lock.

The filter is a smoothing spline (quintic, on the frames' grid), as common in movement analysis: H. J. Woltring,
"A Fortran package for generalized, cross-validatory spline smoothing and differentiation", Adv. Eng. Software 8, 1986.
Within a clip it is a zero-phase Butterworth low-pass of third order, 1 / (1 + (f/f_c)⁶). At the ends of a clip it
assumes constant acceleration; a recursive filter needs an assumed continuation, which distorts accelerations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.spatial.transform import Rotation

from flexmotion.human.angles import three_angle_rotation, three_angles
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

CUTOFF = 6.0
"""Common for human gait (Winter, Biomechanics and Motor Control of Human Movement) [Hz]."""

BALL_JOINTS: tuple[tuple[tuple[str, str, str], str], ...] = (
    (("lumbar_extension", "lumbar_bending", "lumbar_rotation"), ""),
    (("neck_extension", "neck_bending", "neck_rotation"), ""),
    *((("hip_flexion", "hip_adduction", "hip_rotation"), side) for side in SIDES),
    *((("shoulder_flexion", "shoulder_adduction", "shoulder_rotation"), side) for side in SIDES),
)
"""Joints of three coordinates and their side."""


DIFFERENCES = np.array([-1.0, 3.0, -3.0, 1.0])
"""Third difference, whose square the spline penalises."""


def smoothing_spline(signal: Float, fps: float, cutoff: float | Float) -> Float:
    """The signal low-passed at a cut-off frequency [Hz], where its gain is one half, (T, ...) -> (T, ...).

    The cut-off may be one of each frame, (T,).
    """
    frames, order = len(signal), len(DIFFERENCES) - 1
    if frames <= order:
        return signal
    # Whittaker-Henderson: minimise |x - signal|² + penalty |D x|², a banded system.
    # Every third difference is penalised by the cut-off at its middle.
    local = np.broadcast_to(cutoff, frames)[order // 2 : order // 2 + frames - order]
    penalty = (2 * np.sin(np.pi * np.minimum(local / fps, 0.5))) ** (-2 * order)
    bands = np.zeros((order + 1, frames))
    for first in range(order + 1):
        for second in range(first, order + 1):
            # Diagonal k of D'D sums the products of weights that are k apart.
            bands[order - (second - first), second : frames - order + second] += (
                penalty * DIFFERENCES[first] * DIFFERENCES[second]
            )
    bands[order] += 1.0
    solved: Float = solveh_banded(bands, signal.reshape(frames, -1))
    return solved.reshape(signal.shape)


def smooth(motion: Motion, cutoff: float | Float = CUTOFF) -> Motion:
    """Kinematics low-passed at a cut-off frequency [Hz], or one of each frame, without delay; no other fields."""
    if np.min(cutoff) >= motion.fps / 2 or len(motion) < 2:
        return replace(motion, torques=None, wrenches=None, pressure_centres=None, activations=None, joint_contact=None)

    def filtered(quaternions: Float) -> Float:
        result = smoothing_spline(continuous_quaternions(quaternions), motion.fps, cutoff)
        normal: Float = result / np.linalg.norm(result, axis=-1, keepdims=True)
        return normal

    joints = smoothing_spline(motion.joints, motion.fps, cutoff)
    for names, side in BALL_JOINTS:
        columns = [JOINTS.index(f"{name}_{side}" if side else name) for name in names]
        quaternions = three_angle_rotation(motion.joints[:, columns], names, side).as_quat()
        joints[:, columns] = three_angles(Rotation.from_quat(filtered(quaternions)).as_matrix(), names, side)
    return replace(
        motion,
        root_position=smoothing_spline(motion.root_position, motion.fps, cutoff),
        root_quaternion=filtered(motion.root_quaternion),
        joints=joints,
        torques=None,
        wrenches=None,
        pressure_centres=None,
        activations=None,
        joint_contact=None,
    )
