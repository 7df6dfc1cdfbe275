"""`unhurried`: shoulders turn no faster than people turn theirs on their way from one pose to another.

A decoder that is to leave a pose for one that never followed it in the data mixes the two. Where the columns of their
rotations cancel the mix turns over: of an arm that pointed up and was to hang in a dash the shoulder turned by 102° in
a frame, and the hand went 17 m/s.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.joint_groups import BALLS, PELVIS_SIZE, matrix, six
from flexmotion.features.layout import Layout
from flexmotion.spatial.rotations import matrices, matrix_quaternions, rotation_vectors, vector_quaternions
from flexmotion.spatial.transitions import decaying

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

FASTEST, CALM = 13.0, 5.5
"""Fastest turns of an upper arm [rad/s]: 1 in 1,000 recorded frames of the liveliest manners and of dashes is faster
(12.4 to 13.3), and of gestures in the normal manner (waves 5.3 to 5.6, raised hands 5.3, arms that point 4.5)."""

SPIN = 1.4
"""A shoulder as a whole, its turn about the upper arm included, may turn this much faster (waves 7.3, raises 7.4)."""

LED = 4.0
"""Fastest turn of the way on which a shoulder is led instead [rad/s]: 1 % of the frames of people who walk or point are
faster (4.0, 3.7)."""

SHORTEST_S = 0.11
"""Least time constant of that way [s]: that of joins, see `inertialise`."""

SHOULDERS = tuple(number for number, ball in enumerate(BALLS) if ball[0].startswith("shoulder"))


def unhurried(frames: Float32, history: Float32, layout: Layout, fastest: float) -> Float32:
    """The window with shoulders that turn too fast led from where they are to where they go after that.

    Args:
        frames: features of the window that continue the history, not normalised, (W, layout.size), W >= 2.
        history: features of the frames before, likewise, (H, layout.size); with fewer than two the speed is unknown
            and the window is unchanged.
        layout: of both.
        fastest: turn of an upper arm that is not too fast [rad/s].

    Returns:
        The window itself where none turns too fast; of the others the rotation of the shoulder alone is changed.
    """
    if len(history) < 2:
        return frames
    first = layout.blocks["rotations"].start + PELVIS_SIZE
    columns = [slice(first + 6 * ball, first + 6 * ball + 6) for ball in SHOULDERS]
    known = np.concatenate([history[-2:], frames])
    turned = matrix(np.stack([known[:, own] for own in columns]).astype(np.float64))
    # Cosines of the turns from each frame to the next: of each axis, of which the third is along the upper arm.
    cosines = np.einsum("stij,stij->stj", turned[:, 1:-1], turned[:, 2:])
    whole, arm = 0.5 * (cosines.sum(axis=-1) - 1.0), cosines[..., 2]
    calm = (arm >= np.cos(fastest / layout.fps)) & (whole >= np.cos(SPIN * fastest / layout.fps))
    if calm.all():
        return frames
    found = frames.copy()
    for own, rotations, slow in zip(columns, turned, calm, strict=True):
        if not slow.all():
            led = _led(rotations, int(np.flatnonzero(~slow)[-1]), layout.fps)
            found[:, own] = six(led)
    return found


def _led(rotations: Float, arrives: int, fps: float) -> Float:
    """A joint's rotations on a way of its own to those from a frame on, by the shortest rotation, (W, 3, 3).

    Args:
        rotations: in the two frames before the window and in it, (2 + W, 3, 3).
        arrives: the frame of the window from which on they are what is led to.
        fps: frames per second.
    """
    known, goal = rotations[:2], rotations[2:].copy()
    goal[:arrives] = goal[arrives]
    away = rotation_vectors(matrix_quaternions(goal[0].T @ known))
    size = float(np.linalg.norm(away[1]))
    if away[0] @ away[1] < 0.0 and np.linalg.norm(away[0]) > np.pi / 2:
        away[0] -= 2.0 * np.pi * away[0] / np.linalg.norm(away[0])  # counted on beyond half a turn
    # A critically damped distance x is at its fastest x / (e time constant).
    constant = max(SHORTEST_S, size / (np.e * LED))
    time = np.arange(1, len(goal) + 1)[:, None] / fps
    left = decaying(away[1], (away[1] - away[0]) * fps, 1.0 / constant, time)
    return goal @ matrices(vector_quaternions(left))
