"""Joint centres from surface markers: anatomical landmarks, regressions, and functional joints where neither suffice.

Sources: hip, Harrington et al. 2007 (J Biomech 40:595, adults and children, MRI); lumbosacral joint, Reed, Manary and
Schneider 1999 (SAE 1999-01-0959); neck and arms, `marker_trunk`; functional joints, `rigid`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.angles import rotation_about
from flexmotion.human.body import Segments
from flexmotion.human.skeleton import SIDES
from flexmotion.human.vectors import frame, in_frame, unit
from flexmotion.importers.limb import hinge_axis
from flexmotion.importers.marker_landmarks import MissingLandmarkError
from flexmotion.importers.marker_trunk import trunk_points
from flexmotion.importers.rigid import cluster_pose, common_points
from flexmotion.importers.trunk import LEG_SHARE

Float = NDArray[np.float64]

SKIN = 0.017
"""From a spine of the pelvis to the centre of the marker over it [m]: 10 mm of soft tissue (Bell, Pedersen and Brand
1990 measured 7 to 13) and the radius of the marker. The regression is of bones."""

L5S1 = np.array([-0.056, 0.0, 0.404])
"""Direction of the lumbosacral joint from the middle of the hips in Reed's axes (vertical plane of ASIS and pubis)."""

SPINES_TILT = np.radians(10)
"""Angle by which the line from posterior to anterior iliac spines points down in upright stance [rad]: 9 to 13°
(Levine and Whittle 1996)."""

KNEE_HALF, ANKLE_HALF = 0.052, 0.037
"""Half the breadth between epicondyles and between malleoli of a 1.75 m adult [m] (ANSUR 1988, men: 105 and 74 mm);
scaled with stature."""

MARKER_RADIUS = 0.007
"""From the skin to a marker's centre [m]: spheres of 14 mm are the most common."""

TIBIAL_TORSION = np.radians(20)
"""Outward rotation of the line between the malleoli against the knee's axis [rad] (20 to 25°, Yoshioka et al. 1989)."""

TOE_DEPTH = 0.02
"""From a marker on top of the second metatarsal's head to the toe joint's centre [m]: marker, skin and half the
head."""

HIP_HEIGHT = 0.53
"""Height of the hip joints above the sole as a share of stature (Drillis and Contini 1966)."""

TOE_HEIGHT = 0.011
"""Height of a toe joint's centre above the sole of a bare foot as a share of stature."""

PRIOR_SD, FUNCTIONAL_SD = 0.015, 0.01
"""Standard error of an ankle from the proportions of the foot, and of one sample of the functional joint (skin) [m]."""

SAMPLES_S = 0.25
"""Time after which errors of skin markers are independent of each other [s] (assumption: half a stride's phase)."""


NAMES = {"l": "left", "r": "right"}


@dataclass(frozen=True)
class MarkerJoints:
    """Joint centres from surface markers.

    Attributes:
        points: point (see `mapping.POINTS`) -> positions, (T, 3) [m], z up.
        pelvis: its rotation (x forward, y left, z up in upright stance), (T, 3, 3).
        warnings: what was estimated from little.
    """

    points: dict[str, Float]
    pelvis: Float
    warnings: tuple[str, ...]


def marker_joints(at: Mapping[str, Float], clusters: Mapping[str, Float], fps: float, path: str) -> MarkerJoints:
    """Joint centres of a human.

    Args:
        at: landmark -> positions, (T, 3) [m], z up; without gaps.
        clusters: segment -> positions of all its markers, (T, M, 3) [m].
        fps: frames per second.
        path: of the file, for messages.

    Raises:
        MissingLandmarkError: a joint of the legs cannot be found; names the joint and the landmarks that would do.
    """
    hips, pelvis = _hips(at, path)
    points = {f"hip_{side}": hips[side] for side in SIDES}
    warnings: list[str] = []
    for side in SIDES:
        points |= _leg(side, at, clusters, points[f"hip_{side}"], pelvis, fps, path, warnings)
    stature = _stature(points)
    # The segments of the human meet at the height of the omphalion, higher than L5/S1 on the same line.
    rise = Segments.of_height(stature).lumbar_height * L5S1 / np.linalg.norm(L5S1)
    points["lumbar"] = (points["hip_l"] + points["hip_r"]) / 2 + pelvis @ rise
    points |= trunk_points(at, points["lumbar"], stature)
    return MarkerJoints(points, pelvis, tuple(warnings))


