"""The shipped model, as anybody who installs the program has it."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.shipped import shipped_bundle
from flexmotion.concatenate import concatenate
from flexmotion.kinematics import continuous_heading, forward
from flexmotion.sampler import Condition, Sampler


@pytest.fixture(scope="module")
def sampler() -> Sampler:
    folder = shipped_bundle()
    assert folder is not None
    return Sampler(Bundle(folder))


@pytest.mark.parametrize(("sentence", "side"), [("take a step to your left", 1.0), ("go sideways to the right", -1.0)])
def test_who_is_told_to_step_aside_neither_walks_ahead_nor_turns(sampler: Sampler, sentence: str, side: float) -> None:
    """Clips called so walk ahead at 1 m/s meanwhile: who asked for a step to the left was turned by 80 degrees."""
    motion = sampler.standing()
    for window in range(4):
        motion = concatenate([motion, sampler.sample(motion, Condition(sentence), seed=window)])
    yaw = continuous_heading(forward(motion).pelvis_rotation)
    ahead, left = motion.root_position[-1, :2] - motion.root_position[0, :2]
    assert side * left > 0.4 and abs(ahead) < abs(left)
    assert abs(np.degrees(yaw[-1] - yaw[0])) < 45


def test_words_that_mean_a_velocity_give_way_to_one_that_is_asked_for(sampler: Sampler) -> None:
    standing = sampler.standing()
    said = sampler.sample(standing, Condition("step to the left"), seed=3)
    meant = sampler.sample(standing, Condition(velocity=(0.0, 0.4, 0.0)), seed=3)
    other = sampler.sample(standing, Condition("step to the left", velocity=(0.5, 0.0, 0.0)), seed=3)
    np.testing.assert_array_equal(said.joints, meant.joints)
    assert not np.array_equal(said.joints, other.joints)
