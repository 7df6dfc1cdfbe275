"""Feet that are about to strike the ground: foreseen as the simulator has them strike, and in the goals of a knee."""

from __future__ import annotations

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
KNEE, ANKLE = ROBOT.index("l_knee"), ROBOT.index("l_ank_pitch")

# OP3 that walks ahead, pushed to its right by .9 N·s (benchmarks/robot/pushes, seed 5), 1.2 s later. Its left foot was
# planned on the ground for seven ticks, and stands on the toe's outer corner; the heel is about to strike.
# Joint positions [rad] and speeds [rad/s] as measured, speeds of the tick before: head and arms, left leg, right leg.
# fmt: off
Q = np.array([
    0.057, -0.135, -0.517, 1.232, -0.233, 0.009, -1.335, 0.061,
    0.008, -0.196, -1.577, 1.572, 0.39, 0.114,
    0.166, 0.124, 0.402, -1.135, -0.802, 0.014,
])
QD = np.array([
    -0.197, -0.112, 1.806, 0.263, 0.954, 1.401, 0.205, 0.317,
    0.707, 3.587, -3.304, 1.55, 2.417, 3.065,
    -0.182, 2.267, -2.397, 0.689, -0.197, 2.955,
])
QD_BEFORE = np.array([
    -0.195, -0.109, 1.691, 0.217, 0.921, 1.299, 0.184, 0.284,
    0.614, 3.507, -3.586, 1.859, 2.183, 3.35,
    -0.159, 2.203, -2.288, 0.539, -0.258, 2.729,
])
# The same robot, pushed ahead and to its right by 1.2 N·s (seed 7), falls half a second later: its left foot is dragged
# along at 1.1 m/s, and the toe is about to strike.
DRAGGED_Q = np.array([
    0.064, -0.14, -0.446, 1.362, -0.146, 0.098, -1.308, 0.035,
    0.063, -0.552, -0.799, 1.667, 0.854, -0.244,
    0.029, -0.129, 0.604, -1.187, -0.726, -0.16,
])
DRAGGED_QD = np.array([
    0.021, -0.126, 1.325, 0.49, 0.47, 1.052, 0.043, 0.057,
    1.188, 0.809, -4.672, 1.211, -4.052, 0.665,
    0.523, 0.437, -2.819, 0.062, -0.974, -0.139,
])
DRAGGED_QD_BEFORE = np.array([
    0.033, -0.119, 1.314, 0.465, 0.456, 0.971, 0.05, 0.038,
    1.136, 0.646, -4.657, 1.774, -3.931, 0.619,
    0.539, 0.436, -3.016, 0.127, -0.999, -0.182,
])
# fmt: on
DRAGGED_TORSO, DRAGGED_GYRO = (0.978, -0.191, 0.078, 0.015), (-1.573, -1.726, -0.007)
DRAGGED_WANTED = 1.66, -2.458, -2.273
DRAGGED_KNEE = 1.677, 2.36
"""The knee as its goal was sent, 2 ms after it had been measured at 1.21 rad/s."""
TORSO, GYRO = (0.964, -0.18, 0.191, 0.036), (0.184, 0.091, 1.685)
WANTED = 1.495, -0.981, -0.593
"""The plan of the knee, with which its flexion is to be stopped [rad, rad/s, N·m]."""
STRUCK_Q, STRUCK_QD = 1.583, 2.646
"""The knee as the goal arrived, 4 ms after it had been measured at 1.55 rad/s."""


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


def implied_by_the_goal(
    q: np.ndarray,
    speeds: tuple[np.ndarray, np.ndarray],
    wanted: tuple[float, float, float],
    knee: tuple[float, float],
    struck: np.ndarray | None,
) -> float:
    """What the goal of the knee implies for it at a position and speed, over the stall torque.

    Args:
        speeds: of all joints, as measured in the tick before and now.
    """
    command, state = ServoCommand(ROBOT, DELAY), RobotState(ROBOT.n)
    q_ref, qd_ref, torque = q.copy(), speeds[1].copy(), np.zeros(ROBOT.n)
    q_ref[KNEE], qd_ref[KNEE], torque[KNEE] = wanted
    for velocity in speeds:
        state.position[:], state.velocity[:], state.voltage[:] = q, velocity, 12.0
        command.update(q_ref, qd_ref, torque, state, struck=struck)
    implied = ROBOT.kp[KNEE] * (command.goal[KNEE] - knee[0]) - ROBOT.back_emf[KNEE] * knee[1]
    return float(implied / ROBOT.stall_torque[KNEE])


