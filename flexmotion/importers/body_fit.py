"""Size of the human in a clip, from its joint centres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.body import Body, Segments
from flexmotion.human.skeleton import SIDES
from flexmotion.human.vectors import in_frame
from flexmotion.importers.foot import FlatFoot
from flexmotion.importers.landmarks import Landmarks
from flexmotion.importers.trunk import LEG_SHARE

Float = NDArray[np.float64]

BALL_HEIGHT = 0.018
"""Toe joint's centre above the sole as a share of stature: about 3 cm with a shoe [assumption]."""

ANKLE_RANGE = (0.03, 0.07)
"""Plausible heights of the ankle above the sole, as shares of stature."""


def fit_body(
    found: Landmarks,
    pelvis: Float,
    flat: tuple[FlatFoot, FlatFoot],
    mass: float = 70.0,
    height: float | None = None,
) -> Body:
    """A symmetric body with the bone lengths of a clip (medians over frames, means of both sides).

    Sizes that joint centres do not define (head, heel, toes, hands, missing arms) are in proportion to the stature, and
    a stature that is not given to the legs.

    Args:
        found: joint centres.
        pelvis: rotation of the pelvis, (T, 3, 3).
        flat: left and right foot (see `flat_foot`).
        mass: of the human; motion files do not contain it [kg].
        height: stature, if known [m].
    """
    points = found.points
    thigh, shank = _bone(points, "hip", "knee"), _bone(points, "knee", "ankle")
    stature, height = height, height or (thigh + shank) / LEG_SHARE
    usual = Segments.of_height(height)
    foot = _bone(points, "ankle", "toe")
    slope = float(np.mean([side.elevation for side in flat]))
    ball = max(foot * np.cos(slope), 0.5 * usual.ball)
    drop = -foot * np.sin(slope)
    low, high = ANKLE_RANGE

    lumbar = np.array([usual.lumbar_forward, 0.0, usual.lumbar_height])
    if "lumbar" in points:
        offset = points["lumbar"] - (points["hip_l"] + points["hip_r"]) / 2
        lumbar = np.median(in_frame(pelvis, offset), axis=0)
        lumbar[2] = max(lumbar[2], 0.5 * usual.lumbar_height)
    hips = (points["hip_l"] + points["hip_r"]) / 2
    neck = np.linalg.norm(points["neck"] - hips - pelvis @ lumbar, axis=-1)
    arms = [side for side in SIDES if found.has_arm(side)]
    if arms:
        usual = replace(
            usual,
            upper_arm=_bone(points, "shoulder", "elbow", arms),
            forearm=_bone(points, "elbow", "wrist", arms),
        )
    segments = replace(
        usual,
        hip_width=_distance(points["hip_l"], points["hip_r"]),
        thigh=thigh,
        shank=shank,
        ankle_height=float(np.clip(drop + BALL_HEIGHT * height, low * height, high * height)),
        ball=float(ball),
        foot=float((usual.heel + ball) * usual.foot / (usual.heel + usual.ball)),
        lumbar_forward=float(lumbar[0]),
        lumbar_height=float(lumbar[2]),
        neck_height=float(np.median(neck)),
        shoulder_width=_distance(points["shoulder_l"], points["shoulder_r"]),
    )
    if stature is None:
        trunk = segments.lumbar_height + segments.neck_height
        stature = segments.ankle_height + segments.leg + trunk + segments.head
    return Body(height=float(stature), mass=mass, fitted=segments)


def _distance(first: Float, second: Float) -> float:
    return float(np.median(np.linalg.norm(first - second, axis=-1)))


def _bone(points: dict[str, Float], first: str, second: str, sides: Sequence[str] = SIDES) -> float:
    lengths = [_distance(points[f"{first}_{side}"], points[f"{second}_{side}"]) for side in sides]
    return sum(lengths) / len(lengths)
