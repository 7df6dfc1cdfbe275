"""Activations that are asked, and what the other muscles do about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from flexmotion.biomechanics.muscle_arms import MuscleArms
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.muscle_share import SPREAD, with_muscles

FRAMES = 24


@pytest.fixture
def tense() -> Motion:
    """A human that bends and stretches its legs, its muscles at .3."""
    joints = np.zeros((FRAMES, len(JOINTS)))
    for side in "lr":
        joints[:, JOINTS.index(f"knee_flexion_{side}")] = 0.4 + 0.3 * np.sin(np.arange(FRAMES) / 4)
    return Motion(
        fps=30.0,
        body=Body(),
        root_position=np.tile([0.0, 0.0, 0.9], (FRAMES, 1)),
        root_quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES, 1)),
        joints=joints,
        activations=np.full((FRAMES, MuscleArms.shipped().muscles), 0.3),
    )


def torques(motion: Motion) -> np.ndarray:
    assert motion.activations is not None
    begin, found = 0, []
    for part in MuscleArms.shipped().at(motion):
        own = motion.activations[:, begin : begin + part.shape[2]]
        begin += part.shape[2]
        found.append(np.einsum("tjm,tm->tj", part, own))
    return np.concatenate(found, axis=1)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(muscle=st.integers(0, 289), wanted=st.floats(0.0, 1.0))
def test_one_muscle_is_as_asked_at_the_same_torques(tense: Motion, muscle: int, wanted: float) -> None:
    mask = np.zeros((FRAMES, 290), np.bool_)
    mask[:, muscle] = True
    found = with_muscles(tense, np.full(mask.shape, wanted), mask)
    assert found.activations is not None
    assert found.activations[:, muscle] == pytest.approx(wanted)
    assert found.activations.min() >= 0.0 and found.activations.max() <= 1.0
    assert torques(found) == pytest.approx(torques(tense), abs=0.05)


def test_several_muscles_at_once_are_made_up_for_where_others_can(tense: Motion) -> None:
    """A muscle that had reached a bound was never let go again: torques were left that others could have given."""
    rng = np.random.default_rng(4)
    asked, mask = np.zeros((FRAMES, 290)), np.zeros((FRAMES, 290), np.bool_)
    chosen = rng.permutation(40)[:8]
    asked[:, chosen], mask[:, chosen] = rng.uniform(0.0, 0.7, 8), True
    found = with_muscles(tense, asked, mask)
    assert found.activations is not None and tense.activations is not None
    arms = MuscleArms.shipped().at(tense)[0]
    free = np.setdiff1d(np.arange(40), chosen)
    for frame in range(0, FRAMES, 6):
        fixed = arms[frame][:, chosen] @ asked[frame, chosen]
        wanted = arms[frame] @ tense.activations[frame, :40] - fixed
        best = lsq_linear(arms[frame][:, free], wanted, bounds=(0.0, 1.0))
        left = np.abs(arms[frame] @ found.activations[frame, :40] - wanted - fixed).max()
        assert left < np.abs(best.fun).max() + 0.2


def test_the_other_leg_does_not_change(tense: Motion) -> None:
    mask = np.zeros((FRAMES, 290), np.bool_)
    mask[:, 7] = True
    found = with_muscles(tense, np.full(mask.shape, 0.9), mask)
    assert found.activations is not None and tense.activations is not None
    np.testing.assert_array_equal(found.activations[:, 40:], tense.activations[:, 40:])
    assert np.abs(found.activations - tense.activations)[:, :40].max() > 0.05


def test_a_keyframe_is_reached_without_a_spike(tense: Motion) -> None:
    mask = np.zeros((FRAMES, 290), np.bool_)
    mask[12, 7] = True
    found = with_muscles(tense, np.full(mask.shape, 0.9), mask)
    assert found.activations is not None
    own = found.activations[:, 7]
    assert own[12] == pytest.approx(0.9)
    assert np.abs(np.diff(own)).max() < 0.6 / (SPREAD - 2)
    assert own[:6] == pytest.approx(0.3) and own[19:] == pytest.approx(0.3)


def test_what_all_muscles_are_asked_is_taken_whatever_the_torques(tense: Motion) -> None:
    mask = np.ones((FRAMES, 290), np.bool_)
    found = with_muscles(tense, np.full(mask.shape, 0.1), mask)
    assert found.activations == pytest.approx(0.1)


def test_a_motion_without_these_muscles_is_refused(tense: Motion) -> None:
    mask = np.zeros((FRAMES, 4), np.bool_)
    with pytest.raises(ValueError, match="290 muscles"):
        with_muscles(replace(tense, activations=np.zeros((FRAMES, 4))), np.zeros((FRAMES, 4)), mask)
