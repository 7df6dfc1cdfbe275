"""Figures of how a motion is done: trunk, wrists, elbows, steps, and the time in the pose that is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.shared.poses import POSES, Mask, elbow_bend, from_pelvis
from flexmotion.human.body import Body
from flexmotion.human.contacts import ContactDetector
from flexmotion.human.kinematics import HumanKinematics, foot_points, forward
from flexmotion.human.motion import Motion

Float = NDArray[np.float64]

FIGURES: dict[str, tuple[str, float]] = {
    "trunk pitch": ("°", 1.0),
    "left wrist": ("cm", 1.0),
    "right wrist": ("cm", 1.0),
    "left elbow": ("°", 3.0),
    "right elbow": ("°", 3.0),
    "step width": ("cm", 0.5),
    "time in pose": ("%", 5.0),
}
"""Unit of each figure, and the least distance of two distributions that counts: nobody sees a smaller one."""

STRIDE_S, SHORTEST = 1.0, 0.2
"""Time of a stride [s], and the least way over it that is a line of progression [m]."""


def on_body(motion: Motion, body: Body) -> Motion:
    """The joint angles of a motion on another body, without its forces; it goes as many leg lengths.

    The root is lifted or lowered by the same in all frames: the soles are as far from the floor as before.
    """
    if body == motion.body:
        return motion.kinematics
    ratio = body.leg / motion.body.leg
    own = replace(motion.kinematics, body=body, root_position=motion.root_position * ratio)
    # Legs of other proportions end elsewhere: without this, clips of some bodies stood 5 cm deep in the floor.
    above = _sole_height(motion) * ratio - _sole_height(own)
    return replace(own, root_position=own.root_position + [0.0, 0.0, above])


def _sole_height(motion: Motion) -> float:
    """Height of the lowest point of the soles over the floor, median over the frames [m]."""
    return float(np.median(foot_points(motion)[..., 2].min(axis=(1, 2))))


def figures(motion: Motion, pose: Mask | None = None) -> dict[str, Float]:
    """Values of every one of `FIGURES`, one a frame; of steps one a touch-down; of the pose one a motion.

    Trunk pitch is forward; a wrist's height is over the floor; an elbow's angle is its flexion; the width of a step is
    the distance of the ankles across the line of progression.

    Args:
        motion: on the body that all are compared on.
        pose: frames in the pose that is asked for, (T,); None where none is asked for.
    """
    human = forward(motion)
    ahead, _, up = from_pelvis(human, human.torso_rotation[:, None, :, 2])[:, 0].T
    return {
        "trunk pitch": np.degrees(np.arctan2(ahead, up)),
        "left wrist": 100 * human.wrist[:, 0, 2],
        "right wrist": 100 * human.wrist[:, 1, 2],
        "left elbow": elbow_bend(human, 0),
        "right elbow": elbow_bend(human, 1),
        "step width": 100 * step_widths(human, motion.fps),
        "time in pose": np.array([]) if pose is None else np.array([100 * pose.mean()]),
    }


def in_pose(motion: Motion, check: Mapping[str, Any]) -> Mask | None:
    """Frames in all poses that a check asks for, (T,); None where it asks for none.

    Looks and squats count from the first frame: give whole motions, that begin before the pose.
    """
    human = forward(motion)
    poses = [POSES[name](motion, human, wanted) for name, wanted in check.items() if name in POSES]
    return np.logical_and.reduce(poses) if poses else None


def step_widths(human: HumanKinematics, fps: float) -> Float:
    """Distance of the ankles across the line of progression at touch-downs of a body that goes somewhere, (K,) [m].

    The line is the pelvis's way over a stride. Across the heading of the pelvis at touch-down, which is turned by 9°, a
    step of .6 m is 9 cm wider than it is.
    """
    loaded, _ = ContactDetector().detect(human, fps)
    landed = np.flatnonzero((loaded[1:] & ~loaded[:-1]).any(axis=1)) + 1
    half, place = round(0.5 * STRIDE_S * fps), human.pelvis_position[:, :2]
    way = place[np.minimum(landed + half, len(place) - 1)] - place[np.maximum(landed - half, 0)]
    apart = (human.ankle[:, 0] - human.ankle[:, 1])[landed, :2]
    length = np.linalg.norm(way, axis=-1)
    facing = human.pelvis_rotation[landed, :2, 0]
    # Of a body that goes backward the left foot is to the right of its way.
    along = np.sign((way * facing).sum(axis=1))
    across = along * (way[:, 0] * apart[:, 1] - way[:, 1] * apart[:, 0])
    widths: Float = across[length > SHORTEST] / length[length > SHORTEST]
    return widths
