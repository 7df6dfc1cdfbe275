"""Orientation of pelvis, torso and head from joint centres and, if the file has them, segment orientations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.angles import rotation_about
from flexmotion.human.vectors import frame, in_frame, unit
from flexmotion.importers.landmarks import Landmarks

Float = NDArray[np.float64]

SPINE_SHARE = 0.8
"""Tilt of the line from lumbar joint to neck as a share of the chest's, for a spine that bends over its length."""


def pelvis_rotation(found: Landmarks) -> Float:
    """Rotation of the pelvis, (T, 3, 3): left along the line of the hips, up as in the file, else towards the spine."""
    points = found.points
    left = points["hip_l"] - points["hip_r"]
    if "pelvis" in found.orientations:
        return frame(left, found.orientations["pelvis"][:, :, 2])
    above = points.get("lumbar", points["neck"])
    return frame(left, above - (points["hip_l"] + points["hip_r"]) / 2)


def chest_left(found: Landmarks) -> Float:
    """Left axis of the chest, (T, 3): as in the file, else the line of the shoulders."""
    if "chest" in found.orientations:
        return found.orientations["chest"][:, :, 1]
    return found.points["shoulder_l"] - found.points["shoulder_r"]


def neck_tilt(found: Landmarks, pelvis: Float, chord: Float) -> float:
    """Forward lean of the line from lumbar joint to neck while chest and pelvis are aligned [rad].

    The median over the clip of the lean that the chest's tilt does not explain; zero for files without the orientation
    of the chest.
    """
    if "chest" not in found.orientations:
        return 0.0
    line = in_frame(pelvis, chord)
    chest = in_frame(pelvis, found.orientations["chest"][:, :, 2])
    lean = np.arctan2(line[:, 0], line[:, 2]) - SPINE_SHARE * np.arctan2(chest[:, 0], chest[:, 2])
    return float(np.clip(np.median(lean), -0.3, 0.3))


def torso_rotation(found: Landmarks, chord: Float, tilt: float) -> Float:
    """Rotation of the torso, (T, 3, 3): up along the line from lumbar joint to neck, less its upright tilt."""
    along = frame(chest_left(found), chord)
    # The line must lie in the sagittal plane: its direction is kept, the left axis is adjusted.
    z = unit(chord)
    y = unit(np.cross(z, along[:, :, 0]))
    exact = np.stack([np.cross(y, z), y, z], axis=-1)
    return exact @ rotation_about("y", -tilt)


def head_rotation(found: Landmarks, torso: Float) -> Float:
    """Rotation of the head, (T, 3, 3): as in the file, else of the torso, tilted to keep the head above the neck."""
    if "head" in found.orientations:
        return found.orientations["head"]
    if "head" not in found.points:
        return torso
    local = in_frame(torso, found.points["head"] - found.points["neck"])
    lean = np.arctan2(local[:, 0], local[:, 2])
    sway = np.arctan2(-local[:, 1], local[:, 2])
    return torso @ rotation_about("y", lean - np.median(lean)) @ rotation_about("x", sway - np.median(sway))
