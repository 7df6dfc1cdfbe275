"""`check_upright`: a person who is never upright, or rises by metres, has another axis up than was taken."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmotion.importers.frame_check import UPRIGHT
from flexmotion.importers.mapping import Up
from flexmotion.importers.units import TO_Z_UP

Float = NDArray[np.float64]

ONCE = 98.0
"""Percentile of the shoulders' height over a clip [%] that has to be `UPRIGHT`. In 3015 clips of CMU and Bandai, with a
cartwheel, dances on the floor and climbing, the least is 1.28; with another axis up, or upside down, a walk has .45."""
STEEP = 2.5
"""Hips whose height changes by more than this, over the length of the legs, and more than their place on the floor. The
most of those clips is 2.4, of a climber who moves by 3.9 aside."""


def check_upright(points: Mapping[str, Float], leg: float, up: Up) -> list[str]:
    """Warnings where a person is never upright, or moves up and down more than about.

    People who lie, crawl or stand on their hands for a part of a clip are upright in another one.

    Args:
        points: of a mapping with shoulders, (T, 3), z up [m].
        leg: hip to ankle over the knee [m].
        up: upward axis that was taken for that of the file.
    """
    notes = []
    if (height := _height(points)) < UPRIGHT * leg:
        other: Up = "z" if up == "y" else "y"
        turn = TO_Z_UP[other] @ TO_Z_UP[up].T
        turned = _height({name: value @ turn.T for name, value in points.items()}) >= UPRIGHT * leg
        todo = f"give a mapping with 'up: {other}'" if turned else "is the root turned, or another axis up?"
        notes.append(
            f"never upright: the shoulders are at most {height:.2f} m above the feet, expected {UPRIGHT * leg:.2f} m or"
            f" more at some time; {todo}"
        )
    hips = (points["hip_l"] + points["hip_r"]) / 2
    rise, away = np.ptp(hips[:, 2]), np.linalg.norm(np.ptp(hips[:, :2], axis=0))
    if rise > STEEP * leg and rise > away:
        notes.append(f"the hips rise or sink by {rise:.1f} m and move about by {away:.1f} m: is another axis up?")
    return notes


def _height(points: Mapping[str, Float]) -> float:
    """Greatest height of the shoulders above the lower ankle [m]."""
    shoulders = (points["shoulder_l"] + points["shoulder_r"])[:, 2] / 2
    ankles = np.minimum(points["ankle_l"][:, 2], points["ankle_r"][:, 2])
    return float(np.percentile(shoulders - ankles, ONCE))
