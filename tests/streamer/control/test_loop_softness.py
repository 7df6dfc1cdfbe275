"""The loop with plans that ask for less stiffness: applied and recorded, and gone where the robot holds or stops."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.spatial.transitions import minimum_jerk
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import PlanBuffer, Ticket
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.control.tick_row import TickRow

SHARE = 0.3


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def retargeter(op3: Robot) -> Retargeter:
    return Retargeter(op3, load_stream())


@pytest.fixture
def loop(op3: Robot, retargeter: Retargeter) -> Iterator[ControlLoop]:
    """A robot that stands and waits for its first plan."""
    with SimDriver(op3, options=SimOptions()) as driver:
        plans = PlanBuffer(op3.n, retargeter.layout.size, retargeter.horizon, op3.rate_hz)
        made = ControlLoop(op3, driver, retargeter, plans, Telemetry(op3.n, op3.rate_hz))
        made.inputs.start = True
        while not made.ready:
            run(made, 1)
        yield made


def run(loop: ControlLoop, ticks: int) -> None:
    driver = loop.driver
    assert isinstance(driver, SimDriver)
    for _ in range(ticks):
        loop.tick()
        driver.advance(0.008)


def arms(robot: Robot) -> list[int]:
    return [joint for side in ("left", "right") for joint in robot.chain(f"{side}_arm").values()]


def play(loop: ControlLoop, retargeter: Retargeter, share: float, lifts: float = 0.0) -> None:
    """Offer a plan whose arms follow with a share of their stiffness; its last rows are stiff, as those of every plan.

    From row 40 on the left shoulder turns by `lifts` within half a second.
    """
    plan = retargeter.plan(retargeter.standing(), default_clip()[:32], 0, loop.tick_count)
    stiffness, shoulder = np.ones_like(plan.q), loop.robot.index("l_sho_pitch")
    stiffness[:-40, arms(loop.robot)] = share
    plan.q[:, shoulder] += lifts * minimum_jerk((np.arange(len(plan)) - 40.0) / 60.0)
    ticket = Ticket(1, 0, loop.tick_count, 0, 0, -1, False, False, False, 0.001, 0.02)
    loop.intake.plans.publish(ticket, replace(plan, stiffness=stiffness))


def test_the_share_that_acts_is_recorded_and_the_robot_holds_with_all_of_it(
    loop: ControlLoop, op3: Robot, retargeter: Retargeter
) -> None:
    play(loop, retargeter, SHARE)
    while loop.ladder.state is not State.HOLD:
        run(loop, 1)
    run(loop, 20)
    rows = TickRow(loop.telemetry.ticks.reader().read())
    own, legs = arms(op3), np.setdiff1d(np.arange(op3.n), arms(op3))
    sent = np.isfinite(rows.q_cmd).all(axis=1)
    stiffness = rows.stiffness[sent]
    assert stiffness[:, own].min() == pytest.approx(SHARE) and (stiffness[:, legs] == 1.0).all()
    assert (stiffness[-1] == 1.0).all() and np.isnan(rows.stiffness[~sent]).all()
    assert np.abs(np.diff(stiffness, axis=0)).max() < 0.05
    assert loop.driver.violations == 0


def test_an_emergency_stop_freezes_the_goals_that_the_servos_hold(
    loop: ControlLoop, op3: Robot, retargeter: Retargeter
) -> None:
    play(loop, retargeter, SHARE)
    run(loop, 60)
    assert loop.servo.softness.share[arms(op3)].max() < 0.5
    goals = loop.command.position.copy()
    loop.inputs.estop = True
    run(loop, 1)
    np.testing.assert_array_equal(loop.command.position, goals)
    np.testing.assert_array_equal(loop.servo.softness.share, 1.0)
    before = goals
    while loop.ladder.state is not State.OFF and loop.ladder.state is not State.FAULT:
        run(loop, 1)
        # Parking begins at the goals in effect.
        assert np.abs(loop.command.position - before)[arms(op3)].max() < np.radians(3.0)
        before = loop.command.position.copy()


@pytest.mark.parametrize("share", [SHARE, 1.0])
def test_a_blocked_arm_is_found_however_soft_it_is(
    loop: ControlLoop, op3: Robot, retargeter: Retargeter, share: float
) -> None:
    """Soft goals alone would never ask for the torque by which a joint that is held is recognised."""
    driver = loop.driver
    assert isinstance(driver, SimDriver)
    play(loop, retargeter, share, lifts=-0.8)
    run(loop, 40)
    driver.block(op3.index("l_sho_pitch"), True)
    for _ in range(150):
        run(loop, 1)
        if loop.ladder.fault is not None:
            break
    assert loop.ladder.fault is not None and "does not follow its goals" in loop.ladder.fault
