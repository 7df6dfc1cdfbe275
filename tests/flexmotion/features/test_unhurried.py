"""Shoulders on their way between poses: no faster than people, and only where a window is faster."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.features.joint_groups import PELVIS_SIZE, matrix, six
from flexmotion.features.layout import Layout
from flexmotion.features.unhurried import CALM, FASTEST, SHOULDERS, SPIN, unhurried
from flexmotion.spatial.rotations import matrices, matrix_quaternions, rotation_vectors, vector_quaternions
from flexmotion.spatial.transitions import minimum_jerk

FPS = 30.0
LAYOUT = Layout(FPS)
FIRST = LAYOUT.blocks["rotations"].start + PELVIS_SIZE
LEFT, RIGHT = (slice(FIRST + 6 * ball, FIRST + 6 * ball + 6) for ball in SHOULDERS)


def _features(left: np.ndarray, right: np.ndarray | None = None) -> np.ndarray:
    """Features of a body at rest but for its shoulders, by their rotation vectors, (T, 3) [rad]."""
    rest = six(np.eye(3))
    found = np.zeros((len(left), LAYOUT.size), np.float32)
    found[:, LAYOUT.blocks["rotations"]][:, : 6 * 7] = np.tile(rest, 7)
    for own, vectors in ((LEFT, left), (RIGHT, left if right is None else right)):
        found[:, own] = six(matrices(vector_quaternions(vectors)))
    return found


def _turns(features: np.ndarray, own: slice) -> np.ndarray:
    """Speeds of a shoulder from frame to frame [rad/s]."""
    rotations = matrix(features[:, own].astype(float))
    between = rotations[:-1].swapaxes(-1, -2) @ rotations[1:]
    return np.linalg.norm(rotation_vectors(matrix_quaternions(between)), axis=-1) * FPS


@given(
    axis=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda one: np.linalg.norm(one) > 0.1),
    angle=st.floats(0.5, 3.1),
    jumps=st.integers(8, 22),
)
def test_an_arm_that_a_decoder_turns_over_goes_at_the_speed_of_people(
    axis: tuple[float, ...], angle: float, jumps: int
) -> None:
    """Went wrong: of an arm that pointed up and was to hang in a dash, the hand went 17 m/s."""
    away = angle * np.array(axis) / np.linalg.norm(axis)
    pose = np.zeros((32, 3))
    pose[:jumps] = away
    history, frames = _features(np.tile(away, (8, 1))), _features(pose, np.zeros((32, 3)))
    history[:, RIGHT] = frames[0, RIGHT]
    found = unhurried(frames, history, LAYOUT, CALM)
    assert _turns(np.concatenate([history, frames]), LEFT).max() > 1.5 * CALM
    slowed = _turns(np.concatenate([history, found]), LEFT)
    # Within the window there is not always time enough for all of the way.
    assert slowed.max() <= max(1.02 * SPIN * CALM, 1.6 * angle * FPS / (2 * min(jumps, 32 - jumps)))
    assert slowed.sum() == pytest.approx(angle * FPS, abs=1e-3)
    np.testing.assert_allclose(found[-1], frames[-1], atol=1e-6)
    np.testing.assert_array_equal(found[:, RIGHT], frames[:, RIGHT])


@pytest.mark.parametrize("peak", [6.0, 8.0, 10.0])
def test_a_raise_that_is_too_fast_is_slowed_without_a_jump_of_speed(peak: float) -> None:
    """Went wrong: an arm led to where it goes joined it at its full speed, from 1.8 to 6.6 rad/s in a frame."""
    time = np.arange(32) / FPS
    raised = np.outer(2.4 * minimum_jerk((time - 0.2) * peak / (1.875 * 2.4)), [0.0, 1.0, 0.0])
    frames = _features(raised)
    history = frames[:1].repeat(8, axis=0)
    found = unhurried(frames, history, LAYOUT, CALM)
    slowed, before = (_turns(np.concatenate([history, each]), LEFT) for each in (found, frames))
    assert before.max() > CALM >= 0.98 * slowed.max()
    assert np.abs(np.diff(slowed)).max() <= 1.3 * np.abs(np.diff(before)).max()


@pytest.mark.parametrize("known", [0, 1, 8])
def test_a_window_that_is_no_faster_than_people_is_itself(known: int) -> None:
    swung = np.outer(np.sin(np.arange(32) / FPS * 5.0), [0.0, 1.0, 0.0])
    frames = _features(swung)
    assert unhurried(frames, frames[:1].repeat(known, axis=0), LAYOUT, CALM) is frames


def test_of_a_body_in_haste_the_same_turn_is_left() -> None:
    pose = np.zeros((32, 3))
    pose[10:, 1] = 0.3
    frames = _features(pose)
    history = frames[:1].repeat(8, axis=0)
    assert unhurried(frames, history, LAYOUT, FASTEST) is frames
    assert not np.array_equal(unhurried(frames, history, LAYOUT, CALM), frames)
