"""Joints that stand still: blocked, loaded, creeping, set in motion, and read in turns."""

from __future__ import annotations

from copy import copy

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.streamer.control.obedience import PATIENCE_S, SHARE, Obedience
from flexmotion.streamer.control.stillness import FAR_SHARE, RETURNED_S, STILL_S, Stillness

RATE = 125.0
TICKS = round(STILL_S * RATE)


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


class Joint:
    """One joint of a robot that else does as predicted.

    Attributes:
        far: motion of its prediction that counts [rad].
        predicted, position: of this joint [rad].
        load: planned, over the stiffness [rad].
        share: of the stiffness with which it follows.
    """

    def __init__(self, robot: Robot, name: str = "l_knee", turns: int = 1) -> None:
        self.stillness, self.joint = Stillness(robot, turns), robot.index(name)
        self.far = float(self.stillness._far[self.joint])
        self.predicted = self.position = float(robot.stand_pose[self.joint])
        self.load, self.share = 0.0, 1.0
        self._predicted, self._position, self._goal = (robot.stand_pose.copy() for _ in range(3))
        self._known, self._share = np.ones(robot.n, np.bool_), np.ones(robot.n)
        self.stillness.reset(robot.stand_pose)

    def tick(self, *, known: bool = True) -> None:
        self._predicted[self.joint], self._position[self.joint] = self.predicted, self.position
        self._goal[self.joint], self._known[self.joint] = self.predicted + self.load, known
        self._share[self.joint] = self.share
        self.stillness.update(self._position, self._predicted, self._goal, self._known, self._share)

    @property
    def blocked(self) -> bool:
        return self.stillness.worst == self.joint


def test_a_blocked_knee_whose_plan_bears_a_load_is_found(op3: Robot) -> None:
    """It never carried 0.6 of its torque beside the plan's: it was found 6.7 s later, as the robot fell.

    What a goal implies is bounded at the joint's position, so that the plan's own load is missing in the rest.
    """
    obedience, joint = Obedience(op3), op3.index("l_knee")
    position, torque = op3.stand_pose.copy(), np.zeros(op3.n)
    torque[joint] = 0.45 * op3.usable_torque[joint]
    goal = position + torque / op3.kp
    obedience.reset(position)
    known = np.ones(op3.n, np.bool_)
    for _ in range(int(2 * PATIENCE_S * RATE)):
        obedience.update(goal, torque, position, known, np.ones(op3.n))
    assert obedience.worst is None
    goal[joint] = position[joint] + op3.usable_torque[joint] / op3.kp[joint]  # all that the clamp lets through
    for _ in range(2 * TICKS):
        obedience.update(goal, torque, position, known, np.ones(op3.n))
        assert abs(obedience.load[joint]) < SHARE
    assert obedience.worst == obedience.blocked == joint


def test_it_is_named_once_it_has_stood_still_long_enough(op3: Robot) -> None:
    knee = Joint(op3)
    for _ in range(10 * TICKS):  # a robot that stands: its prediction sways, its joints hold
        knee.predicted = op3.stand_pose[knee.joint] + 0.45 * knee.far * np.sin(_ / 20)
        knee.tick()
        assert not knee.blocked
    knee.predicted = op3.stand_pose[knee.joint] + 1.5 * knee.far
    for _ in range(TICKS):
        knee.tick()
        assert not knee.blocked
    for _ in range(2):
        knee.tick()
    assert knee.blocked and knee.stillness.span[knee.joint] > knee.far


def test_a_loaded_joint_that_moves_on_is_not_blocked(op3: Robot) -> None:
    """It hangs behind its prediction by nearly all that it can carry."""
    knee, lag = Joint(op3), 0.9 * float(op3.usable_torque[op3.index("l_knee")] / op3.kp[op3.index("l_knee")])
    for tick in range(10 * TICKS):
        knee.predicted = op3.stand_pose[knee.joint] + 0.3 * np.sin(2 * np.pi * tick / RATE)
        knee.position = knee.predicted - lag
        knee.tick()
        assert not knee.blocked


