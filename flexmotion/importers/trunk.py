"""Orientation of pelvis, torso and head from joint centres and, where a file has them, segment orientations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.angles import rotation_about
from flexmotion.human.vectors import frame, in_frame, unit
from flexmotion.importers.landmarks import Landmarks

Float = NDArray[np.float64]

SPINE_SHARE = 0.8
"""How much of the chest's tilt the line from lumbar joint to neck has, when a spine bends over its length."""


def pelvis_rotation(found: Landmarks) -> Float:
    """The line of the hips gives the left axis; upwards is as declared, else towards the spine, (T, 3, 3)."""
    points = found.points
    left = points["hip_l"] - points["hip_r"]
    if "pelvis" in found.orientations:
        return frame(left, found.orientations["pelvis"][:, :, 2])
    above = points.get("lumbar", points["neck"])
    return frame(left, above - (points["hip_l"] + points["hip_r"]) / 2)


def chest_left(found: Landmarks) -> Float:
    """The chest's left axis: as declared, else the line of the shoulders, (T, 3)."""
    if "chest" in found.orientations:
        return found.orientations["chest"][:, :, 1]
    return found.points["shoulder_l"] - found.points["shoulder_r"]


def neck_tilt(found: Landmarks, pelvis: Float, chord: Float) -> float:
    """How far the line from lumbar joint to neck leans forward while chest and pelvis are aligned [rad].

    Zero for files without the chest's orientation. Elsewhere the median over the clip of what the chest's own tilt
    does not explain.
    """
    if "chest" not in found.orientations:
        return 0.0
    line = in_frame(pelvis, chord)
    chest = in_frame(pelvis, found.orientations["chest"][:, :, 2])
    lean = np.arctan2(line[:, 0], line[:, 2]) - SPINE_SHARE * np.arctan2(chest[:, 0], chest[:, 2])
    return float(np.clip(np.median(lean), -0.3, 0.3))


def torso_rotation(found: Landmarks, chord: Float, tilt: float) -> Float:
    """Upwards along the line from the lumbar joint to the neck, less its tilt in upright stance, (T, 3, 3)."""
    along = frame(chest_left(found), chord)
    # The chord itself must lie in the sagittal plane: its direction is kept, the left axis gives way.
    z = unit(chord)
    y = unit(np.cross(z, along[:, :, 0]))
    exact = np.stack([np.cross(y, z), y, z], axis=-1)
    return exact @ rotation_about("y", -tilt)


def head_rotation(found: Landmarks, torso: Float) -> Float:
    """As declared, else the torso's axes tilted so that the head's joint stays above the neck, (T, 3, 3)."""
    if "head" in found.orientations:
        return found.orientations["head"]
    if "head" not in found.points:
        return torso
    local = in_frame(torso, found.points["head"] - found.points["neck"])
    lean = np.arctan2(local[:, 0], local[:, 2])
    sway = np.arctan2(-local[:, 1], local[:, 2])
    return torso @ rotation_about("y", lean - np.median(lean)) @ rotation_about("x", sway - np.median(sway))
