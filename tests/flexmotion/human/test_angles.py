"""Angles of joints with three axes."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.human.angles import REACH, angles_of_joints, rotation_about, three_angles

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


def test_joints_that_are_solved_in_one_go_have_the_angles_that_each_has_alone():
    joints = [(LUMBAR, ""), (SHOULDER, "l"), (SHOULDER, "r")]
    turning = Rotation.from_rotvec(np.linspace(0, 3, 20)[:, None] * [0.5, 1.0, 0.2])
    starts = Rotation.random(3, rng=np.random.default_rng(1))
    turns = np.stack([(start * turning).as_matrix() for start in starts], axis=1)
    alone = [three_angles(turns[:, place], *joint) for place, joint in enumerate(joints)]
    np.testing.assert_array_equal(angles_of_joints(turns, joints), np.concatenate(alone, axis=1))


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_no_other_choice_of_solutions_moves_less(seed, frames):
    rotation = Rotation.random(frames, rng=np.random.default_rng(seed)).as_matrix()

    def cost(angles: np.ndarray) -> float:
        steps = (np.diff(angles, axis=0) + np.pi) % (2 * np.pi) - np.pi
        second = np.abs((angles[:, 1] + np.pi) % (2 * np.pi) - np.pi)
        return float((steps**2).sum() + 1e-3 * np.maximum(second - REACH, 0.0).sum())

    def choice(places: tuple[int, ...]) -> np.ndarray:
        # Of a rotation's two solutions the second is half a turn about the first and last axis from the first.
        other = found * [1.0, -1.0, 1.0] + np.pi
        return np.where(np.array(places)[:, None] == 1, other, found)

    found = three_angles(rotation, LUMBAR)
    least = min(cost(choice(places)) for places in product((0, 1), repeat=frames))
    assert cost(found) <= least + 1e-9


def test_no_frames():
    assert three_angles(np.empty((0, 3, 3)), LUMBAR).shape == (0, 3)


@pytest.mark.parametrize("axis", "xyz")
def test_rotation_about_agrees_with_scipy(axis):
    angle = np.linspace(-1, 1, 5)
    truth = Rotation.from_euler(axis, angle[:, None]).as_matrix()
    np.testing.assert_allclose(rotation_about(axis, angle), truth, atol=1e-12)
