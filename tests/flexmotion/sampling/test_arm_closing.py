"""Elbows and hands are brought to their places by the arms alone."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor
from flexmotion.features.layout import Layout
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.arm_closing import MOVED, closable, closed

FRAMES = 32
RIGHT = [JOINTS.index(f"{joint}_r") for joint in MOVED]


@pytest.fixture
def window(clip: Motion) -> tuple[Motion, Anchor, Constraints]:
    """A walking window, the frame before it, and nothing asked of it."""
    motion = resample(clip, 30.0)[60 : 61 + FRAMES].kinematics
    return motion[1:], Anchor.after(motion[:1]), Constraints.none(Layout(30.0), motion.body, FRAMES)


def hands(motion: Motion, anchor: Anchor) -> np.ndarray:
    return anchor.local(forward(motion).hand[:, 1])


def test_a_hand_keeps_its_places_over_a_window(window: tuple[Motion, Anchor, Constraints]) -> None:
    motion, anchor, nothing = window
    places = hands(motion, anchor) + 0.08 * np.sin(np.linspace(0, np.pi, FRAMES))[:, None] * [1.0, 0.5, 1.0]
    found = closed(motion, anchor, nothing.place("hand_r", slice(None), places))
    assert np.linalg.norm(hands(found, anchor) - places, axis=1).max() < 0.005
    others = [number for number in range(len(JOINTS)) if number not in RIGHT]
    np.testing.assert_array_equal(found.joints[:, others], motion.joints[:, others])
    np.testing.assert_array_equal(found.root_position, motion.root_position)


def test_a_keyframe_is_reached_smoothly(window: tuple[Motion, Anchor, Constraints]) -> None:
    motion, anchor, nothing = window
    place = hands(motion, anchor)[20] + [0.05, 0.05, 0.1]
    found = closed(motion, anchor, nothing.place("hand_r", 20, place))
    assert np.linalg.norm(hands(found, anchor)[20] - place) < 0.005
    change = found.joints - motion.joints
    assert np.abs(change[0]).max() < 0.02  # pose and speed of the history are kept
    assert np.abs(np.diff(change, n=2, axis=0)).max() < 0.15 * np.abs(change).max()


def test_a_place_out_of_reach_stretches_the_arm_within_its_limits(window: tuple[Motion, Anchor, Constraints]) -> None:
    motion, anchor, nothing = window
    place = hands(motion, anchor)[25] + [3.0, 0.0, 0.0]
    found = closed(motion, anchor, nothing.place("hand_r", slice(15, None), place))
    low, high = joint_limits()[RIGHT].T
    assert (found.joints[:, RIGHT] >= np.minimum(low, motion.joints[:, RIGHT]) - 1e-9).all()
    assert (found.joints[:, RIGHT] <= np.maximum(high, motion.joints[:, RIGHT]) + 1e-9).all()
    assert hands(found, anchor)[25, 0] > hands(motion, anchor)[25, 0] + 0.1


def test_what_is_not_asked_of_arms_is_left_alone(window: tuple[Motion, Anchor, Constraints]) -> None:
    motion, anchor, nothing = window
    asked = nothing.place("toe_l", 3, np.zeros(3)).path(5, np.zeros(2))
    assert closed(motion, anchor, asked) is motion
    assert closable(asked).sum() == 3 * 4  # elbows and hands
