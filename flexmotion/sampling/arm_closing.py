"""`closed`: elbows and hands brought to their places by the arms alone, after feet and balance have moved the body.

Planting and balance shift a body by centimetres, and by more the more its legs have changed, so that corrections of the
latent do not converge on a hand's place as it is handed on. Arms hardly move the balance. For residuals r of the places
and changes c of the angles of an arm, over smooth functions of time,

    c = argmin |J c - r|² + damping |c|²

is solved a fixed number of times, forward kinematics in between; a step that brings the arm no nearer is not taken.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from flexmotion.features.constraint_layout import PLACES
from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor
from flexmotion.features.layout import POINTS
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, SIDES
from flexmotion.sampling.window_pose import WindowPose
from flexmotion.spatial.transitions import smoothstep

Float = NDArray[np.float64]

CLOSED = ("elbow", "hand")
"""Points of an arm whose places it keeps."""

MOVED = ARM_JOINTS[:4]
"""Coordinates of shoulder and elbow; pronation does not move the fist."""

ROUNDS, NEAR = 5, 1e-3
"""Steps at most; none is taken where the root mean square of what is missing is smaller than the second [m]."""

SHORTER = 0.3
"""Share of a step that is tried after one that did not bring the arm nearer."""

KNOT_FRAMES = 3.0
"""Distance of the knots of the functions of time: at 30 frames a second they hold what a window below 5 Hz does."""

BEGUN = 4.0
"""Frames within which the change begins: pose and speed of the history are kept."""

FARTHEST = 0.25
"""Distance that one round makes up for [m]: forward kinematics are nearly linear over it."""

TURNED = 0.8
"""Largest change of an angle in one round [rad]: an arm that is nearly straight would swing far for millimetres."""

EVEN = 0.03
"""Weight of the second differences of the knots' values [m²/rad²]: what keyframes ask for is spread between them."""

DAMPING = 1e-3
"""Square of the distance [m²] that a change of one radian is worth: a stretched arm is not swung for a millimetre."""


def closable(constraints: Constraints) -> NDArray[np.bool_]:
    """Columns that arms close, (C,)."""
    found = np.zeros(constraints.layout.size, np.bool_)
    first = constraints.layout.blocks[PLACES].start
    for number, name in enumerate(POINTS):
        found[first + 3 * number : first + 3 * (number + 1)] = name.startswith(CLOSED)
    return found


def closed(motion: Motion, anchor: Anchor, constraints: Constraints) -> Motion:
    """The motion with the elbows and hands that are asked at their places, as far as its arms reach.

    Args:
        motion: the window.
        anchor: the frame before it.
        constraints: what is asked; all else than places of elbows and hands is left.
    """
    first = constraints.layout.blocks[PLACES].start
    asked = constraints.mask[:, first : first + 3 * len(POINTS)].reshape(len(motion), -1, 3)
    places = constraints.values[:, first : first + 3 * len(POINTS)].reshape(len(motion), -1, 3) * motion.body.leg
    arms = [
        ([POINTS.index(f"{point}_{side}") for point in CLOSED], [JOINTS.index(f"{joint}_{side}") for joint in MOVED])
        for side in SIDES
    ]
    arms = [(points, columns) for points, columns in arms if asked[:, points].any()]
    for points, columns in arms:
        motion = _closed(motion, anchor, points, columns, asked, places)
    return motion


def _closed(
    motion: Motion, anchor: Anchor, points: list[int], columns: list[int], asked: NDArray[np.bool_], places: Float
) -> Motion:
    """The motion with one arm closed; see `_change`."""
    pose, share = WindowPose.of(motion, anchor), 1.0
    error = _error(pose, points, asked, places)
    low, high = joint_limits()[columns].T
    enough = NEAR**2 * float(asked[:, points].sum())
    for _ in range(ROUNDS):
        if error < enough:
            break
        own = motion.joints[:, columns]
        joints = motion.joints.copy()
        moved = own + share * _change(pose, points, columns, asked, places)
        # Angles that are beyond their limits already stay where they are.
        joints[:, columns] = np.clip(moved, np.minimum(low, own), np.maximum(high, own))
        tried = replace(motion, joints=joints)
        there = WindowPose.of(tried, anchor)
        left = _error(there, points, asked, places)
        if left < error:
            motion, pose, error = tried, there, left
        else:  # an arm at its limits, or at a singular angle
            share *= SHORTER
    return motion


