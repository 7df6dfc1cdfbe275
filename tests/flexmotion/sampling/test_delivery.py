"""Forces and torques of a window are those of the motion that is delivered, also where windows meet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.inverse_dynamics import joint_torques
from flexmotion.biomechanics.segment_motion import SegmentMotion, segment_motion, segments_at_rest
from flexmotion.bundles.bundle import Bundle
from flexmotion.evaluation.ground import judge_ground
from flexmotion.evaluation.motions import jerk
from flexmotion.human.body import Body
from flexmotion.human.concatenate import concatenate
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.sampling.delivery import KNOWN, delivered
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.spatial.gravity import GRAVITY

FPS, FRAMES = 30.0, 32
WEIGHT = Body().mass * GRAVITY


def test_a_pose_that_is_held_does_not_tremble(bundle: Path) -> None:
    """Regression: hands of a held pose jerked by 15 m/s³. A hand that is asked for is not slowed down by the remedy."""
    sampler = Sampler(Bundle(bundle))
    history = sampler.standing()
    for seed in range(3):
        history = concatenate([history, sampler.sample(history, Condition("point up with your right hand"), seed)])
    held = Condition("point up with your right hand", held=True)
    usual, quiet = (sampler.sample(history, replace(held, held=own), 5) for own in (False, True))
    assert jerk(quiet).mean() < 0.6 * jerk(usual).mean()
    np.testing.assert_allclose(quiet.joints, usual.joints, atol=0.12)
    asked = replace(held, constraints=sampler.free.angles("elbow_flexion_r", slice(20, 32), np.full(12, 0.5)))
    one, other = (sampler.sample(history, replace(asked, held=own), 5).joints for own in (False, True))
    np.testing.assert_array_equal(one, other)


def swaying(amplitude: float, frequency: float, frames: int = KNOWN + FRAMES) -> Motion:
    """A human who stands and whose body sways forward and back above its ankles; a model says what the feet carry."""
    body = Body()
    size, time = body.segments, np.arange(frames) / FPS
    lean = amplitude * np.sin(2 * np.pi * frequency * time)
    joints = np.zeros((frames, len(JOINTS)))
    for side in SIDES:
        joints[:, JOINTS.index(f"ankle_dorsiflexion_{side}")] = lean
        joints[:, JOINTS.index(f"hip_flexion_{side}")] = lean
    place = np.zeros((frames, 3))
    place[:, 0] = size.leg * np.sin(lean)
    place[:, 2] = size.ankle_height + size.leg * np.cos(lean)
    wrenches, centres = np.zeros((frames, 2, 6)), np.zeros((frames, 2, 3))
    wrenches[:, 0, 2], wrenches[:, 1, 2] = 0.6 * WEIGHT, 0.4 * WEIGHT
    centres[:, :, 1] = [0.1, -0.1]
    return Motion(
        FPS,
        place,
        np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
        joints,
        body,
        wrenches=wrenches,
        pressure_centres=centres,
        contacts=np.ones((frames, 2), np.bool_),
        torques=np.zeros((frames, 32)),
        joint_contact=np.zeros((frames, 7, 3)),
    )


def made(motion: Motion) -> Motion:
    found = delivered(motion[KNOWN:], motion[:KNOWN], np.zeros((len(motion) - KNOWN, 3)))
    return concatenate([found.before, found.window])


def test_a_slow_sway_keeps_its_motion_and_the_models_shares() -> None:
    motion = swaying(0.03, 0.3)
    found = made(motion)
    moved = np.abs(found.root_position - motion.root_position[KNOWN - EDGE :])
    assert moved.max() < 2e-3
    assert found.wrenches is not None and found.torques is not None
    vertical = found.wrenches[..., 2]
    assert vertical[:, 0] / vertical.sum(axis=1) == pytest.approx(0.6, abs=0.02)
    assert np.abs(found.torques[EDGE:-EDGE, :3]).max() < 1e-3 * WEIGHT


def test_a_fast_sway_is_balanced_by_a_shift_of_the_root() -> None:
    """The zero-moment point of a sway by 8 cm at 1.2 Hz passes 30 cm beyond the toes."""
    motion = swaying(0.1, 1.2)
    before, after = judge_ground(motion).beyond[KNOWN:-EDGE], judge_ground(made(motion)).beyond[EDGE:-EDGE]
    assert (before > 0.1).mean() > 0.3
    assert (after > 0.01).mean() < 0.1


def test_a_joint_that_is_changed_last_is_in_the_forces() -> None:
    motion, column = swaying(0.1, 0.6), JOINTS.index("shoulder_flexion_r")

    def raised(window: Motion, segments: SegmentMotion) -> Motion:
        now = segments_at_rest(window)
        assert segments.position[:, 1:] == pytest.approx(now.position[:, 1:], abs=1e-9)
        assert segments.axis == pytest.approx(now.axis, abs=1e-9)
        joints = window.joints.copy()
        joints[:, column] += np.linspace(0.0, 1.0, len(window)) ** 2
        return replace(window, joints=joints)

    past = motion[:KNOWN]
    found = delivered(motion[KNOWN:], past, np.zeros((FRAMES, 3)), raised).window
    assert found.joints[-1, column] == pytest.approx(1.0)
    whole = segment_motion(concatenate([past.kinematics, found.kinematics]))
    frames = np.concatenate([np.zeros((KNOWN, 2, 6)), found.wrenches]), np.zeros((len(motion), 2, 3))
    frames[1][KNOWN:] = found.pressure_centres
    expected = joint_torques(found.body, whole, *frames)[KNOWN:]
    assert found.torques == pytest.approx(expected, abs=1e-6)


def test_frames_before_the_window_stay_where_they_are() -> None:
    motion = swaying(0.1, 1.2)
    found = delivered(motion[KNOWN:], motion[:KNOWN], np.zeros((FRAMES, 3)))
    np.testing.assert_array_equal(found.before.root_position, motion.root_position[KNOWN - EDGE : KNOWN])
    np.testing.assert_array_equal(found.before.joints, motion.joints[KNOWN - EDGE : KNOWN])
    whole = np.concatenate([motion.root_position[:KNOWN], found.window.root_position])
    # No jump of place or speed at the join.
    assert np.abs(np.diff(whole, n=2, axis=0))[KNOWN - 2 : KNOWN + 1].max() < 5e-3


def test_contact_of_the_legs_changes_by_the_ground_force() -> None:
    motion = swaying(0.0, 1.0)
    assert motion.wrenches is not None
    one_sided = replace(motion, wrenches=motion.wrenches * np.array([1.5, 0.5])[:, None])
    found = made(one_sided)
    assert found.joint_contact is not None and found.wrenches is not None
    change = found.wrenches[..., 2] - one_sided.wrenches[KNOWN - EDGE :, :, 2]  # type: ignore[index]
    # Legs are upright: their axes are the world's. The lumbar joint carries what is above it.
    assert found.joint_contact[:, :3, 2] == pytest.approx(-np.repeat(change[:, :1], 3, axis=1), abs=2.0)
    assert not found.joint_contact[:, -1].any()


@pytest.mark.parametrize("lacks", ["wrenches", "contacts"])
def test_windows_without_forces_are_returned_as_they_are(lacks: str) -> None:
    motion = swaying(0.1, 1.2)
    window = replace(motion[KNOWN:], **{lacks: None})  # type: ignore[arg-type]
    found = delivered(window, motion[:KNOWN], np.zeros((FRAMES, 3)))
    assert found.window is window


def test_a_history_without_forces_keeps_none() -> None:
    motion = swaying(0.03, 0.3)
    found = delivered(motion[KNOWN:], motion[:KNOWN].kinematics, np.zeros((FRAMES, 3)))
    assert found.before.wrenches is None and found.window.wrenches is not None


def test_one_frame_of_history_is_enough() -> None:
    motion = swaying(0.03, 0.3)
    found = delivered(motion[1:], motion[:1], np.zeros((len(motion) - 1, 3)))
    assert len(found.before) == 1 and len(found.window) == len(motion) - 1


@pytest.mark.parametrize("prompt", ["walk forward", "wave with the right hand", "bow"])
def test_forces_of_joined_windows_fit_their_motion(bundle: Path, prompt: str) -> None:
    """Regression: planting left a residual of 25 to 45 % of body weight, the zero-moment point decimetres outside."""
    sampler = Sampler(Bundle(bundle))
    motion = sampler.standing()
    for window in range(4):
        found = sampler.extend(motion, Condition(prompt), seed=window)
        motion = concatenate([motion[: len(motion) - len(found.before)], found.before, found.window])
    figures = judge_ground(motion).figures
    assert figures["residual_force"] < 2.0
    assert figures["residual_moment"] < 2.0
    assert figures["zmp_outside"] < 20.0
    assert figures["ground_impossible"] < 3.0
