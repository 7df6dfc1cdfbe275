"""The simulated robot in a process of its own, on the real clock.

Tests wait for states of the robot. None depends on how much time passes meanwhile.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator

import numpy as np
import psutil
import pytest
from numpy.typing import NDArray

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.process import QUANTUM_S, SimProcess

from ...waiting import wait_until

Float = NDArray[np.float64]

pytestmark = pytest.mark.wall_clock


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture
def robot(op3: Robot) -> Iterator[SimProcess]:
    with SimDriver(op3).detached(realtime=False) as driver:
        yield driver


def reads_until(driver: SimProcess, state: RobotState, reached: Callable[[], object], what: str) -> None:
    """Read until `reached()` is true."""

    def read() -> object:
        driver.read(state)
        return reached()

    wait_until(read, what)


def stop(driver: SimProcess) -> None:
    """Stop the robot's process, and wait until the system has stopped it."""
    assert driver.pid is not None
    os.kill(driver.pid, signal.SIGSTOP)
    process = psutil.Process(driver.pid)
    wait_until(lambda: process.status() == psutil.STATUS_STOPPED, "the robot's process is stopped")


def test_it_is_simulated_and_not_in_lockstep(robot: SimProcess) -> None:
    assert not robot.capabilities.lockstep and robot.capabilities.truth and robot.capabilities.imu


def test_time_passes_without_reads(robot: SimProcess, op3: Robot) -> None:
    state = RobotState(op3.n)
    robot.read(state)
    first, published = state.stamp_ns, robot._states.count
    wait_until(lambda: robot._states.count > published + 100, "the robot steps on")
    robot.read(state)
    assert state.stamp_ns > first
    assert (state.stale == 0).all() and state.imu_stale == 0


def test_goals_move_the_joints_and_torque_off_lets_go(robot: SimProcess, op3: Robot) -> None:
    state, command = RobotState(op3.n), JointCommand(op3.n)
    robot.read(state)
    command.position[:] = state.position
    head = op3.joint_names.index("head_pan")
    robot.set_torque(True)
    goal = state.position[head] + 0.08
    command.position[head] = goal
    robot.write(command)
    reads_until(robot, state, lambda: abs(state.position[head] - goal) < 0.02, "the head reaches its goal")
    assert robot.violations == 0
    robot.set_torque(False)

    def collapsed() -> bool:
        truth = robot.truth()
        return bool(truth.base_position[2] < -0.02 or abs(truth.base_quaternion[0]) < 0.99)

    reads_until(robot, state, collapsed, "the robot collapses without torque")


def test_all_joints_go_stale_when_the_process_is_killed(robot: SimProcess, op3: Robot) -> None:
    state = RobotState(op3.n)
    assert robot.pid is not None
    os.kill(robot.pid, signal.SIGKILL)
    process = psutil.Process(robot.pid)
    wait_until(lambda: process.status() == psutil.STATUS_ZOMBIE, "the robot's process is dead")
    robot.read(state)
    before = state.position.copy()
    for _ in range(20):
        robot.read(state)
    assert (state.stale > op3.safety.max_stale_reads).all() and state.imu_stale > op3.safety.max_stale_reads
    np.testing.assert_array_equal(state.position, before)  # the last values stay
    robot.close()
    robot.close()


def test_a_short_pause_of_the_process_is_no_fault(robot: SimProcess, op3: Robot) -> None:
    """Regression: on a busy machine the process did not run for 60 ms, and the run ended in FAULT."""
    state = RobotState(op3.n)
    robot.read(state)
    stop(robot)
    for _ in range(8):
        robot.read(state)
    assert robot.pid is not None
    os.kill(robot.pid, signal.SIGCONT)
    assert (state.stale <= op3.safety.max_stale_reads).all() and state.imu_stale <= op3.safety.max_stale_reads


