"""The tilt of a torso, and whether it is more than was planned."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.spatial.tilt import falls, lean_of, lean_of_angles, tilt_of

LIMIT = 0.785
BOW = np.array([1.15, 0.0])

angles = st.floats(-3.1, 3.1)
leans = st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)).map(np.array)


def rotated(sequence: str, *each: float) -> np.ndarray:
    return Rotation.from_euler(sequence, each).as_quat(scalar_first=True)


@settings(max_examples=50)
@given(st.floats(0, np.pi), angles, st.sampled_from(["x", "y"]))
def test_the_tilt_is_the_angle_of_the_up_axis_whatever_the_heading(tilt: float, yaw: float, axis: str) -> None:
    assert tilt_of(rotated(f"Z{axis.upper()}", yaw, tilt)) == pytest.approx(tilt, abs=1e-6)


@settings(max_examples=50)
@given(angles, st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_roll_and_pitch_give_the_lean_of_their_quaternion(yaw: float, pitch: float, roll: float) -> None:
    np.testing.assert_allclose(lean_of(rotated("ZYX", yaw, pitch, roll)), lean_of_angles(roll, pitch), atol=1e-6)


def test_a_lean_points_to_where_the_body_leans() -> None:
    np.testing.assert_allclose(lean_of(rotated("ZY", 2.0, 0.6)), [0.6, 0.0], atol=1e-12)  # ahead
    np.testing.assert_allclose(lean_of(rotated("ZX", 2.0, -0.6)), [0.0, 0.6], atol=1e-12)  # to the left
    assert np.isnan(lean_of(np.full(4, np.nan))).all()


@settings(max_examples=100)
@given(leans)
def test_a_robot_that_is_to_be_upright_falls_from_one_tilt_on_in_every_direction(lean: np.ndarray) -> None:
    """With a plan of exactly no tilt every lean counted as none."""
    for planned in (np.zeros(2), np.array([1e-9, 0.0]), np.array([0.0, -0.3])):
        assert falls(lean, planned, LIMIT) == (np.hypot(*lean) > LIMIT)


def test_a_bow_may_be_as_deep_as_its_plan_and_a_little_more() -> None:
    along = np.array([[-0.8, 0.0], [-0.7, 0.0], [0.9, 0.0], [1.15, 0.0], [1.34, 0.0], [1.36, 0.0]])
    assert falls(along, BOW, LIMIT).tolist() == [True, False, False, False, False, True]


def test_a_bow_that_leans_aside_falls() -> None:
    aside = np.array([[1.15, 0.15], [1.15, 0.3], [0.6, 0.4], [0.6, 0.7]])
    assert falls(aside, BOW, LIMIT).tolist() == [False, True, False, True]


@settings(max_examples=200)
@given(
    st.floats(0.0, 1.25), st.floats(-np.pi, np.pi), st.floats(0.0, 1.0), st.floats(0.0, 0.19), st.floats(-np.pi, np.pi)
)
def test_a_robot_that_lags_into_its_bow_or_out_of_it_does_not_fall(
    deep: float, direction: float, share: float, off: float, aside: float
) -> None:
    planned = deep * np.array([np.cos(direction), np.sin(direction)])
    lean = share * planned + off * np.array([np.cos(aside), np.sin(aside)])
    assert not falls(lean, planned, LIMIT)


@settings(max_examples=200)
@given(leans, leans)
def test_no_plan_makes_a_fall_of_a_tilt_that_is_none(lean: np.ndarray, planned: np.ndarray) -> None:
    if np.hypot(*lean) <= LIMIT:
        assert not falls(lean, planned, LIMIT)
