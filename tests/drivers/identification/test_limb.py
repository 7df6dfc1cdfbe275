"""The load of a limb is that of MuJoCo's forward dynamics, on a stand that tilts."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.drivers.identification.limb import Limb
from flexmotion.drivers.identification.record import RobotRecord


def test_weight_and_inertia_at_rest() -> None:
    """The torque of gravity is the change of potential energy with the angle, found without any dynamics."""
    robot = load_robot("op3")
    knee, limb = robot.index("l_knee"), Limb(robot, robot.index("l_knee"))
    gravity = np.array([3.0, 0.0, -9.0])
    angles, step = np.array([0.4, 1.0, 1.6]), 1e-5
    found = limb.at(robot.stand_pose, angles, gravity)
    data = mujoco.MjData(robot.model)

    def energy(angle: float) -> float:
        data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
        data.qpos[robot.qpos_address] = robot.stand_pose
        data.qpos[robot.qpos_address[knee]] = angle
        mujoco.mj_kinematics(robot.model, data)
        return -float((robot.model.body_mass[:, None] * data.xipos).sum(axis=0) @ gravity)

    expected = [(energy(angle + step) - energy(angle - step)) / (2 * step) for angle in angles]
    np.testing.assert_allclose(found.load, expected, atol=1e-6)
    assert found.inertia == pytest.approx(np.full(3, found.inertia[0]))  # about its own axis it does not change
    assert 0.002 < found.inertia[0] < 0.02


def test_a_torso_that_leans_and_turns_is_seen_by_its_imu() -> None:
    robot = load_robot("op3")
    knee, count = robot.index("l_knee"), 300
    time = np.arange(count) / robot.rate_hz
    pose = np.tile(robot.stand_pose, (count, 1))
    nothing = np.full((count, robot.n), np.nan)
    force = np.tile([4.0, 0.0, 8.9], (count, 1))
    fresh, turning = np.ones((count, robot.n), np.bool_), np.zeros((count, 3))
    still = RobotRecord(time, time, pose, pose, nothing, nothing, fresh, force, turning, bus_s=0.0, motion="")
    along = Limb(robot, knee).along(still)
    at_rest = Limb(robot, knee).at(robot.stand_pose, np.array([robot.stand_pose[knee]]), -force[0])
    np.testing.assert_allclose(along.load, at_rest.load[0], rtol=1e-6)
    np.testing.assert_allclose(along.inertia, at_rest.inertia[0], rtol=1e-6)
