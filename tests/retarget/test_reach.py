"""Hands at places: inside reach exactly there, outside as near as can be, never in the body."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.retarget.part_solver import PartSolver
from flexmotion.retarget.retargeter import Retargeter


@pytest.fixture(scope="module")
def solver(retargeter: Retargeter) -> PartSolver:
    return retargeter.solver


class Posed:
    """The robot at given joint angles, by MuJoCo."""

    def __init__(self, robot: Robot, q: np.ndarray) -> None:
        self.robot, self.data = robot, mujoco.MjData(robot.model)
        self.data.qpos[:7], self.data.qpos[robot.qpos_address] = (0, 0, 1, 1, 0, 0, 0), q
        mujoco.mj_kinematics(robot.model, self.data)
        mujoco.mj_collision(robot.model, self.data)

    def hand(self, side: str) -> np.ndarray:
        hands = self.robot.config.hands
        assert hands is not None
        hand = getattr(hands, side)
        body = self.data.body(hand.body)
        place = body.xpos + body.xmat.reshape(3, 3) @ np.asarray(hand.point)
        found: np.ndarray = place - self.data.xpos[self.robot.torso_id]
        return found

    @property
    def touches(self) -> bool:
        return bool(self.data.ncon)


def taken(retargeter: Retargeter, columns: np.ndarray, angles: np.ndarray) -> np.ndarray:
    q = retargeter.robot.stand_pose.copy()
    q[retargeter.body.upper.joints[columns]] = angles
    return q


def test_every_place_that_an_arm_can_take_is_reached_by_mujocos_kinematics(
    retargeter: Retargeter, solver: PartSolver
) -> None:
    robot, rng = retargeter.robot, np.random.default_rng(0)
    chain, reached = retargeter.body.upper.chain, 0
    for number in range(40):
        side = number % 2
        q = robot.stand_pose.copy()
        q[chain.joints[side]] = rng.uniform(chain.lower[side], chain.upper[side])
        posed = Posed(robot, q)
        if posed.touches:
            continue
        place = posed.hand(("left", "right")[side])
        found = solver.hand(("left", "right")[side], place, 0.02, robot.stand_pose)
        there = Posed(robot, taken(retargeter, found.columns, found.angles))
        away = np.linalg.norm(there.hand(("left", "right")[side]) - place)
        assert not there.touches and away <= 0.02
        reached += away < 0.002
    assert reached >= 33  # the rest are nearer to the body than forearms keep


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.05), (0.0, 0.0, -0.05), (0.05, 0.0, 0.17), (0.0, 0.08, -0.2)])
def test_a_place_in_the_body_is_replaced_by_one_that_does_not_touch_it(
    retargeter: Retargeter, solver: PartSolver, place: tuple[float, float, float]
) -> None:
    found = solver.hand("left", np.array(place), 1.0, retargeter.robot.stand_pose)
    assert not Posed(retargeter.robot, taken(retargeter, found.columns, found.angles)).touches


def test_a_place_out_of_reach_is_moved_within_the_tolerance_and_refused_beyond_it(
    retargeter: Retargeter, solver: PartSolver
) -> None:
    far = np.array([0.0, 0.33, 0.1])  # the arm straight out reaches to .285
    found = solver.hand("left", far, 0.06, retargeter.robot.stand_pose)
    there = Posed(retargeter.robot, taken(retargeter, found.columns, found.angles)).hand("left")
    assert there == pytest.approx([0.0, 0.285, 0.1], abs=5e-3)
    assert found.moved is not None and "cm from there" in found.moved
    with pytest.raises(ConfigError, match=r"hand: out of reach of the left hand.*nearest place is \[.*tolerance 3 cm"):
        solver.hand("left", far, 0.03, retargeter.robot.stand_pose)


def test_an_arm_points_along_the_direction_from_its_shoulder(retargeter: Retargeter, solver: PartSolver) -> None:
    chain = retargeter.body.upper.chain
    for direction in ((0.0, -1.0, 0.0), (1.0, -0.5, 0.3), (0.3, -1.0, 1.0)):
        found = solver.point("right", np.array(direction), 0.2, retargeter.robot.stand_pose)
        poses = chain.poses(taken(retargeter, found.columns, found.angles)[chain.joints])
        arm = (poses.hand - poses.shoulder)[1]
        assert arm @ direction / np.linalg.norm(arm) / np.linalg.norm(direction) > np.cos(0.2)
        assert np.linalg.norm(arm) > 0.85 * chain.lengths[1].sum()


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (1.0, 1.0, 0.3), (1.0, -2.0, -0.5), (0.1, 1.0, 0.0)])
def test_the_head_looks_along_a_direction_by_mujocos_kinematics(
    retargeter: Retargeter, solver: PartSolver, direction: tuple[float, float, float]
) -> None:
    found = solver.look(np.array(direction), 0.1)
    posed = Posed(retargeter.robot, taken(retargeter, found.columns, found.angles))
    gaze = posed.data.body("head_tilt_link").xmat.reshape(3, 3)[:, 0]
    assert gaze == pytest.approx(np.array(direction) / np.linalg.norm(direction), abs=0.02)


def test_what_the_head_and_joints_cannot_do_is_refused_with_what_they_can(solver: PartSolver) -> None:
    with pytest.raises(ConfigError, match="look: the head cannot look there; nearest is a direction 9.° from there"):
        solver.look(np.array([-1.0, 0.0, 0.0]), 0.3)
    with pytest.raises(ConfigError, match="joint: 'l_knee' moves with the legs, which keep the balance; .*head_pan"):
        solver.joint("l_knee", 0.5, 0.1)
    with pytest.raises(ConfigError, match="joint: 'tail' is not known; expected one of: l_sho_pitch, "):
        solver.joint("tail", 0.5, 0.1)
    found = solver.joint("r_el", 2.05, 0.1)
    assert found.angles == pytest.approx([2.0]) and found.moved == "2 rad (114.6°), the joint's limit"


def test_the_angle_of_a_refused_joint_is_told_in_degrees_too(solver: PartSolver) -> None:
    """`flexmotion send --joint L_EL 45`, in degrees, was refused with "0.785398 rad, expected -2.2 to 0"."""
    says = r"joint: r_el: 2\.618 rad \(150°\), expected -2 to 2 rad \(-114\.6° to 114\.6°\)$"
    with pytest.raises(ConfigError, match=says):
        solver.joint("r_el", math.radians(150.0), 0.1)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ((0.12743528, -0.01098538, 0.15997038), (0.12800503, -0.01033205, 0.17515219)),
        ((0.09020965, -0.01662397, 0.0905129), (0.0834758, 0.0008754, 0.09682109)),
    ],
)
def test_a_hand_beside_the_other_one_does_not_touch_it(
    retargeter: Retargeter, solver: PartSolver, first: tuple[float, ...], second: tuple[float, ...]
) -> None:
    """The table of starts is clear of the stand pose: one that touched the raised arm was the answer, "accepted"."""
    q = retargeter.robot.stand_pose.copy()
    left = solver.hand("left", np.array(first), 0.03, q)
    q[retargeter.body.upper.joints[left.columns]] = left.angles
    right = solver.hand("right", np.array(second), 1.0, q)
    q[retargeter.body.upper.joints[right.columns]] = right.angles
    assert not Posed(retargeter.robot, q).touches


def test_an_arm_that_can_go_nowhere_is_refused(
    retargeter: Retargeter, solver: PartSolver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was brought to a configuration that touches the body."""
    monkeypatch.setattr(solver._reach, "_allowed", -1.0)
    with pytest.raises(ConfigError, match="the other arm is in the way of the right one: relax it, or move it first"):
        solver.hand("right", np.array([0.12, -0.1, 0.1]), 0.1, retargeter.robot.stand_pose)


def test_what_a_plan_delivers_is_told_where_it_is_not_the_goal(retargeter: Retargeter, solver: PartSolver) -> None:
    """A plan that led the arm around the body was answered as if the hand were at its place."""
    robot = retargeter.robot
    found = solver.hand("left", np.array([0.12, 0.12, 0.05]), 0.01, robot.stand_pose)
    there = np.repeat(taken(retargeter, found.columns, found.angles)[None], 20, axis=0)
    assert solver.kept_away(found.columns, found.angles, there) is None
    led = there.copy()
    led[7, retargeter.body.upper.joints[found.columns[0]]] += 0.2
    told = str(solver.kept_away(found.columns, found.angles, led))
    assert told.startswith("[0.1") and told.endswith("cm from there, clear of the body")
    away = np.linalg.norm(Posed(robot, led[7]).hand("left") - Posed(robot, there[0]).hand("left"))
    assert f"{100 * away:.1f} cm" in told
    elbow = found.columns[2:3]
    assert solver.kept_away(elbow, found.angles[2:3] + 0.2, there) == "11° of a joint from there, clear of the body"
