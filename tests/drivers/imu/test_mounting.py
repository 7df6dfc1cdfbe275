from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import DriverError
from flexmotion.drivers.imu.mounting import mounting
from flexmotion.spatial.gravity import GRAVITY

UP = np.array([0.0, 0.0, GRAVITY])
angle = st.floats(-3.0, 3.0)


def felt(lean: float) -> np.ndarray:
    """Specific force in the frame of a torso that leans forward [rad]."""
    return Rotation.from_euler("y", lean).inv().apply(UP)


@given(true=st.tuples(angle, angle, angle), lean=st.floats(0.3, 1.4), believed=st.tuples(angle, angle, angle))
def test_two_directions_determine_the_mounting(
    true: tuple[float, float, float], lean: float, believed: tuple[float, float, float]
) -> None:
    sits, before = Rotation.from_euler("zyx", true), Rotation.from_euler("zyx", believed)

    def measured(force: np.ndarray) -> np.ndarray:
        return before.apply(sits.inv().apply(force))

    found = mounting(before, measured(UP), measured(felt(lean)))
    assert (found * sits.inv()).magnitude() < 1e-6


def test_impossible_directions_are_refused() -> None:
    none = Rotation.identity()
    with pytest.raises(DriverError, match="leaned by 6° only, expected 15° or more"):
        mounting(none, UP, felt(0.1))
    with pytest.raises(DriverError, match=r"upright: measures 12\.75 m/s² at rest, expected 9\.81"):
        mounting(none, 1.3 * UP, felt(0.5))
