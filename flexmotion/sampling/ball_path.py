"""`led_joints`, `settled_joints`: joints on their way to a pose, joints of three hinges by the shortest rotation.

Three hinge angles have two solutions for every rotation, and an arm that is held out to the side is near the place
where they meet: led angle by angle, wrists moved by .9 m from one frame to the next, or all the way round. An upper arm
goes past the front where the shortest rotation would take it behind the shoulder and above it.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.joint_groups import BALL_COLUMNS, BALLS, ball_angles, ball_matrices
from flexmotion.sampling.settling import settled
from flexmotion.spatial.rotations import matrices, matrix_quaternions, rotation_vectors, vector_quaternions

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]

FAR = 2.0
"""Rotations by more than this [rad] may turn over from frame to frame: they are counted on beyond half a turn."""


SHOULDERS = tuple(number for number, ball in enumerate(BALLS) if ball[0].startswith("shoulder"))
BEHIND, ABOVE = 0.5, 0.2
"""No arm points farther back and up than this at once, as a unit vector seen from the trunk: one that is stretched back
by the shoulder's 60° points down by .5, and a raised arm back by .3."""
LONGEST = 4.5
"""The longest way past the front [rad]: with the time constant of a pose it turns as fast as people, by 5.5 rad/s."""


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
        own, goal = ball_matrices(joints, balls), ball_matrices(pose, balls)
        way = _between(own, goal)
        own = own @ matrices(vector_quaternions(share[..., None] * way))
        found[:, BALL_COLUMNS[balls]] = ball_angles(own, before[BALL_COLUMNS[balls]], balls)
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
        before, goal = ball_matrices(known, balls), ball_matrices(pose, balls)
        away = _in_front(goal, _between(goal, before), balls).reshape(len(known), -1)
        path = settled(away, np.zeros(away.shape[1]), frames, fps, seconds).reshape(frames, -1, 3)
        own = goal @ matrices(vector_quaternions(path))
        found[:, BALL_COLUMNS[balls]] = ball_angles(own, known[-1, BALL_COLUMNS[balls]], balls)
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


def _between(first: Float, second: Float) -> Float:
    """Rotation vectors from one rotation to another in its axes, (T, K, 3, 3) or (K, 3, 3) each -> (T, K, 3) [rad].

    They do not turn over from frame to frame where they pass half a turn.
    """
    found = rotation_vectors(matrix_quaternions(first.swapaxes(-1, -2) @ second))
    size = np.sqrt(np.einsum("tki,tki->tk", found, found))
    for frame, ball in np.argwhere(size[1:] > FAR).tolist():
        before, own = found[frame : frame + 2, ball]
        if before @ own < 0.0:
            own -= 2 * np.pi / size[frame + 1, ball] * own
    return found


def _in_front(goal: Float, away: Float, balls: list[int]) -> Float:
    """Rotation vectors from a goal, the other way round for upper arms that would pass behind and above the shoulder.

    Those that begin or end there go the shortest way, and so does an arm for which the other one is longer than
    `LONGEST`.

    Args:
        goal: rotations, (K, 3, 3).
        away: from the goal to where the joints were, (T, K, 3) [rad].
        balls: which joints they are.
    """
    for place in (place for place, ball in enumerate(balls) if ball in SHOULDERS):
        way = away[:, place]
        size = np.sqrt(np.einsum("ti,ti->t", way, way))[:, None]
        if 2.0 * np.pi - float(size[-1, 0]) > LONGEST:
            continue
        round_ = way - 2.0 * np.pi * way / np.maximum(size, 1e-9)
        behind = _behind(goal[place], way[-1])
        if behind.any() and not (behind[0] or behind[-1] or _behind(goal[place], round_[-1]).any()):
            away[:, place] = round_
    return away


def _behind(goal: Float, way: Float) -> Flags:
    """Where an upper arm is behind and above the shoulder on its way between two rotations, both included, (N,)."""
    shares = np.linspace(0.0, 1.0, 33)[:, None]
    arm = -(goal @ matrices(vector_quaternions(shares * way)))[..., 2]
    return np.asarray((arm[:, 0] < -BEHIND) & (arm[:, 2] > ABOVE))
