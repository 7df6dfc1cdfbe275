"""Neck, shoulders, arms and head from surface markers.

Sources: cervicothoracic joint, Reed, Manary and Schneider 1999 (SAE 1999-01-0959); shoulder, Rab, Petuskey and Bagley
2002 (Gait Posture 15:113).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.skeleton import SIDES
from flexmotion.human.vectors import unit

Float = NDArray[np.float64]

NECK_SHARE = 0.55
"""Distance of the joint C7/T1 from the marker on C7 as a share of the distance to the jugular notch (Reed et al.)."""

SHOULDER_SHARE = 0.17
"""Depth of the shoulder joint below the acromion as a share of the distance between both acromia (Rab et al.)."""

NECK_ABOVE_ACROMIA = 0.0425
"""Height of the neck joint above the acromia as a share of stature: .8605 (de Leva 1996, cervicale) less .818
(Drillis and Contini 1966)."""


def trunk_points(at: Mapping[str, Float], lumbar: Float, stature: float) -> dict[str, Float]:
    """Neck, shoulders, elbows, wrists and head, as far as there are markers, (T, 3) each."""
    points: dict[str, Float] = {}
    acromia = [at[f"acromion_{side}"] for side in SIDES] if {"acromion_l", "acromion_r"} <= at.keys() else []
    front = at.get("clavicle")
    if "c7" in at and front is not None:
        # The neck joint of the human is as high as C7 (de Leva 1996), and as far in front of it as Reed's C7/T1.
        along = unit(at["c7"] - lumbar)
        across = front - at["c7"]
        depth = float(np.median(np.linalg.norm(across, axis=-1)))
        ahead = unit(across - np.sum(across * along, axis=-1, keepdims=True) * along)
        points["neck"] = at["c7"] + NECK_SHARE * depth * ahead
    elif acromia:
        middle = (acromia[0] + acromia[1]) / 2
        points["neck"] = middle + NECK_ABOVE_ACROMIA * stature * unit(middle - lumbar)
    elif "c7" in at:
        points["neck"] = at["c7"]
    if acromia:
        breadth = float(np.median(np.linalg.norm(acromia[0] - acromia[1], axis=-1)))
        down = unit(lumbar - (acromia[0] + acromia[1]) / 2)
        points |= {f"shoulder_{side}": acromia[i] + SHOULDER_SHARE * breadth * down for i, side in enumerate(SIDES)}
    for side in SIDES:
        for joint, sides in (("elbow", ("lateral", "medial")), ("wrist", ("radial", "ulnar"))):
            found = [at[f"{joint}_{which}_{side}"] for which in sides if f"{joint}_{which}_{side}" in at]
            if found:
                points[f"{joint}_{side}"] = np.mean(found, axis=0)
    heads = [at[name] for name in ("head_l", "head_r") if name in at]
    if len(heads) == 2:
        points["head"] = (heads[0] + heads[1]) / 2
    elif "vertex" in at:
        points["head"] = at["vertex"]
    return points
