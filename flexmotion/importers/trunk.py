"""Orientation of pelvis, torso and head from joint centres and, if the file has them, segment orientations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.angles import rotation_about
from flexmotion.human.body import Segments
from flexmotion.human.vectors import cross, frame, in_frame, unit

if TYPE_CHECKING:
    from flexmotion.importers.landmarks import Landmarks

Float = NDArray[np.float64]

SPINE_SHARE = 0.8
"""Tilt of the line from lumbar joint to neck as a share of the chest's, for a spine that bends over its length."""


LUMBAR_BEHIND = 0.2
"""Angle by which the line from the middle of the hips to the lumbosacral joint leans back in the axes of an upright
pelvis [rad], 11.5°: .0300 m behind and .1476 m above in the pelvis of Delp et al. 1990 (IEEE Trans Biomed Eng 37:757;
OpenSim's gait2354). Reed et al. 1999 have 7.9°, Rajagopal et al. 2016 15.5°."""

LEG_SHARE = 0.491
"""Thigh and shank as a share of stature (`data/proportions.yaml`)."""


def with_trunk(points: Mapping[str, Float], leg: float) -> tuple[dict[str, Float], list[str]]:
    """Points with neck and shoulders, guessed where the file lacks them, and a warning for each guess.

    The neck of a trunk without points is above the lumbar joint, else the hips: a trunk stays nearer to the vertical
    than to any axis of the pelvis. Shoulders lie beside it along the line of the hips.

    Args:
        leg: hip to ankle over the knee [m].
    """
    found, notes = dict(points), []
    sides = [f"shoulder_{side}" for side in "lr"]
    if {"neck", *sides} <= found.keys():
        return found, []
    left = unit((points["hip_l"] - points["hip_r"]) * [1.0, 1.0, 0.0])
    mean = Segments.of_height(leg / LEG_SHARE)
    rise = np.array([0.0, 0.0, 1.0])
    hips = (points["hip_l"] + points["hip_r"]) / 2
    lumbar = points.get("lumbar", hips + mean.lumbar_height * rise)
    present = [side for side in sides if side in points]
    if "neck" not in points:
        if present:
            beside = [points[side] - (0.5 - sides.index(side)) * mean.shoulder_width * left for side in present]
            found["neck"] = np.mean([points[s] for s in sides] if len(present) == 2 else beside, axis=0)
            found["neck"] = found["neck"] + (mean.neck_height - mean.shoulder_height) * unit(found["neck"] - lumbar)
            notes.append("no point for the neck: it is placed above the shoulders")
        else:
            above = found["head"] - lumbar if "head" in found else rise
            found["neck"] = lumbar + mean.neck_height * unit(above)
            guess = "below the head" if "head" in found else "above the pelvis, so the trunk does not lean"
            notes.append(f"no point for neck or shoulders: the neck is placed {guess}")
    along = unit(found["neck"] - lumbar)
    for index, side in enumerate(sides):
        if side not in points:
            across = unit(left - np.sum(left * along, axis=-1, keepdims=True) * along)
            height, width = mean.shoulder_height - mean.neck_height, (0.5 - index) * mean.shoulder_width
            found[side] = found["neck"] + height * along + width * across
    if not present:
        notes.append("no point for the shoulders: they are placed beside the neck and turn with the hips")
    return found, notes


def pelvis_rotation(found: Landmarks) -> Float:
    """Rotation of the pelvis, (T, 3, 3): left along the line of the hips, up as in the file, else from the spine.

    The lumbar joint lies behind the hips (`LUMBAR_BEHIND`), the neck of an upright human above them.
    """
    points = found.points
    left = points["hip_l"] - points["hip_r"]
    if "pelvis" in found.orientations:
        return frame(left, found.orientations["pelvis"][:, :, 2])
    hips = (points["hip_l"] + points["hip_r"]) / 2
    if "lumbar" in points:
        return frame(left, points["lumbar"] - hips) @ rotation_about("y", LUMBAR_BEHIND)
    return frame(left, points["neck"] - hips)


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
    y = unit(cross(z, along[:, :, 0]))
    exact = np.stack([cross(y, z), y, z], axis=-1)
    return exact @ rotation_about("y", -tilt)


def upright_head(found: Landmarks, torso: Float) -> tuple[float, float]:
    """Forward lean and leftward sway of the head's point in the torso, medians [rad]; zero where it has no use."""
    if "head" in found.orientations or "head" not in found.points:
        return 0.0, 0.0
    lean, sway = _nod(found, torso)
    return float(np.median(lean)), float(np.median(sway))


def head_rotation(found: Landmarks, torso: Float, upright: tuple[float, float]) -> Float:
    """Rotation of the head, (T, 3, 3): as in the file, else of the torso, tilted to keep the head above the neck.

    Args:
        upright: see `upright_head`.
    """
    if "head" in found.orientations:
        return found.orientations["head"]
    if "head" not in found.points:
        return torso
    lean, sway = _nod(found, torso)
    return torso @ rotation_about("y", lean - upright[0]) @ rotation_about("x", sway - upright[1])


def _nod(found: Landmarks, torso: Float) -> tuple[Float, Float]:
    local = in_frame(torso, found.points["head"] - found.points["neck"])
    return np.arctan2(local[:, 0], local[:, 2]), np.arctan2(-local[:, 1], local[:, 2])
