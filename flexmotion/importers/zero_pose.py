"""Segment axes of a skeleton whose zero pose stands upright, as most zero poses of artists and conversions do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmotion.importers.capture import Capture
from flexmotion.importers.units import TO_Z_UP

Float = NDArray[np.float64]

UPRIGHT = np.cos(np.radians(20))
"""Least cosine between the vertical and legs and trunk of a standing zero pose: 20°."""

UP = np.array([0.0, 0.0, 1.0])


def zero_pose_orientations(capture: Capture, joints: Mapping[str, str], turn: Float) -> dict[str, tuple[str, Float]]:
    """Segment -> (joint, axes of the segment in the joint's frame as columns x, y, z); empty if it does not stand.

    In the zero pose every joint's frame is the file's world, so pelvis, chest and head have the figure's axes.

    Args:
        capture: as read from the file.
        joints: point -> joint, of a mapping.
        turn: from the file's axes to z up, (3, 3).
    """
    if capture.zero_positions is None or capture.parents is None:
        return {}
    # A zero pose may stand in other axes than the motion: that of AMASS has y up, its world z up.
    for upright in (turn, *TO_Z_UP.values()):
        zero = capture.zero_positions @ upright.T
        at = {point: zero[capture.names.index(joint)] for point, joint in joints.items()}
        forward = np.cross(at["hip_l"] - at["hip_r"], UP)
        if np.linalg.norm(forward) > 0 and _stands(at, forward):
            return _axes(capture, joints, upright, at, forward / np.linalg.norm(forward))
    return {}


def _axes(
    capture: Capture, joints: Mapping[str, str], turn: Float, at: Mapping[str, Float], forward: Float
) -> dict[str, tuple[str, Float]]:
    """Axes of the segments of a zero pose that stands.

    Args:
        turn: from the axes of the zero pose to z up, (3, 3).
        at: points of the zero pose, z up.
        forward: direction that it faces, (3,).
    """
    figure = turn.T @ np.stack([forward, np.cross(UP, forward), UP], axis=1)
    axes = {"pelvis": (capture.common_ancestor(joints["hip_l"], joints["hip_r"]), figure)}
    if {"shoulder_l", "shoulder_r"} <= at.keys():
        axes["chest"] = (capture.common_ancestor(joints["shoulder_l"], joints["shoulder_r"]), figure)
    if "head" in joints:
        axes["head"] = (joints["head"], figure)
    for side, inward in (("l", -1.0), ("r", 1.0)):
        if not {f"elbow_{side}", f"wrist_{side}"} <= at.keys():
            continue
        # Palms face down with arms raised sideways, and inwards with hanging arms: the palm's normal is the forearm's
        # direction rotated by 90° about the fore-aft axis.
        arm = at[f"wrist_{side}"] - at[f"elbow_{side}"]
        arm = arm - (arm @ forward) * forward
        if np.linalg.norm(arm) > 0:
            arm /= np.linalg.norm(arm)
            palm = inward * np.cross(forward, arm)
            axes[f"hand_{side}"] = (
                joints[f"wrist_{side}"],
                turn.T @ np.stack([palm, np.cross(-arm, palm), -arm], axis=1),
            )
    return axes


def _stands(at: Mapping[str, Float], forward: Float) -> bool:
    hips = (at["hip_l"] + at["hip_r"]) / 2
    upright = [at["hip_l"] - at["ankle_l"], at["hip_r"] - at["ankle_r"]]
    if "neck" in at:
        upright.append(at["neck"] - hips)
    toes = (at[f"toe_{side}"] - at[f"ankle_{side}"] for side in "lr")
    return all(part[2] > UPRIGHT * np.linalg.norm(part) for part in upright) and all(toe @ forward > 0 for toe in toes)
