"""Motion at another frame rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmotion.human.motion import Motion
from flexmotion.human.signals import resample_quaternions, resample_signal, same_rate


def resample(motion: Motion, fps: float) -> Motion:
    """A motion at another frame rate [1/s], low-passed where the rate goes down; first frame in place.

    Raises:
        ValueError: `fps` is not a positive number.
    """
    if not fps > 0:
        raise ValueError(f"fps is {fps}, expected a positive number")
    if same_rate(motion.fps, fps):
        return replace(motion, fps=fps)

    def signal(value: np.ndarray | None) -> np.ndarray | None:
        return None if value is None else resample_signal(value, motion.fps, fps)

    root_position = resample_signal(motion.root_position, motion.fps, fps)
    nearest = np.minimum(np.round(np.arange(len(root_position)) * motion.fps / fps).astype(int), len(motion) - 1)
    activations = signal(motion.activations)
    return replace(
        motion,
        fps=fps,
        root_position=root_position,
        root_quaternion=resample_quaternions(motion.root_quaternion, motion.fps, fps),
        joints=resample_signal(motion.joints, motion.fps, fps),
        torques=signal(motion.torques),
        wrenches=signal(motion.wrenches),
        pressure_centres=signal(motion.pressure_centres),
        joint_contact=signal(motion.joint_contact),
        # The filter overshoots at steps; activations are within [0, 1].
        activations=None if activations is None else activations.clip(0.0, 1.0),
        contacts=None if motion.contacts is None else motion.contacts[nearest],
    )
