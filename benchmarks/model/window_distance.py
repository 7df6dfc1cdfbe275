"""Windows of motion as points, whose distance measures how differently two bodies move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.model.posture_figures import on_body
from flexmotion.features.encode import body_points
from flexmotion.features.heading_frame import turned
from flexmotion.human.body import Body
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.spatial.heading import continuous_matrix_heading

Float32 = NDArray[np.float32]

EVERY = 4
"""Every so many frames of a window one is compared; those between follow from them."""

CHUNK = 20_000
"""Windows compared at a time."""


def windows_of(motion: Motion, body: Body, length: int, stride: int) -> Float32:
    """Windows of a motion, (N, D): positions of the body's points, seen from below the pelvis of the first frame.

    Euclidean distance is the root mean square over points and frames, in leg lengths. Travel and turning count.

    Args:
        motion: of T frames.
        body: that all motions are mapped to, so that equal joint angles have distance 0.
        length: of a window [frames].
        stride: from one window to the next [frames].
    """
    motion = on_body(motion, body)
    human = forward(motion)
    points, yaw = body_points(human), continuous_matrix_heading(human.pelvis_rotation)
    starts = np.arange(0, len(motion) - length + 1, stride)
    rows = starts[:, None] + np.arange(0, length, EVERY)
    origin = motion.root_position[starts] * [1.0, 1.0, 0.0]
    seen = turned(points[rows] - origin[:, None, None], -yaw[starts]) / motion.body.leg
    return (seen.reshape(len(starts), int(np.prod(seen.shape[1:]))) / np.sqrt(seen.shape[1] * seen.shape[2])).astype(
        np.float32
    )


def nearest_distance(windows: Float32, among: Float32) -> NDArray[np.float64]:
    """Distance of each window, (N, D), to the nearest of others, (M, D) -> (N,)."""
    own = np.square(windows, dtype=np.float64).sum(axis=1)
    least = np.full(len(windows), np.inf)
    for start in range(0, len(among), CHUNK):
        part = among[start : start + CHUNK]
        squared = own[:, None] - 2.0 * (windows @ part.T) + np.square(part, dtype=np.float64).sum(axis=1)
        least = np.minimum(least, squared.min(axis=1))
    return np.sqrt(np.maximum(least, 0.0))


def mean_distance(windows: Float32) -> float:
    """Mean distance between two different ones of N windows, (N, D), N >= 2."""
    first, second = np.triu_indices(len(windows), 1)
    return float(np.linalg.norm(windows[first] - windows[second], axis=1).mean())
