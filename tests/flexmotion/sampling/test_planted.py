"""Loaded feet stay in place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.importers.default_clip import default_clip
from flexmotion.sampling.kept_feet import LIFTED
from flexmotion.sampling.planted import planted, planted_slip
from flexmotion.spatial.heading import continuous_matrix_heading

FRAMES = 32


def feet(motion: Motion) -> np.ndarray:
    human = forward(motion)
    return np.stack([human.heel, human.toe], axis=2)


@pytest.fixture
def standing() -> Motion:
    """A human who stands with both feet on the floor, 1 + 32 frames."""
    clip = default_clip()[:1]
    height = feet(clip)[..., 2].min()
    root = np.repeat(clip.root_position, 1 + FRAMES, axis=0) - [0.0, 0.0, height]
    return Motion(
        fps=30.0,
        body=clip.body,
        root_position=root,
        root_quaternion=np.repeat(clip.root_quaternion, 1 + FRAMES, axis=0),
        joints=np.repeat(clip.joints, 1 + FRAMES, axis=0),
        contacts=np.ones((1 + FRAMES, 2), np.bool_),
    )


def moved(motion: Motion, offset: np.ndarray) -> Motion:
    return replace(motion, root_position=motion.root_position + offset)


def test_a_standing_human_does_not_drift(standing: Motion) -> None:
    # Regression: a bias of 4 cm/s moved a standing robot across the room.
    drift = np.arange(FRAMES)[:, None] / 30.0 * [0.04, -0.02, 0.0]
    found = planted(moved(standing[1:], drift), standing[:1])
    assert np.linalg.norm(found.root_position[-1, :2] - standing.root_position[0, :2]) < 0.004


@pytest.mark.parametrize("height", [-0.03, 0.04])
def test_feet_are_lowered_to_the_floor_evenly(standing: Motion, height: float) -> None:
    found = planted(moved(standing[1:], np.array([0.0, 0.0, height])), standing[:1])
    low = feet(found)[..., 2].min(axis=(1, 2))
    assert -0.003 < low[-1] < 0.018
    assert np.abs(np.diff(low)).max() < 0.3 * abs(height)


def test_an_unloaded_foot_is_free(standing: Motion) -> None:
    flight = replace(
        moved(standing[1:], np.arange(FRAMES)[:, None] / 30.0 * [1.0, 0.0, 0.1]),
        contacts=np.zeros((FRAMES, 2), np.bool_),
    )
    found = planted(flight, standing[:1])
    np.testing.assert_allclose(found.root_position, flight.root_position, atol=1e-12)
    unknown = replace(flight, contacts=None)
    assert planted(unknown, standing[:1]) is unknown


def test_a_fast_foot_flagged_as_loaded_does_not_hold_a_runner(standing: Motion) -> None:
    run = moved(standing[1:], np.arange(FRAMES)[:, None] / 30.0 * [3.0, 0.0, 0.0])
    found = planted(run, standing[:1])
    np.testing.assert_allclose(found.root_position[:, :2], run.root_position[:, :2], atol=1e-9)


def test_forward_gliding_on_loaded_feet_is_removed(standing: Motion) -> None:
    """Regression: walking backward, a model slid at 1.3 m/s on loaded feet; a robot could not follow."""
    yaw = continuous_matrix_heading(forward(standing).pelvis_rotation)[0]
    glide = np.arange(FRAMES)[:, None] / 30.0 * [-1.3 * np.cos(yaw), -1.3 * np.sin(yaw), 0.0]
    found = planted(moved(standing[1:], glide), standing[:1])
    assert np.linalg.norm(found.root_position[-1, :2] - standing.root_position[0, :2]) < 0.06


def test_sideways_gliding_is_kept(standing: Motion) -> None:
    """Models move sideways by gliding: with held feet a request of .35 m/s gave .13 m/s."""
    yaw = continuous_matrix_heading(forward(standing).pelvis_rotation)[0]
    glide = np.arange(FRAMES)[:, None] / 30.0 * [-0.8 * np.sin(yaw), 0.8 * np.cos(yaw), 0.0]
    wanted = moved(standing[1:], glide)
    found = planted(wanted, standing[:1])
    np.testing.assert_allclose(found.root_position[:, :2], wanted.root_position[:, :2], atol=0.01)


def test_a_swinging_foot_flagged_as_loaded_does_not_hold_the_body(standing: Motion) -> None:
    """Regression: with this foot alone flagged as loaded for two frames in mid-swing, the body stopped over it."""
    hips = [JOINTS.index("hip_flexion_l"), JOINTS.index("hip_flexion_r")]
    joints = standing.joints.copy()
    joints[:, hips[0]] += np.linspace(0.0, 1.0, 1 + FRAMES)  # the left leg swings forward at about .9 m/s
    contacts = np.tile([False, True], (1 + FRAMES, 1))
    contacts[15:17] = [True, False]
    swing = replace(standing, joints=joints, contacts=contacts)
    found = planted(swing[1:], swing[:1])
    assert np.abs(np.diff(found.root_position[:, :2], axis=0)).max() < 0.3 / 30.0


def test_only_angles_of_the_legs_change(standing: Motion) -> None:
    rng = np.random.default_rng(0)
    other = replace(standing[1:], joints=standing.joints[1:] + 0.02 * rng.standard_normal(standing.joints[1:].shape))
    found = planted(other, standing[:1])
    assert np.array_equal(found.root_quaternion, other.root_quaternion)
    bend = [at for at, name in enumerate(JOINTS) if name[:-2] in ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")]
    np.testing.assert_array_equal(np.delete(found.joints, bend, axis=1), np.delete(other.joints, bend, axis=1))
    slide = np.linalg.norm(np.diff(feet(found)[..., :2], axis=0), axis=-1).min(axis=-1).mean()
    before = np.linalg.norm(np.diff(feet(other)[..., :2], axis=0), axis=-1).min(axis=-1).mean()
    assert slide < before


def test_consecutive_windows_do_not_oscillate_in_height(standing: Motion) -> None:
    # Regression: with a model 2 cm too high each window rose by a quarter of that before it was lowered again.
    low = feet(standing)[..., 2].min()
    time = np.arange(1, FRAMES + 1)[:, None] / 30.0
    rate = 2.0 * np.log(2.0) / 0.15
    back = 0.02 * (1.0 - (1.0 + rate * time) * np.exp(-rate * time)) * [0.0, 0.0, 1.0]
    found = planted(moved(standing[1:], back), standing[:1])
    height = feet(found)[..., 2].min(axis=(1, 2)) - low
    assert 0.0 <= height.max() < 0.018


def test_the_height_correction_is_kept_in_flight(standing: Motion) -> None:
    contacts = np.ones((FRAMES, 2), np.bool_)
    contacts[16:] = False
    high = replace(moved(standing[1:], np.array([0.0, 0.0, 0.04])), contacts=contacts)
    found = planted(high, standing[:1])
    assert np.ptp(found.root_position[16:, 2]) < 0.001


def test_two_loaded_feet_of_different_height_both_reach_the_floor(standing: Motion) -> None:
    """Regression: the body cannot be lowered for one foot only, and the other stayed 4 cm up, loaded."""
    joints = standing.joints[1:].copy()
    for name, angle in (("hip_flexion_l", 0.28), ("knee_flexion_l", 0.56), ("ankle_dorsiflexion_l", 0.28)):
        joints[8:24, JOINTS.index(name)] += angle
    lifted = replace(standing[1:], joints=joints)
    assert feet(lifted)[8:24, 0, :, 2].min() > 0.04
    found = planted(lifted, standing[:1])
    # Not within one frame: the body takes a few tenths of a second, the legs start two frames before.
    assert feet(found)[12:20, :, :, 2].min(axis=-1).max() < 0.025


def test_corrections_by_the_legs_are_smooth(standing: Motion) -> None:
    """Regression: knees bent slightly backward flipped forward, straight ones turned by 50° per frame."""
    joints = standing.joints[1:].copy()
    time = np.arange(FRAMES) / 30.0
    for side, phase in (("l", 0.0), ("r", 1.0)):
        joints[:, JOINTS.index(f"knee_flexion_{side}")] = 0.05 * np.sin(8.0 * time + phase)
        joints[:, JOINTS.index(f"hip_flexion_{side}")] = 0.3 * np.sin(4.0 * time + phase)
    swaying = moved(replace(standing[1:], joints=joints), 0.01 * np.sin(50.0 * time)[:, None] * [0.0, 0.0, 1.0])
    knees = [JOINTS.index(f"knee_flexion_{side}") for side in "lr"]
    found = planted(swaying, standing[:1]).joints[:, knees]
    assert found.min() >= 0.0
    assert np.degrees(np.abs(np.diff(found, axis=0)).max()) < 12.0


def test_no_foot_penetrates_the_floor(standing: Motion) -> None:
    sunk = moved(standing[1:], np.array([0.0, 0.0, -0.04]))
    for loaded in (True, False):
        found = planted(replace(sunk, contacts=np.full((FRAMES, 2), loaded)), standing[:1])
        assert feet(found)[6:, ..., 2].min() > -0.012


def test_a_loaded_foot_that_hovers_comes_down_where_the_body_stays(standing: Motion) -> None:
    """A bow left a foot that carried load 5 cm above the floor, and the robot took its way down for a step."""
    knees = standing.joints.copy()
    knees[1:, JOINTS.index("knee_flexion_r")] += 0.9
    knees[1:, JOINTS.index("hip_flexion_r")] += 0.45
    hovers = replace(standing, joints=knees)
    before = feet(standing[:1])
    height = feet(hovers[1:])[:, 1, :, 2].min()
    assert 0.06 < height < LIFTED
    stays, _ = planted_slip(hovers[1:], before, standing.joints[0])
    travels, _ = planted_slip(hovers[1:], before)
    low = [feet(one)[16:, 1, :, 2].min(axis=1).max() for one in (stays, travels)]
    assert low[0] < 0.022 < low[1]