def _hips(at: Mapping[str, Float], path: str) -> tuple[dict[str, Float], Float]:
    """Hip joint centres, (T, 3) each, and the upright axes of the pelvis (x forward, y left, z up), (T, 3, 3)."""
    behind = (at["psis_l"] + at["psis_r"]) / 2 if "psis_l" in at and "psis_r" in at else at.get("sacrum")
    absent = [name for name in ("asis_l", "asis_r") if name not in at]
    if absent or behind is None:
        lacks = ", ".join(absent) or "sacrum, or psis_l and psis_r"
        needed = tuple(absent) or ("sacrum", "psis_l", "psis_r")
        raise MissingLandmarkError(
            f"{path}: no marker for {lacks}: the hip joints need both ASIS, and sacrum or both PSIS", needed
        )
    middle = (at["asis_l"] + at["asis_r"]) / 2
    left = at["asis_l"] - at["asis_r"]
    up = np.cross(middle - behind, left)
    spines = frame(left, up)
    # Depth and width of the pelvis in millimetres, as in the source.
    depth = 1e3 * (float(np.median(in_frame(spines, middle - behind)[:, 0])) - 2 * SKIN)
    width = 1e3 * float(np.median(np.linalg.norm(left, axis=-1)))
    ahead, above, aside = -0.24 * depth - 9.9 - 1e3 * SKIN, -0.30 * width - 10.9, 0.33 * width + 7.3
    hips = {
        side: middle + spines @ (np.array([ahead, sign * aside, above]) / 1e3)
        for side, sign in zip(SIDES, (1.0, -1.0), strict=True)
    }
    return hips, spines @ rotation_about("y", -SPINES_TILT)


def _leg(
    side: str,
    at: Mapping[str, Float],
    clusters: Mapping[str, Float],
    hip: Float,
    pelvis: Float,
    fps: float,
    path: str,
    warnings: list[str],
) -> dict[str, Float]:
    """Knee, ankle and toe joint of one leg, (T, 3) each."""
    name = NAMES[side]
    toe, foot = _toe(side, at, clusters, path)
    lateral, medial = at.get(f"knee_lateral_{side}"), at.get(f"knee_medial_{side}")
    outer, inner = at.get(f"ankle_lateral_{side}"), at.get(f"ankle_medial_{side}")
    ankle = (outer + inner) / 2 if outer is not None and inner is not None else None
    knee = (lateral + medial) / 2 if lateral is not None and medial is not None else None
    out = 1.0 if side == "l" else -1.0
    if knee is None and lateral is not None:
        end = ankle if ankle is not None else outer
        if end is None:
            end = _ankle_of_foot(side, at, toe, foot, hip)
        knee = _beside(
            hip, lateral, end, pelvis, clusters.get(f"thigh_{side}"), out, outer is not None and ankle is None
        )
    if knee is not None and ankle is None and outer is not None:
        ankle = _ankle_beside(hip, knee, outer, toe, pelvis, out)
    if ankle is None or knee is None:
        thigh, shank = clusters.get(f"thigh_{side}"), clusters.get(f"shank_{side}")
        if knee is None and (thigh is None or shank is None or thigh.shape[1] < 2 or shank.shape[1] < 2):
            needed = tuple(f"{own}_{side}" for own in ("knee_lateral", "knee_medial", "thigh", "shank"))
            raise MissingLandmarkError(
                f"{path}: no marker for the {name} knee, and fewer than two on thigh or shank", needed
            )
        guess = ankle if ankle is not None else _ankle_of_foot(side, at, toe, foot, hip)
        if knee is None:
            assert thigh is not None and shank is not None
            body = cluster_pose(np.concatenate([thigh, hip[:, None]], axis=1))[:2]
            if shank.shape[1] == 2:
                # The ankle is the third point of the shank.
                ankle = guess
                shank = np.concatenate([shank, guess[:, None]], axis=1)
            lower = cluster_pose(shank)[:2]
            if ankle is None:
                ankle = _ankle_of_shank(lower, foot, guess, fps)
            knee = _knee_of_clusters(body, lower, hip, ankle)
            warnings.append(f"{name} knee: no marker on it, its centre follows from the motion of thigh and shank")
        else:
            ankle = guess
        if outer is None:
            warnings.append(f"{name} ankle: no marker on it, its centre follows from the foot's markers")
    assert ankle is not None
    return {f"knee_{side}": knee, f"ankle_{side}": ankle, f"toe_{side}": toe}


