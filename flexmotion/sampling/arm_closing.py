"""`closed`: elbows and hands brought to their places by the arms alone, after feet and balance have moved the body.

Planting and balance shift a body by centimetres, and by more the more its legs have changed, so that corrections of the
latent do not converge on a hand's place as it is handed on. Arms hardly move the balance. For residuals r of the places
and changes c of the angles of an arm, over smooth functions of time,

    c = argmin |J c - r|² + damping |c|²

is solved a fixed number of times, forward kinematics in between; a step that brings the arm no nearer is not taken.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve

from flexmotion.features.constraint_layout import PLACES
from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor
from flexmotion.features.layout import POINTS
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, SIDES
from flexmotion.human.vectors import cross
from flexmotion.sampling.arm_pose import ArmPose
from flexmotion.sampling.window_pose import WindowPose
from flexmotion.spatial.transitions import smoothstep

Float = NDArray[np.float64]

CLOSED = ("elbow", "hand")
"""Points of an arm whose places it keeps."""

PLACED = ("shoulder", *CLOSED)
HAND = PLACED.index("hand")

MOVED = ARM_JOINTS[:4]
"""Coordinates of shoulder and elbow; pronation does not move the fist."""

CARRIED = (0, 3, 4)
"""How many of `MOVED` move each of `PLACED`."""

IN_REACH = 0.98
"""Share of an arm's length within which a place is in reach."""

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
    asked, places = _asked(constraints, motion.body.leg)
    arms = [
        ([POINTS.index(f"{point}_{side}") for point in PLACED], [JOINTS.index(f"{joint}_{side}") for joint in MOVED])
        for side in SIDES
    ]
    arms = [(points, columns) for points, columns in arms if asked[:, points[1:]].any()]
    if not arms:
        return motion
    pose, joints = WindowPose.of(motion, anchor), motion.joints.copy()
    for points, columns in arms:
        arm = ArmPose(pose.anchor[:, columns], pose.axis[:, columns], pose.points[:, points], CARRIED)
        mask = asked[:, points].copy()
        mask[:, 0] = False  # no arm moves its shoulder
        wanted, limits = Wanted(mask, places[:, points]), joint_limits()[columns]
        joints[:, columns] = _closed(arm, joints[:, columns], limits, wanted)
    return replace(motion, joints=joints)


def within_arms(pose: WindowPose, constraints: Constraints, most: float) -> bool:
    """Whether arms alone bring all hands that are asked to their places: near, in reach, and no elbow is asked.

    Args:
        pose: of the window.
        constraints: what is asked.
        most: distance of the hands from their places [m].
    """
    asked, places = _asked(constraints, pose.body.leg)
    for side in SIDES:
        shoulder, elbow, hand = (POINTS.index(f"{point}_{side}") for point in PLACED)
        if asked[:, elbow].any():
            return False  # it moves on a sphere
        at, lower, own = (pose.points[:, point] for point in (shoulder, elbow, hand))
        wanted = np.where(asked[:, hand], places[:, hand], own)
        reach = _lengths(lower - at) + _lengths(own - lower)
        beyond = (_lengths(wanted - own) > most) | (_lengths(wanted - at) > IN_REACH * reach)
        if (beyond & asked[:, hand].any(axis=1)).any():
            return False
    return True


def _asked(constraints: Constraints, leg: float) -> tuple[NDArray[np.bool_], Float]:
    """Which coordinates of points are asked, (W, 16, 3), and places, (W, 16, 3) [m]."""
    columns = constraints.layout.blocks[PLACES]
    frames = len(constraints.mask)
    mask = constraints.mask[:, columns].reshape(frames, -1, 3)
    return mask, constraints.values[:, columns].reshape(frames, -1, 3) * leg


