"""Feet that are about to strike the ground: foreseen as the simulator has them strike, and in the goals of a knee."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.drivers.sim.world import build_model, start_qpos
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.foot_strikes import FootStrikes
from flexmotion.streamer.control.servo_command import ServoCommand

ROBOT = load_robot("op3")
DELAY = 0.004
OMEGA = 7.2
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
LEFT_KNEE, RIGHT_KNEE, ANKLE = ROBOT.index("l_knee"), ROBOT.index("r_knee"), ROBOT.index("l_ank_pitch")


@dataclass(frozen=True)
class Strike:
    """OP3 that walked ahead and was pushed (`benchmarks/robot/pushes`), just before a foot strikes.

    Attributes:
        q, qd: joint positions [rad] and speeds [rad/s] as measured: head and arms, left leg, right leg.
        qd_before: speeds of the tick before.
        torso, gyro: its attitude, w x y z, and angular velocity [rad/s].
        knee: of the leg that strikes.
        wanted: position, speed and torque of this knee in the plan, by which its flexion is to be stopped [rad, rad/s,
            N·m].
        struck: its position and speed after the strike, at which the goal is judged [rad, rad/s].
    """

    q: np.ndarray
    qd: np.ndarray
    qd_before: np.ndarray
    torso: tuple[float, ...]
    gyro: tuple[float, ...]
    knee: int
    wanted: tuple[float, float, float]
    struck: tuple[float, float]


# fmt: off
HEEL = Strike(
    q=np.array([
        0.057, -0.135, -0.517, 1.232, -0.233, 0.009, -1.335, 0.061,
        0.008, -0.196, -1.577, 1.572, 0.39, 0.114,
        0.166, 0.124, 0.402, -1.135, -0.802, 0.014,
    ]),
    qd=np.array([
        -0.197, -0.112, 1.806, 0.263, 0.954, 1.401, 0.205, 0.317,
        0.707, 3.587, -3.304, 1.55, 2.417, 3.065,
        -0.182, 2.267, -2.397, 0.689, -0.197, 2.955,
    ]),
    qd_before=np.array([
        -0.195, -0.109, 1.691, 0.217, 0.921, 1.299, 0.184, 0.284,
        0.614, 3.507, -3.586, 1.859, 2.183, 3.35,
        -0.159, 2.203, -2.288, 0.539, -0.258, 2.729,
    ]),
    torso=(0.964, -0.18, 0.191, 0.036), gyro=(0.184, 0.091, 1.685),
    knee=LEFT_KNEE, wanted=(1.495, -0.981, -0.593), struck=(1.583, 2.646),
)
"""Pushed to its right by .9 N·s (seed 5), 1.2 s later. Its left foot was planned on the ground for seven ticks, and
stands on the toe's outer corner; the heel is about to strike."""
TOE = Strike(
    q=np.array([
        0.064, -0.14, -0.446, 1.362, -0.146, 0.098, -1.308, 0.035,
        0.063, -0.552, -0.799, 1.667, 0.854, -0.244,
        0.029, -0.129, 0.604, -1.187, -0.726, -0.16,
    ]),
    qd=np.array([
        0.021, -0.126, 1.325, 0.49, 0.47, 1.052, 0.043, 0.057,
        1.188, 0.809, -4.672, 1.211, -4.052, 0.665,
        0.523, 0.437, -2.819, 0.062, -0.974, -0.139,
    ]),
    qd_before=np.array([
        0.033, -0.119, 1.314, 0.465, 0.456, 0.971, 0.05, 0.038,
        1.136, 0.646, -4.657, 1.774, -3.931, 0.619,
        0.539, 0.436, -3.016, 0.127, -0.999, -0.182,
    ]),
    torso=(0.978, -0.191, 0.078, 0.015), gyro=(-1.573, -1.726, -0.007),
    knee=LEFT_KNEE, wanted=(1.66, -2.458, -2.273), struck=(1.677, 2.36),
)
"""Pushed ahead and to its right by 1.2 N·s (seed 7), it falls: its left foot is dragged along at 1.1 m/s, and the toe
is about to strike."""
TILTED = Strike(
    q=np.array([
        -0.038, -0.144, -0.558, 1.325, -0.219, -0.187, -1.304, 0.021,
        0.04, -0.138, -0.27, 1.089, 0.842, -0.184,
        -0.017, 0.296, 1.046, -1.275, -0.347, 0.101,
    ]),
    qd=np.array([
        -0.002, -0.042, 0.858, 0.046, 0.199, 0.36, -0.019, 0.001,
        0.132, -2.51, 3.857, -1.222, -0.233, -3.876,
        0.009, -3.193, -0.772, -1.389, -3.253, -3.494,
    ]),
    qd_before=np.array([
        -0.005, -0.04, 0.76, 0.035, 0.168, 0.298, -0.004, -0.002,
        0.11, -2.507, 3.616, -1.138, -0.115, -3.934,
        0.009, -2.944, -0.377, -1.893, -3.003, -3.282,
    ]),
    torso=(0.997, 0.076, 0.002, 0.0), gyro=(-1.018, -1.688, -0.577),
    knee=RIGHT_KNEE, wanted=(-1.395, -0.354, 5.759), struck=(-1.285, -2.428),
)
"""Pushed to its right by .9 N·s (seed 2): it stands on the outer corner of its left foot, and the heel of the right
one, which is about to strike, seems to be 2.3 mm lower."""
# fmt: on


