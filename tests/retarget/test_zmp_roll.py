from __future__ import annotations

import numpy as np
import pytest

from flexmotion.retarget.balance import centre_of_mass, divergent_component
from flexmotion.retarget.zmp_roll import roll_share, steady_hips

OMEGA, SWING, PAUSE, DT = 6.6, 0.4, 0.08, 1e-3


@pytest.mark.parametrize("roll", [0.0, 0.2])
def test_the_hips_go_as_the_pendulum_of_a_walk_of_many_such_steps(roll: float) -> None:
    """Went wrong: swings were made for hips that slow down over the foot more than those of plans do."""
    step = round((SWING + PAUSE) / DT)
    swing = round(SWING / DT)
    rolls = roll * np.linspace(-1.0, 1.0, swing)
    moves = np.linspace(roll, 1.0 - roll, step - swing)
    zmp = np.concatenate([np.concatenate([rolls, moves]) + number for number in range(30)])
    zmp = np.stack([zmp, np.zeros_like(zmp)], axis=1)
    dcm = divergent_component(zmp, OMEGA, DT)
    com, _ = centre_of_mass(dcm, dcm[0], OMEGA, DT)
    begin = 15 * step
    found = com[begin : begin + swing, 0] - 15
    expected = steady_hips(np.linspace(0.0, 1.0, swing), np.array([roll]), np.array([SWING]), PAUSE, OMEGA)[0]
    np.testing.assert_allclose(found, expected, atol=0.005)


def test_a_walk_without_double_support_is_no_special_case() -> None:
    phase, roll, seconds = np.linspace(0.0, 1.0, 9), np.array([0.2]), np.array([SWING])
    np.testing.assert_allclose(
        steady_hips(phase, roll, seconds, 0.0, OMEGA), steady_hips(phase, roll, seconds, 1e-6, OMEGA), atol=1e-5
    )


def test_a_long_stride_rolls_by_no_more_than_a_part_of_the_sole() -> None:
    assert roll_share(np.array([0.05, -0.05]), 0.057) == pytest.approx(0.2)
    assert 0.2 * roll_share(np.array([0.2]), 0.057) == pytest.approx(0.4 * 0.2 * 0.057 / 0.2)
