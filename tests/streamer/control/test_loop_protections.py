"""The loop with servos that have held a goal of their own, and with an IMU that lies before the robot has stood up."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.servo_command import DECAY_SHARE
from flexmotion.streamer.control.telemetry import Telemetry, events

Float = NDArray[np.float64]
MOST_TICKS = 2000
"""Bound against hanging."""


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture
def loop(op3: Robot) -> Iterator[ControlLoop]:
    retargeter = Retargeter(op3, load_stream())
    with SimDriver(op3, options=SimOptions()) as driver:
        plans = PlanBuffer(op3.n, retargeter.layout.size, retargeter.horizon, op3.rate_hz)
        yield ControlLoop(op3, driver, retargeter, plans, Telemetry(op3.n, op3.rate_hz))


def run(loop: ControlLoop, until: Callable[[], bool], **requests: bool) -> list[Float]:
    """Tick until it holds, the requests in the first tick; the goals of every tick."""
    goals: list[Float] = []
    for name, value in requests.items():
        setattr(loop.inputs, name, value)
    while not until() or not goals:
        assert len(goals) < MOST_TICKS, "the condition never held"
        loop.tick()
        goals.append(loop.command.position.copy())
        loop.driver.advance(0.008)  # type: ignore[attr-defined]
    return goals


@pytest.fixture
def pins(loop: ControlLoop, monkeypatch: pytest.MonkeyPatch) -> dict[int, float]:
    """Pins that the driver reports in the next tick, by joint."""
    pinned: dict[int, float] = {}

    def take_pins(goal: Float) -> None:
        for joint, angle in pinned.items():
            goal[joint] = angle
        pinned.clear()

    monkeypatch.setattr(loop.driver, "take_pins", take_pins)
    return pinned


def test_a_servo_that_was_held_goes_back_to_the_plan_at_a_bounded_speed(
    loop: ControlLoop, op3: Robot, pins: dict[int, float]
) -> None:
    """Goals that began at the newest goal, as if nothing had been held, passed every test."""
    run(loop, lambda: loop.ready, start=True)
    arm, most = op3.index("l_el"), DECAY_SHARE * op3.no_load_speed / op3.rate_hz
    goal = loop.command.position[arm]
    pins[arm] = goal - 0.1
    goals = [each[arm] for each in run(loop, lambda: abs(loop.command.position[arm] - goal) < 1e-3)]
    assert goals[0] == pytest.approx(goal - 0.1, abs=1e-9)
    assert np.abs(np.diff(goals)).max() <= 1.01 * most[arm] and len(goals) >= 0.1 / most[arm]


def test_a_frozen_robot_holds_a_servo_where_it_stopped(loop: ControlLoop, op3: Robot, pins: dict[int, float]) -> None:
    """After an E-STOP a servo that had been held was sent to its frozen goal in one step, and back as PARK began."""
    run(loop, lambda: loop.ready, start=True)
    run(loop, lambda: loop.ladder.state is State.HOLD, estop=True)
    arm, most = op3.index("l_el"), 2 * op3.safety.soft_start_speed
    held = pins[arm] = loop.command.position[arm] - 0.1
    frozen = run(loop, lambda: loop.ladder.state is State.PARK)
    assert len(frozen) > 10
    parked = run(loop, lambda: loop.ladder.state is State.FAULT)
    assert [goals[arm] for goals in frozen[:-1]] == [held] * (len(frozen) - 1)
    steps = np.abs(np.diff([goals[arm] for goals in (*frozen, *parked)]))
    assert steps.max() <= max(most, DECAY_SHARE * op3.no_load_speed[arm]) / op3.rate_hz + 1e-9


def test_a_joint_that_is_pulled_away_from_its_frozen_goal_is_sent_no_goal_outside_the_envelope(
    loop: ControlLoop, op3: Robot
) -> None:
    """Frozen goals were sent as they were, also for joints that something moved.

    A robot fell while it was frozen: its goals, sent again, implied 1.02 of a knee's stall torque. Here an arm is
    turned against the torso by more and more, up to more than its servo holds.
    """
    driver, arm = loop.driver, op3.index("l_sho_pitch")
    assert isinstance(driver, SimDriver)
    run(loop, lambda: loop.ready, start=True)
    run(loop, lambda: loop.ladder.state is State.HOLD, estop=True)
    frozen, force = loop.command.position.copy(), driver.data.xfrc_applied
    arm_id, step = driver.model.body("l_sho_pitch_link").id, op3.stall_torque[arm] / 40

    def parks() -> bool:
        force[arm_id, 4] += step
        force[driver.model.body("body_link").id, 4] -= step
        return loop.ladder.state is State.PARK

    sent = np.array(run(loop, parks))[:-1]
    assert abs(driver.position[arm] - frozen[arm]) > 0.3
    assert driver.violations == 0
    others = np.arange(op3.n) != arm
    assert len(sent) > 30 and (sent[:30] == frozen).all() and (sent[:, others] == frozen[others]).all()


def lying(read: Callable[[RobotState], None]) -> Callable[[RobotState], None]:
    """A driver's `read` with an IMU that measures 4 g too much."""

    def lies(state: RobotState) -> None:
        read(state)
        state.accel += 40.0

    return lies


def test_an_imu_that_lies_while_the_robot_stands_up_ends_the_start(
    loop: ControlLoop, op3: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OP3 does not require its IMU: it stood up with one that measured 5 g, and walked on without fall detection."""
    monkeypatch.setattr(loop.driver, "read", lying(loop.driver.read))
    run(loop, lambda: loop.ladder.state in (State.FAULT, State.STREAMING) or loop.ready, start=True)
    assert loop.ladder.state is State.FAULT and loop.hardware_failed
    told = [event.message for event in events(loop.telemetry.events.reader())]
    assert told[0] == "OFF -> READY"
    assert any("READY -> PARK: the IMU measures what cannot be: " in message for message in told)


def test_an_imu_that_lied_before_is_held_against_the_start(
    loop: ControlLoop, op3: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(loop.driver, "read", lying(loop.driver.read))
        run(loop, lambda: loop.tick_count > 100)
        run(loop, lambda: True, start=True)
        (event,) = events(loop.telemetry.events.reader())
        assert event.message.startswith("no start: the IMU measures what cannot be: ")
        assert loop.ladder.state is State.OFF and loop.hardware_failed
    run(loop, lambda: loop.tick_count > 800)
    run(loop, lambda: loop.ladder.state is State.READY, start=True)