def test_a_joint_that_is_set_in_motion_may_be_late(op3: Robot) -> None:
    """Goals of arms jump ahead of them as they are set in motion: OP3's shoulders stand still for 0.05 s."""
    arm = Joint(op3, "l_sho_pitch")
    arm.predicted += 2 * arm.far
    for _ in range(TICKS):
        arm.tick()
    arm.position += 0.5 * arm.far
    for _ in range(TICKS):
        arm.tick()
        assert not arm.blocked


def test_a_prediction_that_came_back_asks_for_nothing(op3: Robot) -> None:
    """An elbow was called blocked as the robot began to mirror a walk, and the robot was parked.

    Its reference went .1 rad out and back within .2 s: the servo had no time to follow, and then no reason to.
    """
    elbow, stands = Joint(op3, "r_el"), op3.stand_pose[op3.index("r_el")]
    for tick in range(round(0.2 * RATE)):
        elbow.predicted = stands + 1.2 * elbow.far * np.sin(np.pi * tick / (0.2 * RATE))
        elbow.tick()
        assert not elbow.blocked
    elbow.predicted = stands
    for _ in range(10 * TICKS):
        elbow.tick()
        assert not elbow.blocked


def test_predictions_that_came_back_do_not_add_up(op3: Robot) -> None:
    """The second small gesture of an arm that was at rest for a minute would have been one too many."""
    elbow, stands = Joint(op3, "r_el"), op3.stand_pose[op3.index("r_el")]
    for _ in range(5):
        for tick in range(round(0.2 * RATE)):
            elbow.predicted = stands + 1.2 * elbow.far * np.sin(np.pi * tick / (0.2 * RATE))
            elbow.tick()
            assert not elbow.blocked
        elbow.predicted = stands
        for _ in range(round(1.5 * RETURNED_S * RATE)):
            elbow.tick()


