from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.retarget.smoothing import Follower

DT = 0.008
FOLLOWER = Follower(omega=np.array([9.0, 22.0]), speed=np.array([0.25, 4.0]), acceleration=np.array([3.0, 80.0]), dt=DT)
jumpy = st.lists(st.tuples(st.floats(-10, 10), st.floats(-10, 10)), min_size=1, max_size=80).map(np.array)


@given(targets=jumpy)
def test_speed_and_acceleration_stay_within_their_bounds(targets: np.ndarray) -> None:
    start = np.array([0.1, -0.2])
    position, velocity, _, _ = FOLLOWER.follow(targets, start, np.zeros(2))
    assert (np.abs(velocity) <= FOLLOWER.speed + 1e-12).all()
    change = np.diff(np.vstack([np.zeros(2), velocity]), axis=0)
    assert (np.abs(change) <= FOLLOWER.acceleration * DT + 1e-12).all()
    np.testing.assert_allclose(np.diff(np.vstack([start, position]), axis=0), DT * velocity, atol=1e-12)


def test_it_converges_to_a_target_without_overshoot() -> None:
    position, velocity, slow, soft = FOLLOWER.follow(np.full((600, 2), 0.02), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(position[-1], 0.02, atol=1e-6)
    np.testing.assert_allclose(velocity[-1], 0.0, atol=1e-6)
    assert position.max() <= 0.02 + 1e-9
    assert not slow.any() and not soft.any()


def test_it_converges_with_active_bounds() -> None:
    position, velocity, slow, soft = FOLLOWER.follow(np.full((2000, 2), 1.0), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(position[-1], 1.0, atol=1e-6)
    assert slow.any(axis=0).all() and soft.any(axis=0).all()
    assert velocity[:, 0].max() == pytest.approx(0.25)


def test_it_lags_a_moving_target_by_two_time_constants() -> None:
    speed = np.array([0.1, 1.0])
    targets = np.arange(500)[:, None] * DT * speed
    position, _, _, _ = FOLLOWER.follow(targets, np.zeros(2), np.zeros(2))
    lag = (targets[-1] - position[-1]) / speed
    np.testing.assert_allclose(lag, 2.0 / FOLLOWER.omega, atol=2 * DT)


def test_two_parts_equal_the_whole() -> None:
    targets = np.random.default_rng(1).normal(size=(100, 2))
    whole = FOLLOWER.follow(targets, np.zeros(2), np.zeros(2))
    first = FOLLOWER.follow(targets[:37], np.zeros(2), np.zeros(2))
    second = FOLLOWER.follow(targets[37:], first[0][-1], first[1][-1])
    for one, head, tail in zip(whole, first, second, strict=True):
        np.testing.assert_array_equal(one, np.concatenate([head, tail]))


def row_by_row(
    follower: Follower, targets: np.ndarray, x: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What `Follower.follow` computes, as its class describes it."""
    rows = []
    gain = follower.omega**2 * DT
    divisor = 1.0 + 2.0 * follower.omega * DT + gain * DT
    for target in targets:
        wish = (v + gain * (target - x)) / divisor
        bound = np.clip(wish, v - follower.acceleration * DT, v + follower.acceleration * DT)
        v = np.clip(bound, -follower.speed, follower.speed)
        x = x + v * DT
        rows.append((x, v, v != bound, bound != wish))
    return tuple(np.array(column) for column in zip(*rows, strict=True))  # type: ignore[return-value]


@given(
    reach=st.floats(0.01, 8.0),
    pace=st.floats(0.2, 20.0),
    start=st.floats(-1.0, 1.0),
    speed=st.floats(-6.0, 6.0),
)
def test_channels_at_and_beyond_their_bounds_move_as_row_by_row(
    reach: float, pace: float, start: float, speed: float
) -> None:
    """Slow targets meet the speed bound alone, fast ones both, small ones none, and a start may be beyond both."""
    targets = reach * np.sin(pace * DT * np.arange(60))[:, None] * [1.0, 0.3]
    x, v = np.array([start, -start]), np.array([speed, 0.0])
    for found, known in zip(FOLLOWER.follow(targets, x, v)[:2], row_by_row(FOLLOWER, targets, x, v)[:2], strict=True):
        np.testing.assert_allclose(found, known, atol=1e-9)


def test_active_bounds_are_told_row_by_row() -> None:
    targets = np.sin(3.0 * DT * np.arange(300))[:, None] * [5.0, 0.5]
    found, known = (way(targets, np.zeros(2), np.zeros(2)) for way in (FOLLOWER.follow, partial(row_by_row, FOLLOWER)))
    for own, other in zip(found[2:], known[2:], strict=True):
        np.testing.assert_array_equal(own, other)
    assert found[2][:, 0].any() and found[3][:, 0].any() and not found[2][:, 1].any()
