"""The belt of a recording: detected or given, removed, and compared with what the feet show."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexmotion.importers.landmarks import Landmarks
from flexmotion.importers.treadmill import (
    backward_speed,
    backwards,
    belt_velocity,
    feet_rest,
    suspected_velocity,
    tolerance,
    without_belt,
)

Float = NDArray[np.float64]

Belt = float | Literal["detect"] | None
"""Speed of a belt, backwards [m/s]; `detect`, or None for no belt."""

WRONG = "ground forces may be wrong by a third of body weight"
"""What follows from a belt of another speed: with none, or 3 m/s, on the belt of 1.13 m/s of the trial gait2354, the
vertical forces are 23 to 35 % off; within `treadmill.tolerance` they change by .2 %."""


def remove_belt(found: Landmarks, belt: Belt) -> tuple[Landmarks, Float, list[str]]:
    """The recording over ground, the velocity of the belt that was removed, (2,) [m/s], and what a user should know.

    Args:
        found: joint centres at the rate of the file.
        belt: as given; it is taken in any case, with a warning where the feet move otherwise.
    """
    detected = belt_velocity(found)
    velocity = detected if belt == "detect" else np.zeros(2) if belt is None else backwards(found, belt)
    notes = _disagreement(found, belt, velocity, detected)
    if velocity.any():
        way = "given" if belt != "detect" else "detected"
        notes.append(f"a treadmill's belt of {backward_speed(found, velocity):.2f} m/s backwards was removed ({way})")
        return without_belt(found, velocity), velocity, notes
    if belt == "detect" and suspected_velocity(found).any():
        notes.append(
            "this may be a treadmill: one foot moves steadily under a pelvis that stays, but the clip is too short to "
            "prove it, and nothing was removed: give the belt (--belt V, or none)"
        )
    return found, velocity, notes


def _disagreement(found: Landmarks, belt: Belt, velocity: Float, detected: Float) -> list[str]:
    """Warnings where a belt that is given is not what the feet show."""
    if belt == "detect":
        return []
    if belt is None:
        if not detected.any():
            return []
        return [
            f"belt is given as none, but both feet move at {backward_speed(found, detected):.2f} m/s backwards as on a "
            f"treadmill: nothing was removed, and {WRONG}; without --belt it is removed"
        ]
    shown = detected if detected.any() else suspected_velocity(found)
    if shown.any():
        if np.linalg.norm(velocity - shown) <= tolerance(shown):
            return []
        return [
            f"belt is given as {belt:.2f} m/s, but the feet move at {backward_speed(found, shown):.2f} m/s backwards "
            f"as on a treadmill: {WRONG}; without --belt their speed is taken"
        ]
    if feet_rest(found, belt):
        return [
            f"belt is given as {belt:.2f} m/s, but both feet rest while they are on the floor, as over ground: "
            f"{WRONG}; without --belt nothing is removed"
        ]
    return []
