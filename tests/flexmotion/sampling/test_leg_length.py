"""Feet moved down or up by stretching or bending the legs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.leg_length import STRAIGHT, lowered

from .bent_knees import KNEES, bent_walk


@pytest.fixture(scope="module")
def walking() -> Motion:
    """Some steps with knees bent enough to be stretched."""
    return bent_walk(0.6)


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
