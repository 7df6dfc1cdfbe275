from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.contacts import ContactDetector
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.retarget.human import HumanWindow


def test_swings_are_those_of_the_walk(window: Callable[[Motion], HumanWindow], walk: Motion) -> None:
    swings = window(walk).swings
    assert [swing.side for swing in swings] == [1, 0] * 4
    for swing, lift_s in zip(swings, 1.06 + 0.5 * np.arange(8), strict=True):
        assert swing.landed
        # The detector is causal: it detects lift-off and touch-down some frames late.
        assert lift_s - 0.02 <= swing.lift_s <= lift_s + 0.2
        assert lift_s + 0.3 <= swing.land_s <= lift_s + 0.55


def test_a_swing_without_a_landing_ends_with_the_window(window: Callable[[Motion], HumanWindow], walk: Motion) -> None:
    seen = window(walk[:40])
    assert not seen.swings[-1].landed
    assert seen.swings[-1].land_s == seen.end_s


def test_windows_in_sequence_equal_one_window(window: Callable[[Motion], HumanWindow], walk: Motion) -> None:
    whole = window(walk)
    cut = 47
    tail = HumanWindow(walk[cut:], cut / walk.fps, whole.detector_states[cut - 1], whole.yaws[cut - 1])
    np.testing.assert_array_equal(tail.contacts, whole.contacts[cut:])
    np.testing.assert_allclose(tail.yaws, whole.yaws[cut:], atol=1e-12)
    np.testing.assert_allclose(tail.times, whole.times[cut:])


@pytest.mark.parametrize("frames", [1, 2, 40])
def test_one_time_is_read_like_many(window: Callable[[Motion], HumanWindow], walk: Motion, frames: int) -> None:
    seen = window(walk[:frames])
    times = np.linspace(-0.2, seen.end_s + 0.2, 57)
    many = seen.at(seen.feet, times)
    one = np.array([seen.at_one(seen.feet, float(second)) for second in times])
    np.testing.assert_allclose(one, many, atol=1e-12)


def test_frames_between_two_times_hold_those_at_them(window: Callable[[Motion], HumanWindow], walk: Motion) -> None:
    seen = window(walk[:40])
    start, end = seen.times[3], seen.times[7]
    assert seen.frames_between(start, end) == slice(3, 8)
    assert seen.frames_between(start + 0.01, end - 0.01) == slice(4, 7)
    assert len(seen.times[seen.frames_between(50.0, 51.0)]) == 0


def test_yaw_is_continuous_over_windows(stand: Callable[..., Motion]) -> None:
    """Three turns on the spot in ten windows: the yaw increases beyond pi."""
    still = stand(300)
    angle = np.linspace(0.0, 6 * np.pi, 300)
    turned = Motion(
        fps=still.fps,
        root_position=still.root_position,
        root_quaternion=Rotation.from_euler("z", angle[:, None]).as_quat(scalar_first=True),
        joints=still.joints,
        body=still.body,
    )
    state, yaws = ContactDetector().initial(), None
    for start in range(0, 300, 30):
        seen = HumanWindow(turned[start : start + 30], start / 30, state, yaws)
        state, yaws = seen.detector_states[-1], seen.yaws[-1]
    assert yaws is not None
    np.testing.assert_allclose(yaws[2], angle[-1], atol=1e-9)
    assert np.ptp(yaws) < 0.6  # toes point a little outward


def test_interpolation_is_constant_beyond_the_ends(window: Callable[[Motion], HumanWindow], walk: Motion) -> None:
    seen = window(walk)
    values = np.arange(len(walk), dtype=float)[:, None]
    found = seen.at(values, np.array([-1.0, 0.0, 0.5 / 30, 1.0, 99.0]))[:, 0]
    np.testing.assert_allclose(found, [0.0, 0.0, 0.5, 30.0, len(walk) - 1])
    assert seen.frame_before(np.array([-1.0, 0.0, 0.05, 99.0])).tolist() == [0, 0, 1, len(walk) - 1]


