"""Figures of a stretch of walking by which its manner is told, the same for recorded and for generated motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.shared.judges import frame_velocities
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.spatial.heading import continuous_matrix_heading

Float = NDArray[np.float64]

SECONDS = 2.0
"""Length of a stretch: about two steps of each foot [s]."""

APART = 0.5
"""From the beginning of one stretch to that of the next [s]."""

SLOWEST = 0.25
"""Least mean speed of a stretch of walking [m/s]."""


def stretches(motion: Motion) -> list[Motion]:
    """Stretches of a motion in which the human walks; the shorter part of the motion at its end is left out."""
    length, apart = round(SECONDS * motion.fps), round(APART * motion.fps)
    found = [motion[first : first + length] for first in range(0, len(motion) - length + 1, apart)]
    return [part for part in found if _speed(part) >= SLOWEST]


def _speed(motion: Motion) -> float:
    moved = np.linalg.norm(motion.root_position[-1, :2] - motion.root_position[0, :2])
    return float(moved * motion.fps / (len(motion) - 1))


def gait_features(motion: Motion) -> Float:
    """Figures of one stretch, (F,); left and right are symmetrical, so that a mirror image has the same.

    Means, spreads and mean speeds of the joint angles, of both sides together and apart as absolute difference;
    velocities in the heading; height and tilt of the trunk; frequency of steps.
    """
    human = forward(motion)
    rows = [motion.joints.mean(axis=0), motion.joints.std(axis=0), np.abs(np.diff(motion.joints, axis=0)).mean(axis=0)]
    left = [at for at, name in enumerate(JOINTS) if name.endswith("_l")]
    right = [JOINTS.index(f"{JOINTS[at][:-2]}_r") for at in left]
    middle = [at for at in range(len(JOINTS)) if at not in (*left, *right)]
    parts: list[Float] = []
    for number, row in enumerate(rows):
        scale = motion.fps if number == 2 else 1.0
        parts += [scale * (row[left] + row[right]) / 2, scale * np.abs(row[left] - row[right])]
        parts.append(scale * (np.abs(row[middle]) if number == 0 else row[middle]))
    # Of the trunk's angles extension alone has a sign that a mirror image keeps.
    parts.append(rows[0][[at for at in middle if "extension" in JOINTS[at]]])
    velocity = frame_velocities(motion)
    leg = motion.body.leg
    height = human.pelvis_position[:, 2] / leg
    yaw = continuous_matrix_heading(human.pelvis_rotation)
    up = human.torso_rotation[:, :, 2]
    ahead = np.cos(yaw) * up[:, 0] + np.sin(yaw) * up[:, 1]
    swing = human.ankle[:, 0, :2] - human.ankle[:, 1, :2]
    along = np.cos(yaw) * swing[:, 0] + np.sin(yaw) * swing[:, 1]
    across = np.abs(np.cos(yaw) * swing[:, 1] - np.sin(yaw) * swing[:, 0])
    crossings = np.count_nonzero(np.diff(np.sign(along - along.mean()))) * motion.fps / len(motion)
    parts.append(
        np.array(
            [
                velocity[:, 0].mean() / leg,
                velocity[:, 0].std() / leg,
                np.abs(velocity[:, 1]).mean() / leg,
                np.abs(velocity[:, 2]).mean(),
                height.mean(),
                height.std(),
                ahead.mean(),
                ahead.std(),
                np.abs(along).mean() / leg,
                across.mean() / leg,
                crossings,
            ]
        )
    )
    return np.concatenate(parts)