@pytest.mark.parametrize(("size", "blocked"), [(0.45, False), (0.8, True)])
def test_half_the_way_is_where_a_prediction_is_back(op3: Robot, size: float, blocked: bool) -> None:
    knee = Joint(op3)
    knee.predicted = op3.stand_pose[knee.joint] + 1.1 * knee.far
    for _ in range(TICKS // 2):
        knee.tick()
    knee.predicted = op3.stand_pose[knee.joint] + size * knee.far
    for _ in range(10 * TICKS):
        knee.tick()
    assert knee.blocked == blocked


def test_a_blocked_joint_whose_prediction_swings_is_found(op3: Robot) -> None:
    """Its prediction comes back to it twice a swing: the time in between counts on."""
    knee = Joint(op3)
    for tick in range(6 * TICKS):
        knee.predicted = op3.stand_pose[knee.joint] + 1.5 * knee.far * np.sin(2 * np.pi * 2.0 * tick / RATE)
        knee.tick()
    assert knee.blocked


def test_a_soft_forearm_that_turns_around_is_late_by_its_softness(op3: Robot) -> None:
    """At a third of its stiffness it came to rest behind its goals for 0.16 s, and the robot was stopped and parked.

    Half an hour of random targets, at 919 s; blocked it is found as well, later.
    """
    forearm = Joint(op3, "r_el")
    forearm.share = 1 / 3
    forearm.predicted += 1.5 * forearm.far
    for _ in range(3 * TICKS - 1):
        forearm.tick()
        assert not forearm.blocked
    for _ in range(4):
        forearm.tick()
    assert forearm.blocked


def test_a_blocked_joint_that_creeps_is_found(op3: Robot) -> None:
    knee = Joint(op3)
    for tick in range(3 * TICKS):
        knee.predicted = op3.stand_pose[knee.joint] + 0.02 * tick
        knee.position = op3.stand_pose[knee.joint] + 0.05 * (knee.predicted - op3.stand_pose[knee.joint])
        knee.tick()
    assert knee.blocked


def test_a_joint_at_which_the_servo_pushes_with_all_its_torque_is_blocked(op3: Robot) -> None:
    """Its goal stays at the clamp while plan and prediction go on: a blocked ankle under the robot's weight."""
    ankle = Joint(op3, "l_ank_pitch")
    goal = op3.stand_pose[ankle.joint] + op3.usable_torque[ankle.joint] / op3.kp[ankle.joint]
    for tick in range(2 * TICKS):
        ankle.predicted = op3.stand_pose[ankle.joint] + min(0.1 * tick, 1.0) * 2 * ankle.far
        ankle.load = goal - ankle.predicted
        ankle.tick()
    assert ankle.blocked


def test_a_leg_that_takes_up_the_weight_stands_still_as_planned(op3: Robot) -> None:
    knee = Joint(op3)
    for tick in range(4 * TICKS):
        knee.load = 3 * knee.far * np.sin(tick / 10)
        knee.tick()
        assert not knee.blocked


def test_a_joint_whose_goals_ask_nothing_of_it_is_not_blocked(op3: Robot) -> None:
    """The plan went on four ticks at once: the clamp took the torque back, and a leg that stood was called blocked."""
    hip = Joint(op3, "l_hip_roll")
    for tick in range(4 * TICKS):
        hip.predicted = op3.stand_pose[hip.joint] + 2 * hip.far * np.sin(tick / 10)
        hip.load = op3.stand_pose[hip.joint] - hip.predicted
        hip.tick()
        assert not hip.blocked


def test_a_joint_that_was_not_measured_is_not_judged(op3: Robot) -> None:
    knee = Joint(op3)
    knee.predicted += 2 * knee.far
    for tick in range(4 * TICKS):
        knee.tick(known=tick % TICKS != 0)
        assert not knee.blocked


def test_dry_friction_holds_a_joint_within_its_own_torque(op3: Robot) -> None:
    """A servo with much friction stands still while its torque changes by twice as much."""
    rough, place = copy(op3), op3.index("l_knee")
    more = op3.servos[place].model_copy(update={"frictionloss": 0.3 * op3.usable_torque[place]})
    rough.servos = (*op3.servos[:place], more, *op3.servos[place + 1 :])
    knee, smooth = Joint(rough), Joint(op3)
    for _ in range(2 * TICKS):
        for each in (knee, smooth):
            each.predicted = op3.stand_pose[place] + (FAR_SHARE + 0.5) * op3.usable_torque[place] / op3.kp[place]
            each.tick()
    assert smooth.blocked and not knee.blocked


@pytest.mark.parametrize("turns", [8, 40])
def test_a_joint_that_is_read_in_turns_stands_still_between_its_readings(op3: Robot, turns: int) -> None:
    arm = Joint(op3, "l_sho_pitch", turns)
    begin = arm.position
    for tick in range(10 * turns):
        arm.predicted = begin + 0.6 * np.sin(2 * np.pi * tick / RATE)
        if tick % turns == 0:
            arm.position = arm.predicted
        arm.tick()
        assert not arm.blocked
    arm.position = arm.predicted = begin
    for tick in range(TICKS + 3 * turns):
        arm.predicted = begin + (1.0 if tick > 1 else 0.0)
        arm.tick()
    assert arm.blocked


@pytest.mark.parametrize("turns", [8, 40])
def test_a_blocked_joint_that_is_read_in_turns_is_found_after_one_swing(op3: Robot, turns: int) -> None:
    """Only the time in which its prediction was elsewhere counted: a shoulder was blocked, and nobody was told."""
    arm = Joint(op3, "l_sho_pitch", turns)
    begin, away = arm.position, TICKS + turns + 2  # longer than any joint that follows stands still in its readings
    for tick in range(away):
        arm.predicted = begin + 2 * arm.far * np.sin(np.pi * (tick + 1) / (away + 1)) ** 0.1
        arm.tick()
    arm.predicted = begin
    for _ in range(turns):
        arm.tick()
    assert arm.blocked


@pytest.mark.parametrize("turns", [8, 40])
def test_a_swing_between_two_readings_is_not_seen(op3: Robot, turns: int) -> None:
    arm = Joint(op3, "l_sho_pitch", turns)
    begin = arm.position
    for _ in range(5):
        for tick in range(turns):
            arm.predicted = begin + 2 * arm.far * np.sin(np.pi * tick / turns)
            arm.tick()
        arm.predicted = begin
        for _ in range(round(1.5 * RETURNED_S * RATE) + turns):
            arm.tick()
            assert not arm.blocked
