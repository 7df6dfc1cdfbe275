from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.retarget.balance import absorb, centre_of_mass, divergent_component

OMEGA, DT = 6.5, 0.008
GROWTH = np.exp(OMEGA * DT)

paths = st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.2, 0.2)), min_size=2, max_size=60).map(np.array)
points = st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)).map(np.array)


def assert_obeys_the_pendulum(zmp: np.ndarray, dcm: np.ndarray) -> None:
    """The exact step of xi' = w (xi - p) under a constant p from each row to the next."""
    np.testing.assert_allclose(dcm[1:], zmp[:-1] + GROWTH * (dcm[:-1] - zmp[:-1]), atol=1e-9)


@given(zmp=paths)
def test_divergent_component_obeys_the_pendulum_and_ends_at_the_zmp(zmp: np.ndarray) -> None:
    dcm = divergent_component(zmp, OMEGA, DT)
    assert_obeys_the_pendulum(zmp, dcm)
    np.testing.assert_allclose(dcm[-1], zmp[-1], atol=1e-12)
    assert (dcm >= zmp.min(axis=0) - 1e-12).all() and (dcm <= zmp.max(axis=0) + 1e-12).all()


def test_divergent_component_leads_a_step_of_the_zmp() -> None:
    zmp = np.zeros((200, 2))
    zmp[100:, 1] = 1.0
    dcm = divergent_component(zmp, OMEGA, DT)[:, 1]
    lead = (100 - np.arange(100)) * DT
    np.testing.assert_allclose(dcm[:100], np.exp(-OMEGA * lead), atol=1e-9)


@given(zmp=paths, error=points, seconds=st.floats(0.02, 0.4))
def test_absorb_starts_at_the_robots_state_and_ends_at_the_plan(
    zmp: np.ndarray, error: np.ndarray, seconds: float
) -> None:
    dcm = divergent_component(zmp, OMEGA, DT)
    moved, bent = absorb(zmp, dcm, error, OMEGA, DT, seconds)
    np.testing.assert_allclose(bent[0], dcm[0] + error, atol=1e-12)
    assert_obeys_the_pendulum(moved, bent)
    over = int(np.ceil(seconds / DT - 1e-9))
    np.testing.assert_allclose(bent[over:], dcm[over:], atol=1e-12)
    np.testing.assert_allclose(moved[over:], zmp[over:], atol=1e-12)


def test_absorbing_no_jump_changes_nothing() -> None:
    zmp = np.random.default_rng(0).normal(size=(40, 2))
    dcm = divergent_component(zmp, OMEGA, DT)
    moved, same = absorb(zmp, dcm, np.zeros(2), OMEGA, DT, 0.15)
    np.testing.assert_array_equal(moved, zmp)
    np.testing.assert_array_equal(same, dcm)


@given(zmp=paths, start=points)
def test_centre_of_mass_follows_the_divergent_component(zmp: np.ndarray, start: np.ndarray) -> None:
    dcm = divergent_component(zmp, OMEGA, DT)
    com, velocity = centre_of_mass(dcm, start, OMEGA, DT)
    np.testing.assert_allclose(com[0], start)
    np.testing.assert_allclose(com + velocity / OMEGA, dcm, atol=1e-12)
    np.testing.assert_allclose(com[1:], dcm[:-1] + np.exp(-OMEGA * DT) * (com[:-1] - dcm[:-1]), atol=1e-12)


def test_centre_of_mass_comes_to_rest_over_a_constant_zmp() -> None:
    com, velocity = centre_of_mass(np.tile([0.02, -0.01], (300, 1)), np.zeros(2), OMEGA, DT)
    np.testing.assert_allclose(com[-1], [0.02, -0.01], atol=1e-6)
    assert np.abs(velocity[-1]).max() < 1e-5
