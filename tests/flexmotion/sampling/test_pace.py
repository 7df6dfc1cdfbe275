"""Velocities within a pace."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.sampling.pace import Pace

PACE = Pace(ahead=0.5, back=0.4, aside=0.2, turning=0.8)
SPEED = st.floats(-3.0, 3.0)


@pytest.mark.parametrize(
    ("asked", "slowed"),
    [
        ((0.3, 0.1, 0.5), (0.3, 0.1, 0.5)),  # within the limits
        ((1.0, 0.0, 0.0), (0.5, 0.0, 0.0)),
        ((-1.0, 0.0, 0.0), (-0.4, 0.0, 0.0)),
        ((0.0, -0.4, 0.0), (0.0, -0.2, 0.0)),
        ((0.3, 0.0, 1.6), (0.15, 0.0, 0.8)),  # the same shape of the path
        ((0.5, 0.2, 0.0), (0.5 / 2**0.5, 0.2 / 2**0.5, 0.0)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ],
)
def test_velocities_beyond_the_limits_are_slowed(
    asked: tuple[float, float, float], slowed: tuple[float, float, float]
) -> None:
    assert PACE.slowed(asked) == pytest.approx(slowed)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf"), "fast"])
def test_limits_must_be_positive(speed: float) -> None:
    """Regression: division by a sideways limit of 0, also without sideways velocity."""
    with pytest.raises(ValueError, match="above 0"):
        Pace(0.5, 0.4, speed, 1.0)


@given(SPEED, SPEED, SPEED)
def test_a_slowed_velocity_keeps_its_direction_within_every_limit(forward: float, left: float, turning: float) -> None:
    asked = np.array([forward, left, turning])
    found = np.array(PACE.slowed((forward, left, turning)))
    np.testing.assert_allclose(np.cross(asked, found), 0.0, atol=1e-12)
    assert asked @ found >= 0.0 and (np.abs(found) <= np.abs(asked) + 1e-12).all()
    assert -PACE.back - 1e-9 <= found[0] <= PACE.ahead + 1e-9
    assert abs(found[1]) <= PACE.aside + 1e-9 and abs(found[2]) <= PACE.turning + 1e-9
    np.testing.assert_allclose(PACE.slowed(tuple(found)), found, atol=1e-12)