@dataclass(frozen=True)
class Wanted:
    """Places that are asked of `PLACED`, (W, 3, 3) [m], and which of their coordinates are; none of the shoulder."""

    mask: NDArray[np.bool_]
    places: Float

    def error(self, arm: ArmPose) -> float:
        """Sum of the squared distances from asked places [m²]."""
        away = (self.places - arm.points)[self.mask]
        return float(away @ away)

    def missing(self, arm: ArmPose, point: int) -> Float:
        """What a point lacks of its place as far as the arm reaches, at most `FARTHEST`, (W, 3) [m]."""
        own = arm.points[:, point]
        wanted = np.where(self.mask[:, point], self.places[:, point], own)
        if point == HAND:
            shoulder, elbow = arm.points[:, 0], arm.points[:, 1]
            reach = _lengths(elbow - shoulder) + _lengths(own - elbow)
            away = _lengths(wanted - shoulder)
            wanted = shoulder + (wanted - shoulder) * np.minimum(1.0, reach / np.maximum(away, 1e-6))[:, None]
        missing = wanted - own
        found: Float = missing * np.minimum(1.0, FARTHEST / np.maximum(_lengths(missing), 1e-6))[:, None]
        return found


def _closed(arm: ArmPose, angles: Float, limits: Float, wanted: Wanted) -> Float:
    """Angles of an arm, (W, 4) [rad], with which its points are where they are wanted; see `_change`."""
    share, error = 1.0, wanted.error(arm)
    low, high = limits.T
    enough = NEAR**2 * float(wanted.mask.sum())
    for _ in range(ROUNDS):
        if error < enough:
            break
        moved = angles + share * _change(arm, wanted)
        # Angles that are beyond their limits already stay where they are.
        moved = np.clip(moved, np.minimum(low, angles), np.maximum(high, angles))
        there = arm.moved(moved - angles)
        left = wanted.error(there)
        if left < error:
            arm, angles, error = there, np.asarray(moved), left
        else:  # an arm at its limits, or at a singular angle
            share *= SHORTER
    return angles


def _change(arm: ArmPose, wanted: Wanted) -> Float:
    """Change of the angles of an arm, (W, 4) [rad]."""
    over = _functions(len(arm.points))
    rows, residuals = [], []
    for point in range(1, len(PLACED)):
        frames, coordinates = np.nonzero(wanted.mask[:, point])
        lever = arm.points[:, point, None] - arm.anchor
        moved = cross(arm.axis, lever)  # (W, 4, 3)
        moved[:, CARRIED[point] :] = 0.0  # the elbow does not move itself
        own = moved[frames, :, coordinates]
        rows.append((own[:, :, None] * over[frames][:, None]).reshape(len(frames), own.shape[1] * over.shape[1]))
        residuals.append(wanted.missing(arm, point)[frames, coordinates])
    system = np.concatenate(rows)
    normal = system.T @ system + _evenness(len(over))
    normal[np.diag_indices(len(normal))] += DAMPING
    found = cho_solve(cho_factor(normal), system.T @ np.concatenate(residuals)).reshape(len(MOVED), -1)
    change: Float = over @ found.T
    return change * min(1.0, TURNED / max(float(np.abs(change).max()), 1e-6))


def _lengths(vectors: Float) -> Float:
    found: Float = np.sqrt(np.einsum("ti,ti->t", vectors, vectors))
    return found


@lru_cache(maxsize=4)
def _evenness(frames: int) -> Float:
    """Quadratic form of the second differences of all coefficients, (4 K, 4 K)."""
    even = np.diff(np.eye(_functions(frames).shape[1]), n=2, axis=0)
    return np.asarray(EVEN * np.kron(np.eye(len(MOVED)), even.T @ even), np.float64)


@lru_cache(maxsize=4)
def _functions(frames: int) -> Float:
    """Cubic B-splines over the frames of a window, zero and level before the first, (W, K)."""
    # Evenly spaced beyond both ends, so that even coefficients are even changes.
    knots = KNOT_FRAMES * np.arange(-3.0, np.ceil(frames / KNOT_FRAMES) + 4.0)
    time = np.arange(1.0, frames + 1)
    found: Float = BSpline.design_matrix(time, knots, 3).toarray()
    return found * smoothstep(time, 0.0, BEGUN)[:, None]
