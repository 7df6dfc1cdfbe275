"""Feet moved down or up by stretching or bending the legs, or anywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.human.kinematics import foot_points, forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.importers.default_clip import default_clip
from flexmotion.sampling.leg_length import STRAIGHT, lowered, shifted

KNEES = [JOINTS.index(f"knee_flexion_{side}") for side in SIDES]


@pytest.fixture(scope="module")
def walking() -> Motion:
    """Some steps with knees bent enough to be stretched."""
    motion = default_clip()[225:330]
    joints = motion.joints.copy()
    joints[:, KNEES] = np.maximum(joints[:, KNEES], 0.6)
    return replace(motion, joints=joints)


@pytest.mark.parametrize("down", [-0.05, -0.02, 0.01, 0.03])
def test_feet_are_lowered_and_keep_position_and_pitch(walking: Motion, down: float) -> None:
    before = forward(walking)
    found = forward(lowered(walking, np.full((len(walking), 2), down), before.hip, before.ankle))
    moved = found.ankle - before.ankle
    np.testing.assert_allclose(moved[..., 2], -down, atol=0.002)
    assert np.linalg.norm(moved[..., :2], axis=-1).max() < 0.5 * abs(down)  # along the inclined leg
    turned = np.einsum("tsij,tsij->ts", before.foot_rotation, found.foot_rotation)  # trace of the relative rotation
    assert np.degrees(np.arccos(np.clip((turned - 1) / 2, -1, 1))).max() < 2.0


def test_each_foot_by_itself(walking: Motion) -> None:
    before = forward(walking)
    down = np.zeros((len(walking), 2))
    down[:, 1] = 0.02
    found = lowered(walking, down, before.hip, before.ankle)
    others = [at for at, name in enumerate(JOINTS) if not name.endswith("_r")]
    np.testing.assert_array_equal(found.joints[:, others], walking.joints[:, others])


def test_a_leg_bent_beyond_the_limit_is_unchanged(walking: Motion) -> None:
    joints = walking.joints.copy()
    joints[:, KNEES] = np.radians(149.0)
    squatting = replace(walking, joints=joints)
    human = forward(squatting)
    found = lowered(squatting, np.zeros((len(walking), 2)), human.hip, human.ankle)
    np.testing.assert_allclose(found.joints, squatting.joints, atol=1e-9)


def test_a_knee_is_not_stretched_beyond_straight(walking: Motion) -> None:
    before = forward(walking)
    found = lowered(walking, np.full((len(walking), 2), 0.5), before.hip, before.ankle)
    np.testing.assert_allclose(found.joints[:, KNEES], STRAIGHT, atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(st.tuples(*[st.floats(-0.12, 0.12) for _ in range(4)]), st.floats(0.0, 0.05))
def test_soles_are_moved_where_they_are_wanted_and_keep_their_pitch(ways: tuple[float, ...], up: float) -> None:
    motion = default_clip()[225:330]
    joints = motion.joints.copy()
    joints[:, KNEES] = np.maximum(joints[:, KNEES], 0.9)
    motion = replace(motion, joints=joints)
    by = np.zeros((len(motion), 2, 3))
    by[..., :2], by[..., 2] = np.array(ways).reshape(2, 2), up
    found = shifted(motion, by, motion.joints[0])
    before, after = foot_points(motion), foot_points(found)
    np.testing.assert_allclose((after - before).mean(axis=2), by, atol=0.003)
    # The foot tilts with its leg, as the ankle has one axis; its pitch stays.
    np.testing.assert_allclose(np.diff(after, axis=2)[..., 2], np.diff(before, axis=2)[..., 2], atol=0.01)
    others = [at for at, name in enumerate(JOINTS) if not name.startswith(("hip", "knee", "ankle"))]
    np.testing.assert_array_equal(found.joints[:, others], motion.joints[:, others])


def test_a_foot_that_is_not_moved_keeps_its_leg(walking: Motion) -> None:
    by = np.zeros((len(walking), 2, 3))
    by[10:, 1, 0] = 0.05
    found = shifted(walking, by, walking.joints[0])
    left = [at for at, name in enumerate(JOINTS) if not name.endswith("_r")]
    np.testing.assert_allclose(found.joints[:, left], walking.joints[:, left], atol=1e-9)
    np.testing.assert_allclose(found.joints[:10], walking.joints[:10], atol=1e-9)


def test_a_place_out_of_reach_is_approached_by_a_straight_leg(walking: Motion) -> None:
    by = np.broadcast_to([0.0, 0.0, -1.0], (len(walking), 2, 3))
    found = shifted(walking, by, walking.joints[0])
    np.testing.assert_allclose(found.joints[:, KNEES], STRAIGHT, atol=1e-6)
    assert np.isfinite(found.joints).all()
