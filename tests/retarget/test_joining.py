from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.retarget.balance import divergent_component
from flexmotion.retarget.joining import JoinAbsorber

OMEGA, DT, SHORTEST = 6.5, 0.008, 0.15
SOLE = np.array([0.06, 0.04])
ABSORBER = JoinAbsorber(SOLE, OMEGA, DT, SHORTEST)
ZMP = np.random.default_rng(0).normal(scale=0.02, size=(120, 2))
DCM = divergent_component(ZMP, OMEGA, DT)


def decay_s(dcm: np.ndarray) -> float:
    """How long a jump takes to decay [s]."""
    return float(DT * (np.abs(dcm - DCM).max(axis=1) > 1e-12).sum())


def test_a_small_jump_decays_in_the_shortest_time() -> None:
    found = ABSORBER.absorb(ZMP, DCM, DCM[0] + [0.002, 0.002], 0.0)
    np.testing.assert_allclose(found.dcm[0], DCM[0] + [0.002, 0.002])
    assert decay_s(found.dcm) == pytest.approx(SHORTEST, abs=DT)
    assert found.excess < 1.0


@given(along=st.floats(-0.05, 0.05), across=st.floats(-0.05, 0.05), yaw=st.floats(-3.0, 3.0))
def test_the_excess_is_the_displacement_of_the_zmp_over_half_a_sole(along: float, across: float, yaw: float) -> None:
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cos, -sin], [sin, cos]])
    found = ABSORBER.absorb(ZMP, DCM, DCM[0] + turn @ [along, across], yaw)
    moved = np.abs((found.zmp - ZMP) @ turn).max(axis=0) / (0.5 * SOLE)
    assert moved.max() == pytest.approx(found.excess, abs=1e-9)
    np.testing.assert_allclose(found.dcm[0], DCM[0] + turn @ [along, across], atol=1e-12)
    np.testing.assert_allclose(found.dcm[round(3 * SHORTEST / DT) + 1 :], DCM[round(3 * SHORTEST / DT) + 1 :])


def test_a_larger_jump_takes_longer() -> None:
    times = [decay_s(ABSORBER.absorb(ZMP, DCM, DCM[0] + [0.0, jump], 0.0).dcm) for jump in (0.005, 0.010, 0.012, 0.04)]
    np.testing.assert_allclose(times, np.array([1.0, 1.5, 2.0, 3.0]) * SHORTEST, atol=DT)


def test_no_jump_has_no_excess() -> None:
    found = ABSORBER.absorb(ZMP, DCM, DCM[0], 0.3)
    np.testing.assert_array_equal(found.zmp, ZMP)
    assert found.excess == 0.0
