"""The loop by itself: ticks with no plan, with a late plan, and with an operator's requests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.spatial.transitions import minimum_jerk
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import PlanBuffer, Ticket
from flexmotion.streamer.control.servo_command import STOPPED_SHARE
from flexmotion.streamer.control.telemetry import Telemetry, events
from flexmotion.streamer.control.tick_row import TickRow

MOST_TICKS = 2000
"""Bound against hanging."""


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def retargeter(op3: Robot) -> Retargeter:
    return Retargeter(op3, load_stream())


@pytest.fixture
def loop(op3: Robot, retargeter: Retargeter) -> Iterator[ControlLoop]:
    with SimDriver(op3, options=SimOptions()) as driver:
        plans = PlanBuffer(op3.n, retargeter.layout.size, retargeter.horizon, op3.rate_hz)
        yield ControlLoop(op3, driver, retargeter, plans, Telemetry(op3.n, op3.rate_hz))


@pytest.fixture
def run(loop: ControlLoop) -> Callable[..., None]:
    """Function (ticks, request=True ...) -> that many ticks, the requests made in the first of them."""

    def go(ticks: int, **requests: bool) -> None:
        for name, value in requests.items():
            setattr(loop.inputs, name, value)
        for _ in range(ticks):
            loop.tick()
            loop.driver.advance(0.008)

    return go


@pytest.fixture
def until(loop: ControlLoop, run: Callable[..., None]) -> Callable[[Callable[[], bool]], None]:
    """Function (condition) -> ticks until it holds."""

    def go(condition: Callable[[], bool]) -> None:
        end = loop.tick_count + MOST_TICKS
        while not condition():
            assert loop.tick_count < end, "the condition never held"
            run(1)

    return go


@pytest.fixture
def ready(loop: ControlLoop, run: Callable[..., None], until: Callable[..., None]) -> None:
    """Lets the robot stand up and wait for a plan."""
    run(1, start=True)
    until(lambda: loop.ready)


def plan_at(retargeter: Retargeter, tick: int) -> Plan:
    return retargeter.plan(retargeter.standing(), default_clip()[:32], 0, tick)


def offer(loop: ControlLoop, plan: Plan, *, resumed: int = 0, stops: bool = False) -> Plan:
    """Publish a plan to the loop."""
    ticket = Ticket(
        id=loop.intake.plans.newest_id + 1,
        resumed=resumed,
        asked_tick=loop.tick_count,
        target=0,
        target_ns=0,
        effect_row=-1,
        partial=False,
        stops=stops,
        source_over=False,
        sample_s=0.001,
        retarget_s=0.02,
    )
    loop.intake.plans.publish(ticket, plan)
    return plan


def soft_plan(robot: Robot, retargeter: Retargeter, tick: int, share: float, lifts: float = 0.0) -> Plan:
    """A plan whose arms follow with a share of their stiffness; its last rows are stiff, as those of every plan.

    From row 40 on the left shoulder turns by `lifts` within half a second.
    """
    plan = plan_at(retargeter, tick)
    stiffness = np.ones_like(plan.q)
    stiffness[:-40, arms(robot)] = share
    plan.q[:, robot.index("l_sho_pitch")] += lifts * minimum_jerk((np.arange(len(plan)) - 40.0) / 60.0)
    return replace(plan, stiffness=stiffness)


def arms(robot: Robot) -> list[int]:
    return [joint for side in ("left", "right") for joint in robot.chain(f"{side}_arm").values()]


def test_in_off_it_reads_and_sends_nothing(loop: ControlLoop, run: Callable[..., None]) -> None:
    run(20)
    assert loop.ladder.state is State.OFF and loop.tick_count == 20
    rows = TickRow(loop.telemetry.ticks.reader().read())
    assert len(rows.tick) == 20 and np.isnan(rows.q_cmd).all() and np.isfinite(rows.q).all()
    assert events(loop.telemetry.events.reader()) == []


@pytest.mark.usefixtures("ready")
def test_without_a_plan_it_stands_and_waits(loop: ControlLoop, run: Callable[..., None]) -> None:
    run(100)
    assert loop.ready and loop.ladder.state is State.READY
    np.testing.assert_array_equal(loop.now.q, loop.stand_pose)
    assert loop.driver.violations == 0
    assert np.abs(loop.state.position - loop.stand_pose).max() < 0.06


@pytest.mark.usefixtures("ready")
def test_a_waiting_plan_takes_over_at_its_tick(
    loop: ControlLoop, run: Callable[..., None], retargeter: Retargeter
) -> None:
    offer(loop, plan_at(retargeter, loop.tick_count + 5))
    run(5)
    assert loop.intake.plan is None and loop.ladder.state is State.READY
    run(1)
    assert loop.intake.plan is not None and loop.intake.waiting is None
    assert loop.ladder.state is State.STREAMING
    np.testing.assert_array_equal(loop.now.q, loop.intake.plan.q[0])


@pytest.mark.usefixtures("ready")
def test_a_plan_with_no_successor_ends_in_hold_on_its_last_row(
    loop: ControlLoop, run: Callable[..., None], until: Callable[..., None], retargeter: Retargeter
) -> None:
    plan = offer(loop, plan_at(retargeter, loop.tick_count))
    until(lambda: loop.ladder.state is State.HOLD)
    run(100)
    assert loop.ladder.state is State.HOLD
    np.testing.assert_array_equal(loop.now.q, plan.q[-1])
    assert loop.now.balanced and loop.driver.violations == 0


@pytest.mark.usefixtures("ready")
def test_a_new_plan_leads_from_hold_back_to_streaming(
    loop: ControlLoop, run: Callable[..., None], until: Callable[..., None], retargeter: Retargeter
) -> None:
    plan = offer(loop, plan_at(retargeter, loop.tick_count))
    until(lambda: loop.ladder.state is State.HOLD)
    offer(loop, retargeter.plan(plan.states[-1], None, 0, loop.tick_count), resumed=1)
    run(2)
    assert loop.ladder.state is State.STREAMING


@pytest.mark.usefixtures("ready")
def test_the_stiffness_that_acts_is_recorded_and_the_robot_holds_with_all_of_it(
    loop: ControlLoop, run: Callable[..., None], until: Callable[..., None], retargeter: Retargeter, op3: Robot
) -> None:
    offer(loop, soft_plan(op3, retargeter, loop.tick_count, 0.3))
    until(lambda: loop.ladder.state is State.HOLD)
    run(20)
    rows = TickRow(loop.telemetry.ticks.reader().read())
    own, legs = arms(op3), np.setdiff1d(np.arange(op3.n), arms(op3))
    sent = np.isfinite(rows.q_cmd).all(axis=1)
    stiffness = rows.stiffness[sent]
    assert stiffness[:, own].min() == pytest.approx(0.3) and (stiffness[:, legs] == 1.0).all()
    assert (stiffness[-1] == 1.0).all() and np.isnan(rows.stiffness[~sent]).all()
    assert np.abs(np.diff(stiffness, axis=0)).max() < 0.05
    assert loop.driver.violations == 0


@pytest.mark.usefixtures("ready")
def test_soft_arms_are_frozen_by_an_emergency_stop_and_parked_without_a_jump(
    loop: ControlLoop, run: Callable[..., None], retargeter: Retargeter, op3: Robot
) -> None:
    offer(loop, soft_plan(op3, retargeter, loop.tick_count, 0.3))
    run(60)
    assert loop.servo.softness.share[arms(op3)].max() < 0.5
    goals = loop.command.position.copy()
    run(1, estop=True)
    np.testing.assert_array_equal(loop.command.position, goals)
    np.testing.assert_array_equal(loop.servo.softness.share, 1.0)
    before = goals
    while loop.ladder.state not in (State.OFF, State.FAULT):
        run(1)
        assert np.abs(loop.command.position - before)[arms(op3)].max() < np.radians(3.0)
        before = loop.command.position.copy()


@pytest.mark.parametrize("share", [0.3, 1.0])
@pytest.mark.usefixtures("ready")
def test_a_blocked_arm_is_found_however_soft_it_is(
    loop: ControlLoop, run: Callable[..., None], until: Callable[..., None], retargeter: Retargeter, share: float
) -> None:
    """Soft goals alone would never ask for the torque by which a joint that is held is recognised."""
    robot, driver = loop.robot, loop.driver
    assert isinstance(driver, SimDriver)
    offer(loop, soft_plan(robot, retargeter, loop.tick_count, share, lifts=-0.8))
    run(40)
    driver.block(robot.index("l_sho_pitch"), True)
    until(lambda: loop.ladder.state is not State.STREAMING)
    assert loop.ladder.fault is not None and "does not follow its goals" in loop.ladder.fault


def test_goals_of_a_walk_leave_room_for_the_foot_that_is_about_to_strike(
    loop: ControlLoop, run: Callable[..., None], ready: None, retargeter: Retargeter, op3: Robot
) -> None:
    """The loop foresees the landings of a step, and no goal asks for more once a foot has struck."""
    assert not loop.strikes.change.any()
    plan = offer(loop, retargeter.plan(retargeter.standing(), default_clip()[240:290], 0, loop.tick_count))
    struck = set()
    for _ in range(len(plan)):
        run(1)
        slower, faster = loop.strikes.change
        struck |= {name for name, flexed in (("l_knee", faster), ("r_knee", -slower)) if flexed[op3.index(name)] > 0.1}
        measured = loop.state
        implied = op3.kp * (loop.servo.goal - measured.position) - op3.back_emf * measured.velocity
        per_speed = op3.back_emf + op3.kp * loop.driver.delay_s
        assert (implied - per_speed * faster >= -STOPPED_SHARE * op3.stall_torque - 0.05).all()
        assert (implied - per_speed * slower <= STOPPED_SHARE * op3.stall_torque + 0.05).all()
    assert struck


@pytest.mark.usefixtures("ready")
def test_what_a_strike_would_add_is_left_out_of_the_goals(
    loop: ControlLoop, run: Callable[..., None], retargeter: Retargeter, monkeypatch: pytest.MonkeyPatch
) -> None:
    knee = loop.robot.index("l_knee")

    def implied() -> float:
        measured = loop.state
        made = loop.robot.kp * (loop.servo.goal - measured.position) - loop.robot.back_emf * measured.velocity
        return abs(float(made[knee]))

    def both_ways(_estimator: object) -> None:
        loop.strikes.change[:, knee] = -50.0, 50.0

    offer(loop, plan_at(retargeter, loop.tick_count))
    run(20)
    assert implied() > 0.2  # the knee carries the robot
    monkeypatch.setattr(loop.strikes, "update", both_ways)
    run(1)
    assert implied() < 0.05


@pytest.mark.usefixtures("ready")
def test_a_robot_that_hangs_expects_no_strike(
    loop: ControlLoop, run: Callable[..., None], retargeter: Retargeter, monkeypatch: pytest.MonkeyPatch
) -> None:
    offer(loop, plan_at(retargeter, loop.tick_count))
    run(20)
    monkeypatch.setattr(loop.suspension, "update", lambda *_: False)
    monkeypatch.setattr(loop.suspension, "hung", True)
    loop.strikes.change[1] = 1.0
    run(1)
    assert not loop.strikes.change.any()


@pytest.mark.parametrize("tilt", [0.1, 0.35])
@pytest.mark.usefixtures("ready")
def test_goals_are_those_of_a_robot_in_impacts_once_a_swaying_robot_has_lost_its_imu(
    loop: ControlLoop,
    run: Callable[..., None],
    retargeter: Retargeter,
    monkeypatch: pytest.MonkeyPatch,
    tilt: float,
) -> None:
    """A robot fell, its IMU was not believed any more, and it was taken to be upright: no strike was foreseen.

    The goal of a knee implied 1.01 of its stall torque (benchmarks/robot/pushes, seed 5).
    """
    offer(loop, plan_at(retargeter, loop.tick_count))
    run(20)
    read, update, lost = loop.driver.read, loop.servo.update, False
    expected: list[bool] = []

    def deaf(state: RobotState) -> None:
        read(state)
        state.imu_stale = 100 if lost else 0

    def noted(*reference: Any, impacts: bool, **others: Any) -> np.ndarray:
        expected.append(impacts)
        return update(*reference, impacts=impacts, **others)

    monkeypatch.setattr(loop.driver, "read", deaf)
    monkeypatch.setattr(loop.servo, "update", noted)
    loop.estimator.ahrs.set_quaternion(np.array([np.cos(tilt / 2), 0.0, np.sin(tilt / 2), 0.0]))
    run(1)
    lost = True
    run(3)
    assert not loop.estimator.has_imu
    assert expected == [False, *[tilt > 0.2] * 3]


@pytest.mark.parametrize(("pushed", "frozen"), [(0.0, False), (3.0, False), (3.0, True)])
@pytest.mark.usefixtures("ready")
def test_a_robot_that_loses_its_imu_in_a_fall_gives_way(
    loop: ControlLoop,
    run: Callable[..., None],
    until: Callable[..., None],
    retargeter: Retargeter,
    monkeypatch: pytest.MonkeyPatch,
    pushed: float,
    frozen: bool,
) -> None:
    """It was taken to be as upright as its plan, and struck the ground stiff: no fall was detected.

    Where a leg stopped on the way, it was called blocked, and the robot was frozen for 30 s. One that does not sway
    goes on without its IMU.
    """
    driver = loop.driver
    assert isinstance(driver, SimDriver)
    offer(loop, plan_at(retargeter, loop.tick_count))
    run(20)
    read, begin = driver.read, loop.tick_count

    def deaf(state: RobotState) -> None:
        read(state)
        state.imu_stale = 100

    driver.push((0.0, pushed, 0.0), 0.1)
    until(lambda: loop.estimator.tilt_angle > 0.3 or loop.tick_count > begin + 60)
    monkeypatch.setattr(driver, "read", deaf)
    run(60, estop=frozen)
    if pushed:
        told = [event.message for event in events(loop.telemetry.events.reader())]
        assert any(message.startswith("STREAMING -> HOLD: e-stop") for message in told) is frozen
        cause = "e-stop: " if frozen else "fall: the robot swayed"
        assert loop.ladder.fault is not None and loop.ladder.fault.startswith(cause)
        assert loop.ladder.state is State.DAMPED
    else:
        assert loop.ladder.state in (State.STREAMING, State.HOLD) and loop.ladder.fault is None


@pytest.mark.usefixtures("ready")
def test_a_frozen_robot_expects_no_joint_to_move_on_by_an_answer_to_a_push(
    loop: ControlLoop, run: Callable[..., None], until: Callable[..., None], retargeter: Retargeter
) -> None:
    """Regression: the rate of an answer stayed, and joints of a lost bus were believed to run to their limits."""
    offer(loop, plan_at(retargeter, loop.tick_count))
    until(lambda: loop.ladder.state is State.STREAMING)
    run(20)
    for answer in (loop, loop.correction):
        answer.offset[:] = 0.2
    loop.offset_speed[:] = loop.correction.speed[:] = 4.8
    loop.correction.acts = True
    run(1, estop=True)
    assert loop.ladder.state is State.HOLD
    assert not loop.offset.any() and not loop.offset_speed.any() and not loop.correction.acts


@pytest.mark.parametrize("plan", [False, True])
@pytest.mark.usefixtures("ready")
def test_estop_freezes_the_last_goals(
    loop: ControlLoop, run: Callable[..., None], until: Callable[..., None], retargeter: Retargeter, plan: bool
) -> None:
    if plan:
        offer(loop, plan_at(retargeter, loop.tick_count))
        until(lambda: loop.ladder.state is State.STREAMING)
        run(60)
    goals = loop.command.position.copy()
    run(1, estop=True)
    while loop.ladder.state is not State.PARK:
        assert loop.ladder.state is State.HOLD
        np.testing.assert_array_equal(loop.command.position, goals)
        run(1)
    assert loop.intake.plan is None


def test_requests_hold_for_one_tick(loop: ControlLoop, run: Callable[..., None]) -> None:
    run(1, start=True, stop=True)
    assert not (loop.inputs.start or loop.inputs.stop)


def test_after_a_fault_it_starts_again_once_cleared(loop: ControlLoop, run: Callable[..., None]) -> None:
    run(1, start=True)
    run(5)
    run(2, kill=True)
    run(1, start=True)
    assert loop.ladder.state is State.FAULT
    run(1, clear=True)
    run(1, start=True)
    assert loop.ladder.state is State.READY


@pytest.mark.parametrize(
    ("late", "resumed", "reason"),
    [(1, 0, "it is late"), (-5, 7, "it resumes a plan that never played"), (-5, 1, "it resumes no plan of this run")],
)
@pytest.mark.usefixtures("ready")
def test_a_plan_that_does_not_fit_is_never_played(
    loop: ControlLoop, run: Callable[..., None], retargeter: Retargeter, late: int, resumed: int, reason: str
) -> None:
    offer(loop, plan_at(retargeter, loop.tick_count - late), resumed=resumed)
    run(20)
    assert loop.intake.plan is None and loop.ladder.state is State.READY, reason
    assert loop.telemetry.row.late_plans == (late > 0)


def later_part(plan: Plan, tick: int) -> Plan:
    """The same motion as a plan of its own, from a tick on."""
    row = tick - plan.start_tick
    parts = {field.name: getattr(plan, field.name) for field in fields(plan)}
    rows = {name: part[row:] for name, part in parts.items() if isinstance(part, np.ndarray) and len(part) == len(plan)}
    repairs = {kind: part[row:] for kind, part in plan.repairs.items()}
    return replace(plan, start_tick=tick, stop_row=plan.stop_row - row, repairs=repairs, **rows)


@pytest.mark.parametrize(("late", "played"), [(0, True), (1, True), (2, False)])
@pytest.mark.usefixtures("ready")
def test_a_plan_that_comes_a_tick_late_goes_on_as_if_on_time(
    loop: ControlLoop,
    run: Callable[..., None],
    retargeter: Retargeter,
    late: int,
    played: bool,
) -> None:
    """It was made again and joined 30 ms later. Begun at the goals before, a moving arm stood still for a tick."""
    first = offer(loop, soft_plan(loop.robot, retargeter, loop.tick_count, 1.0, lifts=-1.4))
    run(70)
    joint = loop.robot.index("l_sho_pitch")
    assert abs(loop.now.q[joint] - first.q[loop.tick_count - 2 - first.start_tick, joint]) > np.radians(2.0)
    again = later_part(first, loop.tick_count - late)
    offer(loop, again, resumed=1)
    for _ in range(20):
        row = loop.tick_count - first.start_tick
        run(1)
        np.testing.assert_array_equal(loop.now.q, first.q[row])
        assert not loop.servo.offset.any()
    assert loop.intake.playing is not None and (loop.intake.playing.ticket.id == 2) == played
    assert loop.telemetry.row.late_plans == (not played)


@pytest.mark.parametrize("elsewhere", ["joint", "contact"])
@pytest.mark.usefixtures("ready")
def test_a_late_plan_that_is_elsewhere_already_is_refused(
    loop: ControlLoop, run: Callable[..., None], retargeter: Retargeter, elsewhere: str
) -> None:
    first = offer(loop, plan_at(retargeter, loop.tick_count))
    run(40)
    plan = later_part(first, loop.tick_count - 1)
    if elsewhere == "joint":
        plan.q[1, 3] += np.radians(3.0)
    else:
        plan.contacts[1] = (True, False)
    offer(loop, plan, resumed=1)
    run(1)
    assert loop.intake.playing is not None and loop.intake.playing.ticket.id == 1
    assert loop.telemetry.row.late_plans == 1


@pytest.mark.usefixtures("ready")
def test_after_a_stop_only_a_plan_that_stops_is_accepted(
    loop: ControlLoop, run: Callable[..., None], retargeter: Retargeter
) -> None:
    first = offer(loop, plan_at(retargeter, loop.tick_count))
    run(20, stop=False)
    run(1, stop=True)
    state = first.states[loop.tick_count + 5 - first.start_tick]
    offer(loop, retargeter.plan(state, default_clip()[:32], 0, loop.tick_count + 5), resumed=1)
    run(10)
    assert loop.intake.playing is not None and loop.intake.playing.ticket.id == 1
    state = first.states[loop.tick_count + 5 - first.start_tick]
    offer(loop, retargeter.plan(state, None, 0, loop.tick_count + 5), resumed=1, stops=True)
    run(10)
    assert loop.intake.playing.ticket.id == 3


@pytest.mark.usefixtures("ready")
def test_a_plan_without_successor_is_counted_and_warned_of(
    loop: ControlLoop, run: Callable[..., None], retargeter: Retargeter
) -> None:
    plan = offer(loop, plan_at(retargeter, loop.tick_count))
    run(len(plan))
    assert loop.telemetry.row.underruns == 1
    warnings = [event.message for event in events(loop.telemetry.events.reader()) if event.kind == "warning"]
    assert warnings == ["no plan followed plan 1: its own stop is played"]


@pytest.mark.usefixtures("ready")
def test_a_stop_drops_a_plan_that_waits_in_hold(
    loop: ControlLoop, run: Callable[..., None], until: Callable[..., None], retargeter: Retargeter
) -> None:
    """The robot began to walk after STOP: in HOLD a plan played that had been accepted before."""
    plan = offer(loop, retargeter.plan(retargeter.standing(), None, 0, loop.tick_count), stops=True)
    until(lambda: loop.ladder.state is State.HOLD)
    offer(loop, retargeter.plan(plan.states[-1], default_clip()[240:290], 0, loop.tick_count + 4), resumed=1)
    run(1)
    assert loop.intake.waiting is not None
    run(1, stop=True)
    run(30)
    assert loop.ladder.state is State.HOLD and loop.intake.waiting is None
    assert loop.intake.playing is not None and loop.intake.playing.ticket.id == 1


@pytest.mark.usefixtures("ready")
def test_steps_and_underruns_are_counted_over_skipped_ticks(
    loop: ControlLoop, run: Callable[..., None], retargeter: Retargeter
) -> None:
    plan = offer(loop, retargeter.plan(retargeter.standing(), default_clip()[240:290], 0, loop.tick_count))
    assert plan.steps
    run(1)
    while loop.tick_count < plan.end_tick:
        loop.tick_count += 3
        loop.driver.advance(3 * 0.008)
        run(1)
    assert loop.telemetry.row.steps_planned == len(plan.steps)
    assert loop.telemetry.row.underruns == 1


def turn_head(loop: ControlLoop, op3: Robot, angle: float) -> int:
    """Turn the limp head, as by hand, also past its stops; returns the joint's index."""
    assert isinstance(loop.driver, SimDriver)
    pan = op3.index("head_pan")
    loop.driver.data.qpos[op3.qpos_address[pan]] = angle
    loop.driver.advance(0.008)
    return pan