def test_a_reading_is_stamped_with_the_moment_that_it_is_of(robot: SimProcess, op3: Robot) -> None:
    """Regression: it had the time at which it was sent.

    After a pause the joints had moved further than their servos can in the time between two such stamps: on a busy
    machine runs ended in a fault, "measures a position that cannot be".
    """
    state, stamps = RobotState(op3.n), list[int]()

    def read() -> None:
        robot.read(state)
        stamps.append(state.stamp_ns)

    for _ in range(3):
        wait_until(lambda: read() or len(set(stamps)) % 20 == 19, "readings")
        stop(robot)
        read()
        assert robot.pid is not None
        os.kill(robot.pid, signal.SIGCONT)
        wait_until(lambda: read() or len(set(stamps)) % 20 == 0, "the robot steps on")
    assert {stamp % round(QUANTUM_S * 1e9) for stamp in np.diff(stamps)} == {0}


def test_values_read_during_a_pause_are_stale(robot: SimProcess, op3: Robot) -> None:
    """Regression: they counted as fresh for 12 reads, and one gyro sample was integrated 12 times."""
    state = RobotState(op3.n)
    stop(robot)
    stale = []
    for _ in range(16):
        robot.read(state)
        assert state.imu_stale == state.stale[0]
        stale.append(int(state.stale[0]))
    assert robot.pid is not None
    os.kill(robot.pid, signal.SIGCONT)
    tolerated = op3.safety.max_stale_reads
    first = stale.index(1)
    assert first == 2 and stale[first : first + tolerated] == list(range(1, tolerated + 1))
    assert stale[11] == tolerated and stale[-1] > tolerated


def test_it_opens_again_after_a_run(robot: SimProcess, op3: Robot) -> None:
    """Regression: the second process read the first one's command to end, and ended."""
    state = RobotState(op3.n)
    robot.close()
    robot.open()
    published = robot._states.count
    wait_until(lambda: robot._states.count > published + 10, "the robot steps on")
    robot.read(state)
    assert (state.stale == 0).all()


def test_an_error_while_opening_is_raised_by_open(op3: Robot) -> None:
    class Unplugged(SimDriver):
        def open(self) -> None:
            raise DriverError("not connected")

    with pytest.raises(DriverError, match="not connected"):
        Unplugged(op3).detached(realtime=False).open()


def sway(process: SimProcess, lateness: list[int]) -> Float:
    """Joints after 100 steps with new goals in every fourth, in a process that is late by these numbers of steps."""
    simulation = process.simulation
    simulation.open()
    simulation.set_torque(True)
    state, command, step_ns = RobotState(process.robot.n), JointCommand(process.robot.n), round(QUANTUM_S * 1e9)
    simulation.read(state)
    pose, due, sent = state.position.copy(), 0, []
    for late in lateness:
        sent.clear()
        for step in range(due, due + late):
            if step % 4 == 0:
                command.position[:] = pose + 0.1 * np.sin(0.05 * step) * (np.arange(len(pose)) < 2)  # both shoulders
                row = np.zeros((), process._command.dtype)
                row["stamp_ns"], row["position"], row["torque_bound"] = (
                    step * step_ns,
                    command.position,
                    command.torque_bound,
                )
                sent.append(row)
        due += late
        process._simulate(np.array(sent), late, (due - 1) * step_ns)
    assert due == 100
    simulation.read(state)
    violations = simulation.violations
    simulation.close()
    assert violations == 0
    return state.position.copy()


def test_goals_that_came_while_the_process_was_late_meet_the_joints_where_they_were(op3: Robot) -> None:
    """Regression: after a stall they were followed and judged where the joints were by then.

    On a busy machine a run in simulation reported up to 104 goals outside the envelope.
    """
    punctual = sway(SimProcess(SimDriver(op3), realtime=False), [4] * 25)
    late = sway(SimProcess(SimDriver(op3), realtime=False), [4] * 5 + [40] + [4] * 10)
    np.testing.assert_allclose(late, punctual, atol=1e-12)