def _toe(
    side: str, at: Mapping[str, Float], clusters: Mapping[str, Float], path: str
) -> tuple[Float, tuple[Float, Float, Float]]:
    """Toe joint, (T, 3), and the foot's pose with its axes upright while flat, and the flat frames."""
    heads = [at[name] for name in (f"metatarsal_1_{side}", f"metatarsal_5_{side}") if name in at]
    top, tip, heel = at.get(f"toe_{side}"), at.get(f"toe_tip_{side}"), at.get(f"heel_{side}")
    if len(heads) == 2:
        toe, depth = (heads[0] + heads[1]) / 2, MARKER_RADIUS
    elif top is not None:
        toe, depth = top, TOE_DEPTH
    elif heads:
        toe, depth = heads[0], MARKER_RADIUS
    elif tip is not None and heel is not None:
        # The toe joint divides the foot as in the proportions of a mean adult.
        mean = Segments.of_height(1.0)
        toe, depth = heel + (mean.heel + mean.ball) / mean.foot * (tip - heel), TOE_DEPTH
    else:
        needed = tuple(f"{own}_{side}" for own in ("toe", "metatarsal_1", "metatarsal_5", "toe_tip", "heel"))
        raise MissingLandmarkError(
            f"{path}: no marker for the {NAMES[side]} toe joint: it needs toe, metatarsal_1, or toe_tip and heel",
            needed,
        )
    back = heel if heel is not None else at.get(f"ankle_lateral_{side}")
    if back is None:
        needed = (f"heel_{side}", f"ankle_lateral_{side}")
        raise MissingLandmarkError(f"{path}: no marker behind the {NAMES[side]} foot, on heel or ankle", needed)
    height = (back - back.min(axis=0))[:, 2] + (toe - toe.min(axis=0))[:, 2]
    flat = height <= np.quantile(height, 0.1)
    cluster = clusters.get(f"foot_{side}")
    pose = cluster_pose(cluster) if cluster is not None and cluster.shape[1] >= 3 else None
    if pose is not None and np.isfinite(pose[0]).all():
        vertical = np.median(pose[0][flat][:, 2], axis=0)
        up = pose[0] @ unit(vertical)
        rotation = pose[0]
    else:
        forward = unit(toe - back)
        # Without a third marker the foot does not roll.
        slope = float(np.median(forward[flat][:, 2]))
        side_axis = unit(np.cross([0.0, 0.0, 1.0], forward))
        up = unit(np.cross(forward, side_axis) + slope / np.sqrt(max(1 - slope**2, 0.01)) * forward)
        rotation = np.stack([forward, side_axis, np.cross(forward, side_axis)], axis=-1)
    return toe - depth * up, (rotation, toe, up)


def _ankle_of_foot(
    side: str, at: Mapping[str, Float], toe: Float, foot: tuple[Float, Float, Float], hip: Float
) -> Float:
    """Ankle from heel and toe joint in the proportions of a mean adult, (T, 3)."""
    up = foot[2]
    heel = at.get(f"heel_{side}", toe)
    stature = float(np.median(hip[:, 2] - np.quantile(toe[:, 2], 0.05))) / HIP_HEIGHT
    mean = Segments.of_height(stature)
    share = mean.heel / (mean.heel + mean.ball)
    along = (toe - heel) - np.sum((toe - heel) * up, axis=-1, keepdims=True) * up
    rise = mean.ankle_height - TOE_HEIGHT * stature
    return toe - (1 - share) * along + rise * up


