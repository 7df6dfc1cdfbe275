"""Angles of joints with three axes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.human.angles import rotation_about, three_angles

SHOULDER = ("shoulder_flexion", "shoulder_adduction", "shoulder_rotation")
LUMBAR = ("lumbar_extension", "lumbar_bending", "lumbar_rotation")


def compose(angles: np.ndarray, side: str) -> np.ndarray:
    flexion, adduction, rotation = angles.T
    sign = -1.0 if side == "l" else 1.0
    return rotation_about("y", -flexion) @ rotation_about("x", sign * adduction) @ rotation_about("z", sign * rotation)


@settings(max_examples=50)
@given(st.lists(st.floats(-3.1, 3.1), min_size=3, max_size=3), st.sampled_from("lr"))
def test_angles_reproduce_the_rotation(start, side):
    steps = np.random.default_rng(0).normal(scale=0.1, size=(40, 3)).cumsum(axis=0)
    rotation = compose(np.array(start) + steps, side)
    angles = three_angles(rotation, SHOULDER, side)
    np.testing.assert_allclose(compose(angles, side), rotation, atol=1e-9)
    # No jump of half a turn or more, from any start.
    assert np.abs(np.diff(angles, axis=0)).max() < np.pi


@pytest.mark.parametrize("side", ["l", "r"])
def test_an_arm_lifted_sideways_overhead_keeps_its_angles(side):
    # Above the horizontal the usual formula switches to the mirror solution.
    adduction = -np.linspace(0.1, 2.6, 50)
    truth = np.column_stack([np.full(50, 0.2), adduction, np.full(50, -0.4)])
    np.testing.assert_allclose(three_angles(compose(truth, side), SHOULDER, side), truth, atol=1e-6)


def test_a_trunk_that_makes_several_turns_does_not_jump():
    yaw = np.linspace(0, 6 * np.pi, 200)
    angles = three_angles(rotation_about("z", yaw), LUMBAR)
    assert np.abs(np.diff(angles, axis=0)).max() < 0.2


def test_no_frames():
    assert three_angles(np.empty((0, 3, 3)), LUMBAR).shape == (0, 3)


def test_rotation_about_agrees_with_scipy():
    angle = np.linspace(-1, 1, 5)
    np.testing.assert_allclose(
        rotation_about("x", angle), Rotation.from_euler("x", angle[:, None]).as_matrix(), atol=1e-12
    )
