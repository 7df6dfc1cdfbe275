"""Which side a robot lies on, from the two angles that the attitude is told by."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.streamer.control.estimator import roll_pitch
from flexmotion.streamer.control.lying import lying_on, pitch_and_lean

FALL_TILT = 0.785


def tilt(pitch: float, lean: float = 0.0) -> np.ndarray:
    """Of a torso that is turned about the vertical, pitched, and then leans to its left or right."""
    attitude = Rotation.from_euler("z", 0.7) * Rotation.from_euler("y", pitch) * Rotation.from_euler("x", lean)
    return np.array(roll_pitch(attitude.as_quat(scalar_first=True)))


@pytest.mark.parametrize("pitch", [-2.5, -1.6, -1.5, -0.4, 0.0, 0.3, 1.4, 1.57, 1.7, 2.8])
def test_the_pitch_goes_on_past_the_vertical(pitch: float) -> None:
    """Beyond 90° the pitch of roll and pitch comes back, and the roll jumps by 180°."""
    found, lean = pitch_and_lean(tilt(pitch))
    assert found == pytest.approx(pitch, abs=1e-6) and lean == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("attitude", "lies"),
    [
        (tilt(0.0), None),
        (tilt(0.7), None),
        (tilt(1.5), "front"),
        (tilt(1.8, 0.3), "front"),
        (tilt(-1.5, -0.3), "back"),
        (tilt(-2.0), "back"),
        (tilt(0.0, 1.5), "side"),
        (tilt(0.2, -1.2), "side"),
    ],
)
def test_where_it_lies(attitude: np.ndarray, lies: str | None) -> None:
    assert lying_on(attitude, FALL_TILT) == lies