def _ankle_of_shank(shank: tuple[Float, Float], foot: tuple[Float, Float, Float], guess: Float, fps: float) -> Float:
    """Ankle that is fixed in shank and foot as far as skin permits, near a guess in the foot, (T, 3)."""
    rotation, origin, _ = foot
    local = np.median(in_frame(rotation, guess - origin), axis=0)
    turn = np.einsum("tji,tjk->tik", shank[0], rotation)
    shift = np.einsum("tji,tj->ti", shank[0], origin - shank[1])
    weight = 1 / FUNCTIONAL_SD / np.sqrt(SAMPLES_S * fps)
    eye = np.broadcast_to(np.eye(3), turn.shape)
    rows = weight * np.concatenate([eye, -turn], axis=2).reshape(-1, 6)
    prior = np.hstack([np.zeros((3, 3)), np.eye(3) / PRIOR_SD])
    right = np.concatenate([weight * shift.reshape(-1), local / PRIOR_SD])
    solution = np.linalg.lstsq(np.vstack([rows, prior]), right, rcond=None)[0]
    own = origin + rotation @ solution[3:]
    other: Float = shank[1] + shank[0] @ solution[:3]
    return (own + other) / 2


def _knee_of_clusters(thigh: tuple[Float, Float], shank: tuple[Float, Float], hip: Float, ankle: Float) -> Float:
    """Functional knee, (T, 3): on the hinge between both segments, where hip and ankle are in line across it."""
    upper, lower, axis, other = common_points(thigh, shank)
    h = np.median(in_frame(thigh[0], hip - thigh[1]), axis=0)
    a = np.median(in_frame(shank[0], ankle - shank[1]), axis=0)
    first, second = axis @ (upper - h), other @ (a - lower)
    thigh_length, shank_length = np.linalg.norm(upper - h), np.linalg.norm(a - lower)
    move = thigh_length / (thigh_length + shank_length) * (first + second) - first
    one = thigh[1] + thigh[0] @ (upper + move * axis)
    two: Float = shank[1] + shank[0] @ (lower + move * other)
    return (one + two) / 2


def _beside(
    hip: Float, lateral: Float, end: Float, pelvis: Float, thigh: Float | None, out: float, beside: bool
) -> Float:
    """Knee from its lateral marker, half its breadth inwards along the hinge, (T, 3)."""
    scale = float(np.median(np.linalg.norm(lateral - hip, axis=-1))) / (0.245 * 1.75)
    half = KNEE_HALF * scale + MARKER_RADIUS
    ankle_half = (ANKLE_HALF * scale + MARKER_RADIUS) if beside else 0.0
    attached = None
    if thigh is not None:
        rotation = cluster_pose(np.concatenate([thigh, hip[:, None], lateral[:, None]], axis=1))[0]
        attached = rotation if np.isfinite(rotation).all() else None
    axis = pelvis[:, :, 1]
    for _ in range(4):
        knee, ankle = lateral - out * half * axis, end - out * ankle_half * axis
        left = hinge_axis(hip, knee, ankle, 1.0, pelvis[:, :, 1], attached)
        along = unit(knee - hip)
        axis = unit(left - np.sum(left * along, axis=-1, keepdims=True) * along)
    return lateral - out * half * axis


def _ankle_beside(hip: Float, knee: Float, outer: Float, toe: Float, pelvis: Float, out: float) -> Float:
    """Ankle from its lateral marker, half its breadth inwards along the line of the malleoli, (T, 3)."""
    scale = float(np.median(np.linalg.norm(outer - knee, axis=-1))) / (0.246 * 1.75)
    half = ANKLE_HALF * scale + MARKER_RADIUS
    guess = np.cross(unit(knee - outer), unit(toe - outer)) + 0.2 * pelvis[:, :, 1]
    left = hinge_axis(hip, knee, outer, 1.0, guess, None)
    along = unit(knee - outer)
    left = unit(left - np.sum(left * along, axis=-1, keepdims=True) * along)
    # Outward torsion takes the lateral malleolus backwards: the left axis turns back on the left, forward on the right.
    front = np.cross(left, along)
    axis = np.cos(TIBIAL_TORSION) * left - out * np.sin(TIBIAL_TORSION) * front
    return outer - out * half * axis


def _stature(points: Mapping[str, Float]) -> float:
    legs = [
        np.median(np.linalg.norm(points[f"{b}_{side}"] - points[f"{a}_{side}"], axis=-1))
        for a, b in (("hip", "knee"), ("knee", "ankle"))
        for side in SIDES
    ]
    return float(sum(legs)) / 2 / LEG_SHARE