def test_the_goal_of_a_knee_is_inside_the_envelope_when_the_heel_strikes_while_the_goal_is_under_way() -> None:
    """The knee yielded and slowed down; its goal implied .8 of the stall torque then, and 1.08 4 ms later."""
    change = foreseen(estimated(Q, QD, TORSO, GYRO))
    struck = STRUCK_Q, STRUCK_QD
    assert implied_by_the_goal(Q, (QD_BEFORE, QD), WANTED, struck, None) < -1.0
    assert implied_by_the_goal(Q, (QD_BEFORE, QD), WANTED, struck, change) > -0.95


def test_the_goal_of_a_knee_is_inside_the_envelope_when_the_toe_of_a_dragged_foot_strikes() -> None:
    """The foot went down at .3 m/s and along at 1.1; the strike was foreseen as that of its way down alone.

    The floor stopped all of it: the knee became faster by 1.15 rad/s where .34 were foreseen, and its goal implied 1.08
    of the stall torque.
    """
    change = foreseen(estimated(DRAGGED_Q, DRAGGED_QD, DRAGGED_TORSO, DRAGGED_GYRO))
    assert change[1, KNEE] == pytest.approx(DRAGGED_KNEE[1] - DRAGGED_QD[KNEE], rel=0.2)
    speeds = DRAGGED_QD_BEFORE, DRAGGED_QD
    assert implied_by_the_goal(DRAGGED_Q, speeds, DRAGGED_WANTED, DRAGGED_KNEE, None) < -1.0
    assert implied_by_the_goal(DRAGGED_Q, speeds, DRAGGED_WANTED, DRAGGED_KNEE, change) > -0.95


def test_a_heel_that_strikes_flexes_the_knee_and_stops_the_ankle() -> None:
    """In the simulator the knee went from 1.55 to 2.65 rad/s, and the ankle's speed fell from 2.4 to 1.4.

    It went aside at .3 m/s, too. Stopping all of that would add to the change; the sole was not that rough.
    """
    least, most = foreseen(estimated(Q, QD, TORSO, GYRO))
    assert most[KNEE] == pytest.approx(STRUCK_QD - QD[KNEE], rel=0.4)
    assert least[ANKLE] == pytest.approx(-0.95, rel=0.4)
    arms = [ROBOT.index(name) for name in ROBOT.joint_names if "sho" in name or name.endswith("el")]
    assert np.abs([least[arms], most[arms]]).max() < 0.2


def test_a_strike_is_no_more_than_the_speed_of_the_foot_says() -> None:
    """Twice as fast, twice the change."""
    one = foreseen(estimated(Q, QD, TORSO, GYRO))
    two = foreseen(estimated(Q, 2.0 * QD, TORSO, 2.0 * np.array(GYRO)))
    assert 1.9 * one[1, KNEE] <= two[1, KNEE] <= 2.5 * one[1, KNEE]


@pytest.mark.parametrize("speed", [0.0, 0.5, -0.5])
def test_a_robot_that_stands_on_both_soles_expects_no_strike(speed: float) -> None:
    """Nor does one that goes down or up, whose soles stay on the ground."""
    qd = np.zeros(ROBOT.n)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for joint, share in (("hip_pitch", -1.0), ("knee", 2.0), ("ank_pitch", 1.0)):
            qd[ROBOT.index(f"{side}_{joint}")] = sign * share * speed
    np.testing.assert_array_equal(foreseen(estimated(ROBOT.stand_pose, qd)), 0.0)


@pytest.mark.parametrize(("raised", "speed", "strikes"), [(0.3, -3.0, False), (0.05, 3.0, False), (0.05, -3.0, True)])
def test_only_a_foot_that_is_low_and_comes_down_may_strike(raised: float, speed: float, strikes: bool) -> None:
    q, qd = ROBOT.stand_pose.copy(), np.zeros(ROBOT.n)
    for joint, share in (("hip_pitch", -1.0), ("knee", 2.0), ("ank_pitch", 1.0)):
        q[ROBOT.index(f"l_{joint}")] += share * raised
        qd[ROBOT.index(f"l_{joint}")] = share * speed / 2.0
    change = foreseen(estimated(q, qd))
    assert change.any() == strikes
    if strikes:
        assert change[1, KNEE] > 0.2  # it flexes


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
    assert abs(change[KNEE]) > 0.04 and abs(change[ANKLE]) > 0.1
    for number in (KNEE, ANKLE):
        found = most[number] if change[number] > 0.0 else least[number]
        assert found == pytest.approx(change[number], rel=0.25, abs=0.1)


def test_a_reading_that_is_no_number_foresees_no_strike_that_is_none() -> None:
    q = Q.copy()
    q[KNEE] = np.nan
    assert np.isfinite(foreseen(estimated(q, QD, TORSO, GYRO))).all()
