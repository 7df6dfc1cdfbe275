"""The simulated robot in a process of its own: a robot like any other, on the real clock."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import numpy as np
import pytest

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.process import SimProcess

pytestmark = pytest.mark.wall_clock


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture
def robot(op3: Robot) -> Iterator[SimProcess]:
    with SimDriver(op3).detached(realtime=False) as driver:
        yield driver


def wait_until(driver: SimProcess, state: RobotState, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        driver.read(state)
        time.sleep(0.004)


def test_it_is_no_lockstep_driver_and_tells_the_truth(robot: SimProcess) -> None:
    assert not robot.capabilities.lockstep and robot.capabilities.truth and robot.capabilities.imu


def test_time_passes_whether_or_not_anybody_reads(robot: SimProcess, op3: Robot) -> None:
    state = RobotState(op3.n)
    robot.read(state)
    first = state.stamp_ns
    time.sleep(0.2)
    robot.read(state)
    assert state.stamp_ns - first > 0.15e9
    assert (state.stale == 0).all() and state.imu_stale == 0


def test_goals_move_the_joints_and_torque_off_lets_go(robot: SimProcess, op3: Robot) -> None:
    state, command = RobotState(op3.n), JointCommand(op3.n)
    wait_until(robot, state, 0.05)
    command.position[:] = state.position
    head = op3.joint_names.index("head_pan")
    robot.set_torque(True)
    start = state.position[head]
    command.position[head] = start + 0.08
    robot.write(command)
    wait_until(robot, state, 0.6)
    assert abs(state.position[head] - start - 0.08) < 0.02
    assert robot.violations == 0
    robot.set_torque(False)
    wait_until(robot, state, 1.5)
    assert robot.truth().base_position[2] < -0.02 or abs(robot.truth().base_quaternion[0]) < 0.99  # it collapses


def test_a_robot_that_was_killed_does_not_answer(robot: SimProcess, op3: Robot) -> None:
    state = RobotState(op3.n)
    robot.read(state)
    before = state.position.copy()
    assert robot.pid is not None
    os.kill(robot.pid, signal.SIGKILL)
    for _ in range(20):
        time.sleep(0.008)
        robot.read(state)
    assert (state.stale > op3.safety.max_stale_reads).all() and state.imu_stale > op3.safety.max_stale_reads
    np.testing.assert_allclose(state.position, before, atol=0.1)  # what it said last
    robot.close()
    robot.close()


def test_a_robot_whose_process_had_to_wait_is_not_taken_for_dead(robot: SimProcess, op3: Robot) -> None:
    # A machine with other things to do kept it from running for 60 ms, and a run ended in FAULT.
    state = RobotState(op3.n)
    robot.read(state)
    assert robot.pid is not None
    os.kill(robot.pid, signal.SIGSTOP)
    for _ in range(8):
        robot.read(state)
    os.kill(robot.pid, signal.SIGCONT)
    assert (state.stale <= op3.safety.max_stale_reads).all() and state.imu_stale <= op3.safety.max_stale_reads


def test_old_values_of_a_robot_that_waits_are_told_as_old(robot: SimProcess, op3: Robot) -> None:
    """They counted as fresh for 12 reads: full torque for where joints had been, one gyro integrated 12 times."""
    state = RobotState(op3.n)
    assert robot.pid is not None
    os.kill(robot.pid, signal.SIGSTOP)
    told = []
    for _ in range(16):
        robot.read(state)
        assert state.imu_stale == state.stale[0]
        told.append(int(state.stale[0]))
    os.kill(robot.pid, signal.SIGCONT)
    borne = op3.safety.max_stale_reads
    first = told.index(1)
    assert first <= 3 and told[first : first + borne] == list(range(1, borne + 1))
    assert told[11] == borne and told[-1] > borne


def test_what_keeps_it_from_opening_is_told(op3: Robot) -> None:
    class Unplugged(SimDriver):
        def open(self) -> None:
            raise DriverError("nobody home")

    with pytest.raises(DriverError, match="nobody home"):
        Unplugged(op3).detached(realtime=False).open()