def _error(pose: WindowPose, points: list[int], asked: NDArray[np.bool_], places: Float) -> float:
    """Sum of the squared distances from asked places [m²]."""
    away = (places - pose.points)[:, points][asked[:, points]]
    return float(away @ away)


def _change(pose: WindowPose, points: list[int], columns: list[int], asked: NDArray[np.bool_], places: Float) -> Float:
    """Change of the angles of an arm, (W, 4) [rad].

    Args:
        points: of the arm.
        columns: its joints.
        asked, places: of all points, (W, 16, 3).
    """
    over = _functions(len(pose.points))
    rows, residuals = [], []
    for point in points:
        frames, coordinates = np.nonzero(asked[:, point])
        lever = pose.points[frames, point][:, None] - pose.anchor[frames][:, columns]
        moved = np.cross(pose.axis[frames][:, columns], lever)  # (R, 4, 3)
        own = moved[np.arange(len(frames)), :, coordinates]
        if point == points[0]:
            own[:, 3] = 0.0  # the elbow does not move itself
        rows.append((own[:, :, None] * over[frames][:, None]).reshape(len(frames), len(columns) * over.shape[1]))
        residuals.append(_missing(pose, point, asked[:, point], places[:, point])[frames, coordinates])
    system = np.concatenate(rows)
    even = np.diff(np.eye(over.shape[1]), n=2, axis=0)
    normal = system.T @ system + EVEN * np.kron(np.eye(len(columns)), even.T @ even)
    normal[np.diag_indices(len(normal))] += DAMPING
    found = np.linalg.solve(normal, system.T @ np.concatenate(residuals)).reshape(len(columns), -1)
    change: Float = over @ found.T
    return change * min(1.0, TURNED / max(float(np.abs(change).max()), 1e-6))


def _missing(pose: WindowPose, point: int, asked: NDArray[np.bool_], places: Float) -> Float:
    """What a point lacks of its place as far as the arm reaches, at most `FARTHEST`, (W, 3) [m]."""
    own, side = pose.points[:, point], POINTS[point][-1]
    wanted = np.where(asked, places, own)
    if POINTS[point].startswith("hand"):
        shoulder, elbow = (pose.points[:, POINTS.index(f"{name}_{side}")] for name in ("shoulder", "elbow"))
        reach = np.linalg.norm(elbow - shoulder, axis=1) + np.linalg.norm(own - elbow, axis=1)
        away = np.linalg.norm(wanted - shoulder, axis=1)
        wanted = shoulder + (wanted - shoulder) * np.minimum(1.0, reach / np.maximum(away, 1e-6))[:, None]
    missing = wanted - own
    size = np.linalg.norm(missing, axis=1, keepdims=True)
    found: Float = missing * np.minimum(1.0, FARTHEST / np.maximum(size, 1e-6))
    return found


@lru_cache(maxsize=4)
def _functions(frames: int) -> Float:
    """Cubic B-splines over the frames of a window, zero and level before the first, (W, K)."""
    # Evenly spaced beyond both ends, so that even coefficients are even changes.
    knots = KNOT_FRAMES * np.arange(-3.0, np.ceil(frames / KNOT_FRAMES) + 4.0)
    time = np.arange(1.0, frames + 1)
    found: Float = BSpline.design_matrix(time, knots, 3).toarray()
    return found * smoothstep(time, 0.0, BEGUN)[:, None]
