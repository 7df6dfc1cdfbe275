"""A control loop that fails lowers the robot before its torque goes off."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import Driver, JointCommand
from flexmotion.drivers.registry import create
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.servo_command import ServoCommand
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.blind_lowering import blind_lowering
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ...virtual_time import virtual_time

Float = NDArray[np.float64]

FAILS_AT = 250
"""Update of the estimator that fails."""


def test_goals_hold_then_lower_a_standing_robot() -> None:
    op3 = load_robot("op3")
    goals = list(blind_lowering(op3, op3.stand_pose))
    held = round(op3.safety.lost_bus_hold_s * op3.rate_hz)
    np.testing.assert_array_equal(goals[held - 1], op3.stand_pose)
    np.testing.assert_allclose(goals[-1], op3.rest_pose)
    fastest = np.abs(np.diff(goals, axis=0)).max() * op3.rate_hz
    assert fastest < 2.1 * op3.safety.soft_start_speed
    with SimDriver(op3, options=SimOptions()) as driver:
        driver.set_torque(True)
        height, command = driver.torso_height, JointCommand(op3.n)
        for goal in goals:
            command.position[:] = goal
            driver.write(command)
            driver.advance(1 / op3.rate_hz)
        assert driver.torso_up > np.cos(np.radians(45)) and driver.torso_height < 0.8 * height


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> Session:
    """A run whose estimator fails at an update."""
    op3, update, updates = load_robot("op3"), Estimator.update, [0]

    def fails(self: Estimator, *arguments: object) -> None:
        updates[0] += 1
        if updates[0] == FAILS_AT:
            raise ValueError("no such foot")
        update(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Estimator, "update", fails)
    source = ClipSource(default_clip())
    return Session(op3, create("sim", op3), source, load_stream(), realtime=False, clock="real", stay=True)


def test_kill_ends_the_lowering_of_a_loop_that_failed(failing: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """KILL did nothing for three seconds, and a run that was told to end at once left its robot stiff."""
    goals = blind_lowering

    def killed(robot: Robot, goal: Float) -> Iterator[Float]:
        for tick, one in enumerate(goals(robot, goal)):
            if tick == 20:
                failing.request(Request.KILL)
            yield one

    monkeypatch.setattr("flexmotion.streamer.run.loop_process.blind_lowering", killed)
    with virtual_time(), pytest.raises(Exception, match="the control loop failed"):
        failing.run()
    assert np.count_nonzero(failing.record.state == State.PARK) == 20


def test_a_loop_that_raises_leaves_a_lowered_robot(failing: Session) -> None:
    """Torque was cut at once, and a standing robot fell."""
    with virtual_time(), pytest.raises(Exception, match="the control loop failed: ValueError: no such foot"):
        failing.run()
    record, op3 = failing.record, failing.robot
    told = [event.message for event in record.events if "the robot is lowered without measurements" in event.message]
    assert len(told) == 1 and " -> PARK: the control loop failed: ValueError: no such foot" in told[0]
    lowered = record.state == State.PARK
    seconds = np.count_nonzero(lowered) / op3.rate_hz
    assert seconds > op3.safety.lost_bus_hold_s + op3.safety.park_s - 0.1
    np.testing.assert_allclose(record.q_cmd[-1], op3.rest_pose, atol=1e-6)


def test_a_loop_that_fails_before_its_first_goal_sends_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Torque was on, no goal had been made, and the robot was sent to the zero of every joint within one tick."""

    def fails(self: ServoCommand, position: Float) -> None:
        raise ValueError("no such servo")

    monkeypatch.setattr(ServoCommand, "reset", fails)
    op3 = load_robot("op3")
    session = Session(op3, create("sim", op3), ClipSource(default_clip()), load_stream(), realtime=False, clock="real")
    with virtual_time(), pytest.raises(Exception, match="the control loop failed: ValueError: no such servo"):
        session.run()
    record = session.record
    assert np.isnan(record.q_cmd).all() and not (record.state == State.PARK).any()
    assert not [event for event in record.events if "lowered" in event.message]


def test_a_servo_that_was_held_is_lowered_from_where_it_stopped(
    failing: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Goals of the lowering began at the last goal, which a servo behind its tripped watchdog had refused."""
    arm, held, whole = failing.robot.index("l_el"), 0.1, []

    def take_pins(_self: Driver, goal: Float) -> None:
        if np.isfinite(goal).all():  # all goals are given as torque goes on, and again for the lowering
            whole.append(goal)
            if len(whole) == 2:
                goal[arm] = held

    monkeypatch.setattr(Driver, "take_pins", take_pins)
    with virtual_time(), pytest.raises(Exception, match="the control loop failed"):
        failing.run()
    lowered = failing.record.q_cmd[failing.record.state == State.PARK, arm]
    assert lowered[0] == held and abs(lowered[-1] - failing.robot.rest_pose[arm]) < 1e-6