def test_a_window_may_have_one_frame(window: Callable[[Motion], HumanWindow], walk: Motion) -> None:
    seen = window(walk[:1])
    assert seen.swings == []
    assert seen.foot(0, 5.0) == pytest.approx(seen.feet[0, 0])


def test_tilt_is_right_and_forward_positive(
    window: Callable[[Motion], HumanWindow], stand: Callable[..., Motion]
) -> None:
    bow = window(stand(2, lumbar_extension=-0.4)).tilt[0]
    assert bow[1] == pytest.approx(0.4, abs=0.02) and abs(bow[0]) < 0.02
    side = window(stand(2, lumbar_bending=0.2)).tilt[0]
    assert abs(side[0]) == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize("turned", [0.0, 2.9, -2.0])
def test_a_lean_to_the_right_is_a_positive_roll(
    window: Callable[[Motion], HumanWindow], stand: Callable[..., Motion], turned: float
) -> None:
    root = Rotation.from_euler("ZYX", [[turned, 0.0, 0.2]] * 2).as_quat(scalar_first=True)
    seen = window(replace(stand(2), root_quaternion=root))
    assert seen.tilt[0, 0] == pytest.approx(0.2, abs=0.02)
    assert seen.yaws[0, 2] == pytest.approx(turned, abs=0.02)


@pytest.mark.parametrize("turned", [0.0, 2.9, -2.0])
def test_a_bow_past_the_horizontal_does_not_flip_the_heading(
    window: Callable[[Motion], HumanWindow], stand: Callable[..., Motion], turned: float
) -> None:
    """Euler angles flipped at 90 degrees: the robot's torso swung to one side in mid-step, and it fell."""
    bends = np.radians(np.arange(0.0, 140.0, 2.0))
    still = stand(len(bends))
    pelvis = Rotation.from_euler("ZYX", np.column_stack([np.full_like(bends, turned), 0.6 * bends, 0.02 + 0 * bends]))
    joints = still.joints.copy()
    joints[:, JOINTS.index("lumbar_extension")] = -0.4 * bends
    seen = window(replace(still, root_quaternion=pelvis.as_quat(scalar_first=True), joints=joints))
    np.testing.assert_allclose(seen.tilt[:, 1], bends, atol=0.03)
    assert np.abs(seen.tilt[:, 0]).max() < 0.04
    assert np.abs(seen.yaws[:, 2] - seen.yaws[0, 2]).max() < 0.06


def test_foot_height_is_relative_to_its_first_height(window: Callable[[Motion], HumanWindow], walk: Motion) -> None:
    seen = window(walk)
    assert seen.foot_height(1, 1.0, 1.5) == pytest.approx(0.09, abs=0.02)
    assert seen.foot_height(0, 0.0, 0.9) < 0.005
    assert seen.foot_height(0, 50.0, 51.0) == 0.0


def test_ground_forces_of_a_motion_decide_about_contacts(
    window: Callable[[Motion], HumanWindow], stand: Callable[..., Motion]
) -> None:
    """Neither foot moves, but the right foot has no force for half a second."""
    motion = stand(120)
    weight = motion.body.mass * 9.81
    wrenches = np.zeros((len(motion), 2, 6))
    wrenches[:, 0, 2] = wrenches[:, 1, 2] = 0.5 * weight
    wrenches[60:75, 1, 2] = 0.0
    wrenches[60:75, 0, 2] = weight
    swings = window(replace(motion, wrenches=wrenches)).swings
    assert [swing.side for swing in swings] == [1]
    assert swings[0].land_s - swings[0].lift_s == pytest.approx(15 / motion.fps)


@pytest.mark.parametrize("share", [0.0, 0.1, 20.0])
def test_implausible_forces_do_not_change_contacts(
    window: Callable[[Motion], HumanWindow], walk: Motion, share: float
) -> None:
    """Forces of zero left both feet without contact for the whole motion."""
    wrenches = np.zeros((len(walk), 2, 6))
    wrenches[:, :, 2] = share * walk.body.mass * 9.81
    np.testing.assert_array_equal(window(replace(walk, wrenches=wrenches)).contacts, window(walk).contacts)
