"""Stiffness in plans: by the human's tension, never beyond the robot file's, all of it where no human is followed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.biomechanics.inverse_dynamics import joint_torques
from flexmotion.biomechanics.segment_motion import segment_motion
from flexmotion.biomechanics.tension import LIMBS
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS
from flexmotion.retarget.part_paths import PartGoal, PartGoals
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.restrictions import Restrictions
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.stiffness import LimbStiffness

LEAST = 0.25


def yielding(least: float) -> Robot:
    """OP3 with another least stiffness."""
    robot = load_robot("op3")
    robot.config = robot.config.model_copy(update={"least_stiffness": least})
    return robot


ROBOT = yielding(LEAST)
LIMB_JOINTS = [list(ROBOT.chain(limb).values()) for limb in LIMBS]
LEFT, RIGHT, HEAD = LIMB_JOINTS
UPPER = sorted(joint for joints in LIMB_JOINTS for joint in joints)
LEGS = np.setdiff1d(np.arange(ROBOT.n), UPPER)


@pytest.fixture(scope="module")
def soft(stream: StreamSettings) -> Retargeter:
    return Retargeter(ROBOT, stream)


@pytest.fixture(scope="module")
def slack(stand: Callable[..., Motion]) -> Motion:
    """A human who stands and lets the arms hang, with torques."""
    motion = stand(90)
    ground = np.zeros((90, 2, 6))
    return replace(motion, torques=joint_torques(motion.body, segment_motion(motion), ground, ground[..., :3]))


def pulling(motion: Motion, *joints: str) -> Motion:
    """The same with 100 N·m more at joints."""
    assert motion.torques is not None
    torques = motion.torques.copy()
    torques[:, [DOF_COUNT - len(JOINTS) + JOINTS.index(joint) for joint in joints]] += 100.0
    return replace(motion, torques=torques)


def settled(retargeter: Retargeter, motion: Motion) -> Plan:
    """A plan that begins a second after the first one, when the stiffness has come to what the human asks."""
    first = retargeter.plan(retargeter.standing(), motion[:34], 0, 0)
    at = retargeter.rate
    state = first.states[int(at)]
    frame = retargeter.next_frame(state, int(at), motion.fps)
    return retargeter.plan(state, motion[frame : frame + 34], frame, int(at))


def test_limbs_that_are_not_tense_follow_with_the_least_stiffness(soft: Retargeter, slack: Motion) -> None:
    plan = settled(soft, slack)
    np.testing.assert_allclose(plan.stiffness[:60, UPPER], LEAST, atol=0.01)


def test_a_tense_arm_is_stiff_by_itself(soft: Retargeter, slack: Motion) -> None:
    plan = settled(soft, pulling(slack, "elbow_flexion_r"))
    np.testing.assert_allclose(plan.stiffness[:60, RIGHT], 1.0, atol=0.01)
    np.testing.assert_allclose(plan.stiffness[:60, [*LEFT, *HEAD]], LEAST, atol=0.01)


def test_legs_are_always_stiff(soft: Retargeter, slack: Motion) -> None:
    for motion in (slack, pulling(slack, "hip_flexion_l", "knee_flexion_r")):
        np.testing.assert_array_equal(settled(soft, motion).stiffness[:, LEGS], 1.0)


def test_every_plan_ends_with_all_of_the_stiffness(soft: Retargeter, slack: Motion) -> None:
    plan = settled(soft, slack)
    tail = plan.stiffness[plan.stop_row :, UPPER]
    assert (np.diff(tail, axis=0) >= -1e-12).all()
    np.testing.assert_allclose(tail[-1], 1.0, atol=0.01)


def test_a_human_without_torques_is_followed_with_all_of_the_stiffness(soft: Retargeter, slack: Motion) -> None:
    np.testing.assert_allclose(settled(soft, slack.kinematics).stiffness, 1.0)


def test_an_arm_on_the_way_to_a_target_of_its_own_is_stiff(soft: Retargeter, slack: Motion) -> None:
    channels = np.array([4, 5, 6])  # after the four of the trunk: the left arm
    goals = PartGoals([PartGoal(1, channels, ROBOT.stand_pose[LEFT] + 0.2, due=100.0, until=2000.0)])
    state, at = soft.plan(soft.standing(), slack[:34], 0, 0).states[120], 120
    frame = soft.next_frame(state, at, slack.fps)
    plan = soft.plan(state, slack[frame : frame + 34], frame, at, parts=goals)
    assert (plan.stiffness[60:120, LEFT] > 0.9).all()
    np.testing.assert_allclose(plan.stiffness[60 : plan.stop_row, RIGHT], LEAST, atol=0.02)


def test_a_tension_that_is_asked_for_replaces_the_humans_in_a_stop_too(soft: Retargeter, slack: Motion) -> None:
    asked = Restrictions(tension={0: 1.0, 1: 0.5})
    state, at = soft.plan(soft.standing(), pulling(slack, "elbow_flexion_r")[:34], 0, 0).states[120], 120
    frame = soft.next_frame(state, at, slack.fps)
    plan = soft.plan(state, slack[frame : frame + 34], frame, at, restrictions=asked)
    half = LEAST + 0.5 * (1.0 - LEAST)
    np.testing.assert_allclose(plan.stiffness[-1, LEFT], 1.0, atol=0.01)
    np.testing.assert_allclose(plan.stiffness[[plan.stop_row - 1, -1]][:, RIGHT], half, atol=0.01)
    assert (np.abs(np.diff(plan.stiffness, axis=0)) < 0.06).all(), "no step"
    np.testing.assert_allclose(plan.stiffness[plan.stop_row - 1, HEAD], LEAST, atol=0.02)
    np.testing.assert_array_equal(soft.layout.view(plan.states[-1]).asked_tension, [1.0, 0.5, np.nan])


def test_the_next_plan_goes_on_where_the_last_one_was(soft: Retargeter, slack: Motion) -> None:
    motion = pulling(slack, "shoulder_flexion_l")
    plan = soft.plan(soft.standing(), motion[:34], 0, 0)
    frame = soft.next_frame(plan.states[40], 40, motion.fps)
    following = soft.plan(plan.states[40], motion[frame : frame + 34], frame, 40)
    np.testing.assert_allclose(following.stiffness[:40], plan.stiffness[40:80], atol=1e-6)


def test_a_robot_file_without_it_has_stiff_plans(stream: StreamSettings, slack: Motion) -> None:
    np.testing.assert_array_equal(settled(Retargeter(yielding(1.0), stream), slack).stiffness, 1.0)


@given(least=st.floats(0.1, 1.0), tension=st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3))
def test_shares_are_between_the_least_and_all_of_it(least: float, tension: list[float]) -> None:
    shares = LimbStiffness(yielding(least)).shares(np.array([tension]))
    assert shares.shape == (1, ROBOT.n)
    assert (shares >= least - 1e-12).all() and (shares <= 1.0 + 1e-12).all()
    np.testing.assert_array_equal(shares[:, LEGS], 1.0)