def estimated(q: np.ndarray, qd: np.ndarray, torso: tuple[float, ...] = UPRIGHT, gyro: object = 0.0) -> Estimator:
    """An estimator that has just seen a robot."""
    estimator = Estimator(ROBOT, OMEGA)
    model, data = estimator.model, estimator.data
    data.qpos[:3], data.qpos[3:7], data.qpos[ROBOT.qpos_address] = 0.0, torso, q
    data.qvel[:3], data.qvel[3:6], data.qvel[ROBOT.dof_address] = 0.0, gyro, qd
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    return estimator


def foreseen(estimator: Estimator) -> np.ndarray:
    strikes = FootStrikes(ROBOT, DELAY)
    strikes.update(estimator)
    return strikes.change.copy()


def foreseen_of(strike: Strike) -> np.ndarray:
    return foreseen(estimated(strike.q, strike.qd, strike.torso, strike.gyro))


def implied_by_the_goal(strike: Strike, struck: np.ndarray | None) -> float:
    """What the goal of the knee implies for it after the strike, over the stall torque."""
    command, state, knee = ServoCommand(ROBOT, DELAY), RobotState(ROBOT.n), strike.knee
    q, qd, torque = strike.q.copy(), strike.qd.copy(), np.zeros(ROBOT.n)
    q[knee], qd[knee], torque[knee] = strike.wanted
    for velocity in (strike.qd_before, strike.qd):
        state.position[:], state.velocity[:], state.voltage[:] = strike.q, velocity, 12.0
        command.update(q, qd, torque, state, struck=struck)
    position, speed = strike.struck
    implied = ROBOT.kp[knee] * (command.goal[knee] - position) - ROBOT.back_emf[knee] * speed
    return float(implied / ROBOT.stall_torque[knee])


@pytest.mark.parametrize("strike", [HEEL, TOE, TILTED], ids=["heel", "toe", "tilted"])
def test_the_goal_of_a_knee_is_inside_the_envelope_when_its_foot_strikes_while_the_goal_is_under_way(
    strike: Strike,
) -> None:
    """The knee yielded and slowed down; its goal implied .8 of the stall torque then, and 1.07 or more 4 ms later.

    The toe went down at .3 m/s and along at 1.1: of its strike the way down alone was foreseen, by which the knee
    became faster by .3 rad/s, not by 1.15. In the last case the lowest corner, which came down, was taken
    to be the one that the robot stands on.
    """
    assert abs(implied_by_the_goal(strike, None)) > 1.0
    assert abs(implied_by_the_goal(strike, foreseen_of(strike))) < 0.95


@pytest.mark.parametrize("strike", [HEEL, TOE], ids=["heel", "toe"])
def test_a_strike_flexes_the_knee_as_it_did_in_the_simulator_or_by_somewhat_more(strike: Strike) -> None:
    """A floor that is rougher than that one stops the foot along it, too."""
    faster = strike.struck[1] - strike.qd[strike.knee]
    assert 0.9 * faster < foreseen_of(strike)[1, strike.knee] < 1.4 * faster


def test_a_heel_that_strikes_stops_the_ankle_and_hardly_moves_the_arms() -> None:
    """In the simulator the ankle's speed fell from 2.4 to 1.4 rad/s."""
    least, most = foreseen_of(HEEL)
    assert least[ANKLE] == pytest.approx(-0.95, rel=0.4)
    arms = [ROBOT.index(name) for name in ROBOT.joint_names if "sho" in name or name.endswith("el")]
    assert np.abs([least[arms], most[arms]]).max() < 0.2


