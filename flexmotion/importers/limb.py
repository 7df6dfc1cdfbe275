"""Orientation and flexion of a leg or an arm, two bones and a hinge, from its three joint centres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.signals import fill
from flexmotion.human.vectors import cross, in_frame, unit
from flexmotion.spatial.transitions import smoothstep

Float = NDArray[np.float64]

STRAIGHT, BENT = np.sin(np.radians(8)), np.sin(np.radians(25))
"""Sine of the flexion below which the three points do not define the hinge axis, and above which they alone do."""

CONSTANT_HINGE = 0.9
"""Least mean resultant length of measured axes of a hinge that counts as fixed in the upper bone."""


@dataclass(frozen=True)
class Limb:
    """Pose of a limb in every frame.

    Attributes:
        rotation: of the upper bone: z from the middle joint to the root joint, y the hinge to the left, (T, 3, 3).
        flexion: of the hinge, 0 when straight, (T,) [rad].
    """

    rotation: Float
    flexion: Float


def hinge_axis(root: Float, middle: Float, end: Float, sense: float, guess: Float, attached: Float | None) -> Float:
    """Hinge axis that points to the body's left, (T, 3).

    For a bent limb it is the normal of the limb's plane. For a straight limb it is constant in the upper bone's frame
    if that is known and the hinge is fixed in it, else interpolated over time, else the guess.

    Args:
        root, middle, end: joint centres, (T, 3).
        sense: 1 if flexion turns about the left axis (knee), -1 if about the right one (elbow).
        guess: left axis for limbs that are never bent, (T, 3).
        attached: a frame that moves with the upper bone, (T, 3, 3).
    """
    upper, lower = middle - root, end - middle
    normal = sense * cross(upper, lower)
    length = np.linalg.norm(normal, axis=-1)
    bend = length / np.maximum(np.linalg.norm(upper, axis=-1) * np.linalg.norm(lower, axis=-1), 1e-9)
    measured = unit(normal)
    weight = smoothstep(bend, STRAIGHT, BENT)
    if weight.min(initial=1.0) >= 1.0:
        return measured

    prior = _in_bone(measured, bend * weight, attached) if attached is not None else None
    if prior is None:
        carried = fill(measured - guess, weight, sigma=8.0) if weight.any() else 0.0
        prior = guess + carried
    return weight[:, None] * measured + (1 - weight)[:, None] * prior


def _in_bone(measured: Float, weight: Float, attached: Float) -> Float | None:
    local = in_frame(attached, measured)
    if weight.sum() < 1.0:
        return None
    mean = weight @ local / weight.sum()
    if np.linalg.norm(mean) < CONSTANT_HINGE:
        return None
    return attached @ (mean / np.linalg.norm(mean))


def solve_limb(root: Float, end: Float, axis: Float, lengths: tuple[float, float], sense: float) -> Limb:
    """Pose of a limb whose end is at its target, as far as it reaches.

    Args:
        root, end: root joint of the model's limb and target of its end, (T, 3) [m].
        axis: hinge axis to the left (see `hinge_axis`), (T, 3); only its part perpendicular to the limb counts.
        lengths: upper and lower bone [m].
        sense: as for `hinge_axis`.
    """
    upper, lower = lengths
    reach = end - root
    distance = np.linalg.norm(reach, axis=-1)
    down = unit(reach)
    distance = np.clip(distance, abs(upper - lower) + 1e-6, upper + lower)

    left = unit(axis - np.sum(axis * down, axis=-1, keepdims=True) * down)
    front = cross(down, left)
    # Law of cosines in the triangle of both bones and the line from root to end.
    cosine = (upper**2 + distance**2 - lower**2) / (2 * upper * distance)
    tilt = np.arccos(np.clip(cosine, -1.0, 1.0))[:, None]
    bone = np.cos(tilt) * down + sense * np.sin(tilt) * front
    inner = (upper**2 + lower**2 - distance**2) / (2 * upper * lower)
    flexion = np.pi - np.arccos(np.clip(inner, -1.0, 1.0))
    rotation = np.stack([cross(left, -bone), left, -bone], axis=-1)
    return Limb(rotation, flexion)