def test_a_joint_past_its_limit_is_brought_in_softly(loop: ControlLoop, run: Callable[..., None], op3: Robot) -> None:
    """A limp robot rests on its stops; its start was refused: "stands at -2.06, outside [-2.00, 2.00]"."""
    limit = op3.upper[op3.index("head_pan")]
    pan = turn_head(loop, op3, limit + 0.08)
    run(1, start=True)
    assert loop.ladder.state is State.READY
    goals, torques = [loop.command.position[pan]], []
    while not loop.move.done:
        run(1)
        goals.append(loop.command.position[pan])
        torques.append(abs(loop.driver.truth().torque[pan]))
    assert goals[0] == pytest.approx(limit + 0.08, abs=op3.tick_rad[pan])
    beyond = [goal for goal in goals if goal > limit]
    assert len(beyond) > 20 and beyond == sorted(beyond, reverse=True)
    assert max(torques) < 0.5
    assert abs(loop.state.position[pan] - loop.stand_pose[pan]) < 0.02
    assert loop.driver.violations == 0


def test_goals_begin_where_the_driver_pinned_them(
    loop: ControlLoop, run: Callable[..., None], op3: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Servos are pinned where they stand when torque is switched on, a moment after the loop has read them."""
    limit = op3.upper[op3.index("head_pan")]
    pan = turn_head(loop, op3, limit + 0.08)
    pins = [limit + 0.05]

    def take_pins(goal: np.ndarray) -> None:
        if pins and loop.ladder.state is State.READY:
            goal[pan] = pins.pop()

    monkeypatch.setattr(loop.driver, "take_pins", take_pins)
    run(1, start=True)
    goals = [loop.command.position[pan]]
    while not loop.move.done:
        run(1)
        goals.append(loop.command.position[pan])
        if len(goals) == 4:
            pins.append(limit + 0.01)  # switched on again, further in
    assert limit < goals[0] <= limit + 0.05 and max(goals[:4]) <= limit + 0.05
    assert max(goals[5:]) <= limit + 0.01


def test_a_start_is_refused_with_a_joint_too_far_past_its_limit(
    loop: ControlLoop, run: Callable[..., None], op3: Robot
) -> None:
    turn_head(loop, op3, op3.upper[op3.index("head_pan")] + 0.16)
    run(1, start=True)
    (event,) = events(loop.telemetry.events.reader())
    assert loop.ladder.state is State.OFF
    assert event.message.startswith("no start: servo of head_pan (id 19) stands at 1.6")
    assert "more than 0.15 rad outside [-1.50, 1.50]" in event.message


def test_a_fault_mentions_that_the_loop_itself_was_late(
    loop: ControlLoop, run: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    run(1, start=True)
    run(10)
    read = loop.driver.read

    def unanswered(state: RobotState) -> None:
        read(state)
        state.stale[:] = 6

    monkeypatch.setattr(loop.driver, "read", unanswered)
    loop.tick(late_ns=35_000_000)
    assert loop.ladder.fault is not None
    assert loop.ladder.fault.startswith("bus lost: no joint has answered for 6 reads (the loop itself woke 35 ms late")
