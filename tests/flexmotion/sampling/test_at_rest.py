"""The rest pose of what a standing human is not asked to move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.importers.default_clip import default_clip
from flexmotion.sampling.at_rest import NEAR, RESTING_S, UPPER, at_rest, resting
from flexmotion.sampling.idle_joints import idle_joints
from flexmotion.text.phrases import STAND

ELBOW, KNEE, NECK = (JOINTS.index(name) for name in ("elbow_flexion_r", "knee_flexion_r", "neck_rotation"))


def trembling(motion: Motion, joint: int, size: float = 0.05) -> Motion:
    joints = motion.joints.copy()
    joints[:, joint] += size * np.sin(np.arange(len(motion)))
    return replace(motion, joints=joints)


def test_the_upper_body_moves_smoothly_to_rest_and_the_legs_are_unchanged() -> None:
    motion = default_clip()[60:180]
    rest = np.full(len(JOINTS), 0.1)
    found = at_rest(motion[4:], motion[:4], rest)
    upper, legs = sorted(UPPER), [joint for joint in range(len(JOINTS)) if joint not in UPPER]
    np.testing.assert_array_equal(found.joints[:, legs], motion.joints[4:, legs])
    far = np.abs(motion.joints[4, upper] - rest[upper]).max()
    assert np.abs(found.joints[0, upper] - motion.joints[4, upper]).max() < 0.02 * far
    after = round(8 * RESTING_S * motion.fps)
    left, was = (np.abs(one.joints[after:, upper] - rest[upper]).max() for one in (found, motion))
    assert left < 0.03 * was


def test_hanging_arms_rest_whatever_the_model_does(make_standing: Callable[..., Motion]) -> None:
    """Led to rest from what was sampled, window by window, hands of a stand jerked by 5 m/s³."""
    past, window = make_standing(6), trembling(make_standing(40), ELBOW)
    found = at_rest(window, past, past.joints[-1])
    assert np.ptp(found.joints[:, ELBOW]) < 1e-12 < np.ptp(window.joints[:, ELBOW])


@pytest.mark.parametrize("stays", [True, False])
def test_arms_that_hang_in_their_own_way_stay_so_in_a_gesture_and_come_to_rest_in_a_stand(
    stays: bool, make_standing: Callable[..., Motion]
) -> None:
    past = make_standing(6, elbow_flexion_r=0.8 * NEAR)
    found = at_rest(make_standing(60), past, make_standing(1).joints[0], stays=stays)
    assert found.joints[-1, ELBOW] == pytest.approx(0.8 * NEAR if stays else 0.0, abs=1e-2)


def test_a_raised_arm_that_is_idle_comes_down_in_a_gesture_too(make_standing: Callable[..., Motion]) -> None:
    past = make_standing(6, elbow_flexion_r=2.0)
    found = at_rest(make_standing(90, elbow_flexion_r=2.0), past, make_standing(1).joints[0], stays=True)
    assert found.joints[-1, ELBOW] < 0.2


def test_what_is_not_idle_moves_as_sampled(make_standing: Callable[..., Motion]) -> None:
    past, window = make_standing(6), trembling(make_standing(40), ELBOW)
    assert np.array_equal(at_rest(window, past, past.joints[-1], UPPER - {ELBOW}).joints, window.joints)


def test_parts_that_are_far_from_rest_are_taken_to_be_in_it(make_standing: Callable[..., Motion]) -> None:
    """A look to the right that followed one to the left turned by both."""
    rest, joints = make_standing(1).joints[0], make_standing(1, neck_rotation=0.9, elbow_flexion_r=0.2).joints[0]
    found = resting(joints, rest)
    assert found[NECK] == rest[NECK] and found[ELBOW] == joints[ELBOW]


def test_idle_is_what_a_kind_does_not_move() -> None:
    assert idle_joints(STAND) == UPPER and not idle_joints("bow") and not idle_joints("squat")
    salute = idle_joints("salute-left-hand")
    assert ELBOW in salute and NECK in salute and JOINTS.index("elbow_flexion_l") not in salute
    wave = idle_joints("wave-right-hand")
    assert ELBOW not in wave and JOINTS.index("elbow_flexion_l") in wave
    assert NECK not in wave, "who is recorded waving moves the head along"
    assert all(KNEE not in idle_joints(kind) for kind in (STAND, "wave-right-hand", "salute-left-hand"))