def test_a_strike_is_no_more_than_the_speed_of_the_foot_says() -> None:
    """Twice as fast, twice the change."""
    one = foreseen_of(HEEL)
    two = foreseen(estimated(HEEL.q, 2.0 * HEEL.qd, HEEL.torso, 2.0 * np.array(HEEL.gyro)))
    assert 1.9 * one[1, LEFT_KNEE] <= two[1, LEFT_KNEE] <= 2.5 * one[1, LEFT_KNEE]


@pytest.mark.parametrize("speed", [0.0, 0.5, -0.5])
def test_a_robot_that_stands_on_both_soles_expects_no_strike(speed: float) -> None:
    """Nor does one that goes down or up, whose soles stay on the ground."""
    qd = np.zeros(ROBOT.n)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for joint, share in (("hip_pitch", -1.0), ("knee", 2.0), ("ank_pitch", 1.0)):
            qd[ROBOT.index(f"{side}_{joint}")] = sign * share * speed
    np.testing.assert_array_equal(foreseen(estimated(ROBOT.stand_pose, qd)), 0.0)


@pytest.mark.parametrize(("raised", "speed", "strikes"), [(0.3, -3.0, False), (0.15, 3.0, False), (0.05, -3.0, True)])
def test_only_a_foot_that_is_low_and_comes_down_may_strike(raised: float, speed: float, strikes: bool) -> None:
    q, qd = ROBOT.stand_pose.copy(), np.zeros(ROBOT.n)
    for joint, share in (("hip_pitch", -1.0), ("knee", 2.0), ("ank_pitch", 1.0)):
        q[ROBOT.index(f"l_{joint}")] += share * raised
        qd[ROBOT.index(f"l_{joint}")] = share * speed / 2.0
    change = foreseen(estimated(q, qd))
    assert change.any() == strikes
    if strikes:
        assert change[1, LEFT_KNEE] > 0.2  # it flexes


@pytest.mark.parametrize("tilt", [0.1, -0.1])
@pytest.mark.parametrize("speed", [2.0, 4.0])
def test_a_strike_changes_the_joints_as_in_the_simulator(tilt: float, speed: float) -> None:
    """The left foot comes down beside the right one, heel or toes first, without gravity, friction and servos."""
    q, qd = ROBOT.stand_pose.copy(), np.zeros(ROBOT.n)
    for joint, share in (("hip_pitch", -0.5), ("knee", 1.0), ("ank_pitch", 0.5)):
        q[ROBOT.index(f"l_{joint}")] += 0.24 * share
        qd[ROBOT.index(f"l_{joint}")] = -speed * share
    q[ANKLE] += tilt
    model = build_model(ROBOT, SimOptions(joint_friction_scale=0.0, timestep=1e-4))
    model.opt.gravity[:], model.dof_damping[:] = 0.0, 0.0
    data = mujoco.MjData(model)
    data.qpos[:], data.eq_active[:] = start_qpos(ROBOT, model, ROBOT.stand_pose, SimOptions()), 0
    data.qpos[ROBOT.qpos_address], data.qvel[ROBOT.dof_address] = q, qd
    for _ in range(2000):
        mujoco.mj_step(model, data)
        if any(ROBOT.foot_ids[0] in model.geom_bodyid[pair] for pair in data.contact.geom[: data.ncon]):
            break
    before, torso = data.qvel[ROBOT.dof_address].copy(), tuple(data.qpos[3:7].tolist())
    least, most = foreseen(estimated(data.qpos[ROBOT.qpos_address], before, torso, data.qvel[3:6]))
    mujoco.mj_step(model, data, 30)  # 3 ms: the contact is over, the motion of the joints has hardly changed
    change = data.qvel[ROBOT.dof_address] - before
    assert abs(change[LEFT_KNEE]) > 0.04 and abs(change[ANKLE]) > 0.1
    for number in (LEFT_KNEE, ANKLE):
        found = most[number] if change[number] > 0.0 else least[number]
        assert found == pytest.approx(change[number], rel=0.25, abs=0.1)


def test_a_reading_that_is_no_number_foresees_no_strike_that_is_none() -> None:
    q = HEEL.q.copy()
    q[LEFT_KNEE] = np.nan
    assert np.isfinite(foreseen(estimated(q, HEEL.qd, HEEL.torso, HEEL.gyro))).all()
