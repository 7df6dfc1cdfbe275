"""A robot that bows deeper than an upright one may be tilted: it is no fall until it goes beyond its plan."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.robot.bows import bowing, pull_imu
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.human.motion import Motion
from flexmotion.spatial.tilt import tilt_of
from flexmotion.streamer import api
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_totals import toppled
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

BOWED_S = 2.4
"""When the human of `bow` is deep in it [s]."""


@pytest.fixture(scope="module")
def bow() -> Motion:
    """A human who bows to 80 degrees within a second."""
    return bowing(80.0, 1.0)


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


def following(robot: Robot, bow: Motion) -> Session:
    source = ClipSource(bow)
    return Session(robot, SimDriver(robot), source, load_stream(), source.seconds)


def until(session: Session, second: float) -> None:
    """Step to a second of the human's motion [s]."""
    while not session.record.used or not session.record.source_s[-1] >= second:
        assert session.step()


def simulated(session: Session) -> SimDriver:
    driver = session.driver
    assert isinstance(driver, SimDriver)
    return driver


def to_the_end(session: Session) -> RunTrace:
    while session.step():
        pass
    return session.record


def test_a_bow_beyond_the_tilt_of_a_fall_is_played_to_its_end(op3: Robot, bow: Motion) -> None:
    """A robot that can bow to 79° bowed to 40: any tilt of more than 45° ended the run as a fall."""
    session = following(op3, bow)
    record = session.run()
    deepest = float(np.nanmax(tilt_of(record.true_base[:, 3:])))
    assert op3.safety.fall_tilt + 0.3 < deepest < op3.safety.most_tilt + 0.1
    assert State.FAULT not in record.state and not toppled(record.true_base, record.base_ref).any()
    assert record.violations_sent == 0


@pytest.mark.parametrize("request_", [Request.STOP, Request.ESTOP, Request.DISARM])
def test_a_stop_in_a_bow_is_no_fall(op3: Robot, bow: Motion, request_: Request) -> None:
    """Parked out of an emergency stop the robot has no plan any more, and is still tilted by more than 45°."""
    with following(op3, bow) as session:
        until(session, BOWED_S)
        session.ask(request_)
        record = to_the_end(session)
    held = ~np.isin(record.state, (State.OFF, State.FAULT))
    assert State.DAMPED not in record.state
    assert not toppled(record.true_base, record.base_ref)[held].any()
    assert not any("fall" in event.message for event in record.events)


def test_a_robot_that_is_thrown_over_in_a_bow_gives_way_before_it_lies(op3: Robot, bow: Motion) -> None:
    with following(op3, bow) as session:
        until(session, BOWED_S)
        simulated(session).push((4.0, 0.0, 0.0), 0.1)
        record = to_the_end(session)
    noticed = int(np.argmax(record.state == State.DAMPED))
    assert noticed > 0 and tilt_of(record.true_base[noticed, 3:]) < np.radians(85.0)
    assert any("fall" in event.message for event in record.events)


def test_a_robot_that_falls_while_it_parks_out_of_a_bow_is_noticed(op3: Robot, bow: Motion) -> None:
    """The bow's plan counted until it had parked: thrown ahead it lay at 63°, and was parked on under torque."""
    with following(op3, bow) as session:
        until(session, BOWED_S)
        session.ask(Request.ESTOP)
        session.advance(2.2)
        simulated(session).push((2.0, 0.0, 0.0), 0.1)
        record = to_the_end(session)
    noticed = int(np.argmax(record.state == State.DAMPED))
    assert noticed > 0 and tilt_of(record.true_base[noticed, 3:]) < np.radians(60.0)
    assert toppled(record.true_base, record.base_ref)[: noticed + 1].any()


def test_a_bow_without_an_imu_goes_on(op3: Robot, bow: Motion) -> None:
    """The speed of the bow itself counted as a sway: a robot that lost its IMU was dropped in one of three moments."""
    for second in (1.6, 1.8, 3.4):
        with following(op3, bow) as session:
            until(session, second)
            pull_imu(simulated(session))
            record = to_the_end(session)
        assert State.DAMPED not in record.state


def test_the_report_counts_no_fall_in_a_bow_that_was_forgotten(op3: Robot, bow: Motion) -> None:
    """The totals of a long run have a rule of their own, which counted every bow."""
    session = following(op3, bow)
    record = session.run()
    half = int(np.argmax(record.source_s >= BOWED_S))
    record.totals.fold(TickRow(record.rows[:half]))
    record.totals.fold(TickRow(record.rows[half:]))
    assert record.totals.fall_tick is None


def test_a_robot_that_is_stopped_at_once_in_a_bow_keeps_its_arms_off_its_thighs() -> None:
    """It went straight to its rest pose: forearms between trunk and thighs were pressed into them by 3 N·m."""
    with api.open_session("op3", seed=1) as session:
        session.advance(3.0)
        session.send(Text("take a deep bow"))
        session.advance(1.0)
        session.ask(Request.ESTOP)
        session.finish()
        record = session.record
    assert tilt_of(record.true_base[:, 3:]).max() > 0.9 and record.state[-1] == State.FAULT
    assert not record.true_self_contact.any() and not record.hung.any()
