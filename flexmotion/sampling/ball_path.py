"""`led_joints`, `settled_joints`: joints on their way to a pose, joints of three hinges by the shortest rotation.

Three hinge angles have two solutions for every rotation, and an arm that is held out to the side is near the place
where they meet: led angle by angle, wrists moved by .9 m from one frame to the next, or all the way round.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.features.joint_groups import BALL_COLUMNS, ball_angles, ball_matrices
from flexmotion.sampling.settling import settled

Float = NDArray[np.float64]

FAR = 2.0
"""Rotations by more than this [rad] may turn over from frame to frame: they are counted on beyond half a turn."""


def led_joints(joints: Float, pose: Float, columns: Collection[int], share: Float, before: Float) -> Float:
    """Joints of which some are a share of the way from where they are to a pose, (T, 26) [rad].

    Args:
        joints: (T, 26) [rad].
        pose: (26,) [rad].
        columns: joints that are led.
        share: of every frame, (T, 1), from 0 to 1.
        before: joints of the frame before the first, (26,) [rad].
    """
    balls, single = _parts(columns)
    found = joints.copy()
    found[:, single] += share * (_nearest(pose[single], before[single]) - joints[:, single])
    if balls:
        own, goal = ball_matrices(joints), ball_matrices(pose)
        for ball in balls:
            way = _counted((Rotation.from_matrix(own[:, ball]).inv() * Rotation.from_matrix(goal[ball])).as_rotvec())
            own[:, ball] = own[:, ball] @ Rotation.from_rotvec(share * way).as_matrix()
        found[:, BALL_COLUMNS[balls]] = ball_angles(own, before[BALL_COLUMNS])[:, balls]
    return found


def settled_joints(
    known: Float, pose: Float, columns: Collection[int], frames: int, fps: float, seconds: float
) -> Float:
    """Joints that come to rest in a pose from where they are, as `settled` does, (T, 26) [rad]; others are as `pose`.

    Args:
        known: joints before, at least one frame, (K, 26) [rad].
        pose: (26,) [rad].
        columns: joints that settle.
        frames, fps, seconds: see `settled`.
    """
    balls, single = _parts(columns)
    found = np.tile(pose, (frames, 1))
    found[:, single] = settled(known[:, single], _nearest(pose[single], known[-1, single]), frames, fps, seconds)
    if balls:
        before, goal = ball_matrices(known), ball_matrices(pose)
        own = np.tile(goal, (frames, 1, 1, 1))
        for ball in balls:
            there = Rotation.from_matrix(goal[ball])
            away = _counted((there.inv() * Rotation.from_matrix(before[:, ball])).as_rotvec())
            path = settled(away, np.zeros(3), frames, fps, seconds)
            own[:, ball] = (there * Rotation.from_rotvec(path)).as_matrix()
        found[:, BALL_COLUMNS[balls]] = ball_angles(own, known[-1, BALL_COLUMNS])[:, balls]
    return found


def _parts(columns: Collection[int]) -> tuple[list[int], list[int]]:
    """Joints of three hinges that are led as a whole, by their numbers, and the other columns."""
    balls = [ball for ball, own in enumerate(BALL_COLUMNS.tolist()) if set(own) <= set(columns)]
    whole = {column for ball in balls for column in BALL_COLUMNS[ball].tolist()}
    return balls, [column for column in columns if column not in whole]


def _nearest(angles: Float, to: Float) -> Float:
    """Angles by whole turns nearest to others: a forearm that has turned all round goes on where it is."""
    found: Float = angles + 2 * np.pi * np.round((to - angles) / (2 * np.pi))
    return found


def _counted(vectors: Float) -> Float:
    """Rotation vectors, (T, 3), that do not turn over from frame to frame where they pass half a turn."""
    found = vectors.copy()
    for before, own in zip(found[:-1], found[1:], strict=True):
        size = float(np.linalg.norm(own))
        if size > FAR and before @ own < 0.0:
            own -= 2 * np.pi / size * own
    return found
