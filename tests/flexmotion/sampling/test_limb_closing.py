"""Elbows, hands and feet are brought to their places by the limbs alone."""

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
from flexmotion.sampling.limb_closing import ARM, LEG, closable, closed, staying

FRAMES = 32
RIGHT = ARM.of_joints("r")


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


def test_a_foot_is_brought_to_its_places_by_its_leg_and_keeps_its_direction(
    window: tuple[Motion, Anchor, Constraints],
) -> None:
    # A foot that was asked to swing further than the model had it was 5 cm off: its leg did not reach for it.
    motion, anchor, nothing = window
    human = forward(motion)
    places = anchor.local(human.heel[:, 0]) + [0.0, 0.06, 0.04] * np.linspace(0.0, 1.0, FRAMES)[:, None]
    found = closed(motion, anchor, nothing.place("heel_l", slice(None), places))
    moved = forward(found)
    assert np.linalg.norm(anchor.local(moved.heel[:, 0]) - places, axis=1).max() < 0.01
    before, after = ((one.toe - one.heel)[:, 0] for one in (human, moved))
    assert np.linalg.norm(after - before, axis=1).max() < 0.03
    others = [number for number in range(len(JOINTS)) if number not in LEG.of_joints("l")]
    np.testing.assert_array_equal(found.joints[:, others], motion.joints[:, others])


def test_a_foot_that_is_far_from_its_place_is_left_to_the_walk(window: tuple[Motion, Anchor, Constraints]) -> None:
    # A leg that was stretched after its place for as long as the body walked on left the body without ground.
    motion, anchor, nothing = window
    human = forward(motion)
    places = anchor.local(human.ankle[:, 1]) + [0.0, -2.0, 0.0]
    found = closed(motion, anchor, nothing.place("ankle_r", slice(10, None), places[10:]))
    np.testing.assert_allclose(found.joints, motion.joints, atol=1e-6)
    near = anchor.local(human.ankle[:, 1]) + [0.0, -0.35, 0.0]
    found = closed(motion, anchor, nothing.place("ankle_r", slice(10, None), near[10:]))
    assert anchor.local(forward(found).ankle[:, 1])[-1, 1] < anchor.local(human.ankle[:, 1])[-1, 1] - 0.15
    low, high = joint_limits()[LEG.of_joints("r")].T
    assert (found.joints[:, LEG.of_joints("r")] >= np.minimum(low, motion.joints[:, LEG.of_joints("r")]) - 1e-9).all()
    assert (found.joints[:, LEG.of_joints("r")] <= np.maximum(high, motion.joints[:, LEG.of_joints("r")]) + 1e-9).all()


@pytest.mark.parametrize("far", [0.02, 3.0], ids=["near", "out of reach"])
def test_limbs_that_are_solved_at_once_end_as_each_alone(
    window: tuple[Motion, Anchor, Constraints], far: float
) -> None:
    """One is near its places, the other goes farther, so that they are done after different numbers of steps."""
    motion, anchor, nothing = window
    human, side = forward(motion), {"l": 0, "r": 1}
    left = {"hand_l": human.hand[:, side["l"]] + [1e-4, 0.0, 0.0], "heel_l": human.heel[:, side["l"]]}
    right = {"hand_r": human.hand[:, side["r"]] + [far, 0.0, 0.0], "toe_r": human.toe[:, side["r"]] + [0.0, far, 0.0]}

    def asked(points: dict[str, np.ndarray]) -> Constraints:
        found = nothing
        for point, places in points.items():
            found = found.place(point, slice(4, None), anchor.local(places[4:]))
        return found

    both = closed(motion, anchor, asked(left | right))
    alone = closed(closed(motion, anchor, asked(left)), anchor, asked(right))
    np.testing.assert_allclose(both.joints, alone.joints, atol=1e-9)
    assert np.abs(both.joints - motion.joints).max() > 0.01


def test_what_is_not_asked_of_limbs_is_left_alone(window: tuple[Motion, Anchor, Constraints]) -> None:
    motion, anchor, nothing = window
    asked = nothing.place("knee_l", 3, np.zeros(3)).path(5, np.zeros(2))
    assert closed(motion, anchor, asked) is motion
    assert closable(asked, (ARM,)).sum() == 3 * 4  # elbows and hands
    assert closable(asked).sum() == 3 * 10  # and ankles, heels, toes
    assert staying(motion, anchor, asked) is None


def test_a_foot_stays_where_it_is_asked_to_be_and_not_where_its_leg_cannot_reach(
    window: tuple[Motion, Anchor, Constraints],
) -> None:
    # A foot was taken to stay at a place that was out of its leg's reach: the body was balanced over nothing.
    motion, anchor, nothing = window
    toe = anchor.local(forward(motion).toe[:, 1])
    asked = nothing.place("toe_r", slice(4, 8), toe[4:8] + [0.0, 0.01, 0.0])
    kept = staying(motion, anchor, asked)
    assert kept is not None and kept[4:8, 1].all() and kept.sum() == 4
    far = staying(motion, anchor, nothing.place("toe_r", slice(4, 8), toe[4:8] + [0.0, 0.5, 0.0]))
    assert far is not None and not far.any()
    assert staying(motion, anchor, nothing.place("toe_r", slice(4, 8), toe[4:8] * [np.nan, 1.0, np.nan])) is None


def test_no_foot_is_brought_below_the_floor(window: tuple[Motion, Anchor, Constraints]) -> None:
    motion, anchor, nothing = window
    heel = anchor.local(forward(motion).heel[:, 0])
    found = closed(motion, anchor, nothing.place("heel_l", slice(None), heel - [0.0, 0.0, 0.3]))
    assert forward(found).heel[:, 0, 2].min() > min(0.0, heel[:, 2].min()) - 0.01
