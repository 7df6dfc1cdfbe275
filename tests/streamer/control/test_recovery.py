"""After a disturbance, and at the start of a stream, goals come back to the plan at a bounded speed."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.servo_command import DECAY_SHARE, ServoCommand
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.session import Session

SECONDS = 1.5


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


def run(op3: Robot) -> RunTrace:
    driver = SimDriver(op3, options=SimOptions())
    return Session(op3, driver, ClipSource(choose_motion()), load_stream(), SECONDS).run()


def test_a_stream_begins_without_a_jump(op3: Robot) -> None:
    """Both shoulders jumped 14 degrees in two ticks at every normal start."""
    record = run(op3)
    first = int(np.argmax(record.state == State.STREAMING))
    steps = np.degrees(np.abs(np.diff(record.q_cmd[first - 1 : first + 20], axis=0)))
    assert steps.max() < 1.7


def test_a_stall_of_the_loop_leaves_no_jump(op3: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """After 250 ms without a tick a goal jumped by 11 degrees."""
    tick, stalled = ControlLoop.tick, []

    def late(self: ControlLoop, late_ns: int = 0) -> None:
        if self.ladder.state is State.STREAMING and self.intake.plan is not None and not stalled:
            since = self.tick_count - self.intake.plan.start_tick
            if since == 30:
                stalled.append(self.command.position.copy())
                self.tick_count += 31
                self.driver.advance(31 / op3.rate_hz)  # type: ignore[attr-defined]
        tick(self, late_ns)
        if len(stalled) == 1:
            stalled.append(self.command.position.copy())

    monkeypatch.setattr(ControlLoop, "tick", late)
    run(op3)
    before, after = stalled
    assert np.degrees(np.abs(after - before).max()) < 1.0


def test_an_offset_decays_also_where_every_tick_is_late(op3: Robot) -> None:
    """Each late tick began the way from the goals in effect anew: a starved loop never came back to its reference."""
    command, state, zero = ServoCommand(op3, 0.004), RobotState(op3.n), np.zeros(op3.n)
    state.position[:], state.voltage[:] = op3.stand_pose, op3.nominal_voltage
    command.reset(op3.stand_pose + 0.1)
    most, goals = DECAY_SHARE * op3.no_load_speed / op3.rate_hz, []
    for _ in range(20):
        command.rejoin()
        goals.append(command.update(op3.stand_pose, zero, zero, state).copy())
    np.testing.assert_allclose(goals[0], op3.stand_pose + 0.1)
    assert (np.abs(np.diff(goals, axis=0)) <= most + 1e-12).all()
    assert (np.abs(goals[-1] - op3.stand_pose) <= most).all()


def test_an_offset_decays_at_a_bounded_speed_and_no_other_goal_is_bound(op3: Robot) -> None:
    command, state, zero = ServoCommand(op3, 0.004), RobotState(op3.n), np.zeros(op3.n)
    state.position[:], state.voltage[:] = op3.stand_pose, op3.nominal_voltage
    command.reset(op3.stand_pose + 0.1)
    command.rejoin()
    most = DECAY_SHARE * op3.no_load_speed / op3.rate_hz
    goals = [command.update(op3.stand_pose, zero, zero, state).copy() for _ in range(20)]
    np.testing.assert_allclose(goals[0], op3.stand_pose + 0.1)
    assert (np.abs(np.diff(goals, axis=0)) <= most + 1e-12).all()
    np.testing.assert_allclose(goals[-1], op3.stand_pose)
    torque = 0.5 * op3.usable_torque  # of a plan: 25 rad/s of goal are normal
    moved = command.update(op3.stand_pose, zero, torque, state) - goals[-1]
    np.testing.assert_allclose(moved, torque / op3.kp)


def test_after_a_pin_goals_begin_there_and_step_by_no_more_than_an_offset_decays(op3: Robot) -> None:
    """Without it the servo went to the newest goal in one tick, and no test saw it."""
    command, state, zero = ServoCommand(op3, 0.004), RobotState(op3.n), np.zeros(op3.n)
    state.voltage[:] = op3.nominal_voltage
    command.reset(op3.stand_pose)
    knee, pins = op3.index("l_knee"), np.full(op3.n, np.nan)
    pins[knee] = op3.stand_pose[knee] + 0.1
    np.copyto(state.position, np.where(np.isfinite(pins), pins, op3.stand_pose))
    command.take_pins(pins)
    goals = [command.update(op3.stand_pose, zero, zero, state).copy() for _ in range(20)]
    assert goals[0][knee] == pytest.approx(pins[knee])
    most = DECAY_SHARE * op3.no_load_speed / op3.rate_hz
    assert (np.abs(np.diff(goals, axis=0)) <= most + 1e-12).all()
    np.testing.assert_allclose(goals[-1], op3.stand_pose)


def test_a_reference_that_is_no_number_holds_a_joint_for_one_tick_alone(op3: Robot) -> None:
    """It stayed in the offset: the joint took no goal any more."""
    command, state, zero = ServoCommand(op3, 0.004), RobotState(op3.n), np.zeros(op3.n)
    state.position[:], state.voltage[:] = op3.stand_pose, op3.nominal_voltage
    command.reset(op3.stand_pose + 0.1)
    command.rejoin()
    command.update(op3.stand_pose, zero, zero, state)
    knee, broken = op3.index("l_knee"), op3.stand_pose.copy()
    broken[knee] = np.nan
    held = command.update(broken, zero, zero, state).copy()
    assert np.isfinite(held).all()
    goals = [command.update(op3.stand_pose, zero, zero, state).copy() for _ in range(40)]
    np.testing.assert_allclose(goals[-1], op3.stand_pose)


def test_a_joint_that_answers_again_elsewhere_does_not_move_its_goal_at_once(op3: Robot) -> None:
    """After half replies four joints jumped 19 degrees in two ticks."""
    command, state, zero = ServoCommand(op3, 0.004), RobotState(op3.n), np.zeros(op3.n)
    state.position[:], state.voltage[:] = op3.stand_pose, op3.nominal_voltage
    command.reset(op3.stand_pose)
    goal = command.update(op3.stand_pose, zero, zero, state).copy()
    knee, expected = op3.index("l_knee"), np.full(op3.n, np.nan)
    expected[knee] = state.position[knee]
    state.position[knee] += 0.16
    after = command.update(op3.stand_pose, zero, zero, state, expected).copy()
    assert abs(after[knee] - goal[knee]) < np.radians(1.7)
    blind = 0.5 * op3.usable_torque[knee] / op3.kp[knee]
    assert blind < 0.16  # without it the goal would have followed
