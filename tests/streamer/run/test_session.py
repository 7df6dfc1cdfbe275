"""Whole runs in lockstep: how each ends undisturbed, after a stop, and after a failure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import get_args

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.robot_file import EmergencyStop
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.human_steps import count_steps
from flexmotion.spatial.tilt import tilt_of
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

STREAMED = [State.READY, State.STREAMING, State.HOLD, State.PARK, State.OFF]
"""States of an undisturbed run."""

PARKED_WITHIN_S = 6.5
"""After a request for the end the robot is parked and torque is off within this time [s of the loop]."""

When = Callable[[ControlLoop], bool]
"""A moment of a run: looked at before each tick, the first one that fits counts."""
Spoil = Callable[[ControlLoop, RobotState], None]


def at_once(_loop: ControlLoop) -> bool:
    return True


def rising(loop: ControlLoop) -> bool:
    """Half-way through the move to the stand pose."""
    return loop.ladder.state is State.READY and not loop.move.done and 2 * loop.move.tick >= loop.move.ticks


def standing(loop: ControlLoop) -> bool:
    """The move to the stand pose is done."""
    return loop.ladder.state is State.READY and loop.move.done


def following(loop: ControlLoop) -> bool:
    """The source plays, both feet are on the ground."""
    if loop.intake.plan is None or not loop.now.contacts.all():
        return False
    place = loop.tick_count - loop.intake.plan.start_tick
    return 0 <= place < len(loop.intake.plan) and bool(loop.intake.plan.source_s[place] > 0.0)


def mid_step(loop: ControlLoop, number: int = 3) -> bool:
    """The third step, or another one, is half over."""
    steps = [] if loop.intake.plan is None else loop.intake.plan.steps
    half_over = any(step.lift + step.land <= 2 * loop.tick_count < 2 * step.land for step in steps)
    return half_over and int(loop.telemetry.row.steps_planned) >= number


class Faulty(SimDriver):
    """A simulated robot whose readings a test may spoil, and which keeps the goals that it was sent."""

    def __init__(self, robot: Robot, **options: object) -> None:
        super().__init__(robot, options=SimOptions.model_validate(options))
        self.spoil: Callable[[RobotState], None] = lambda _state: None
        self.reads = 0
        self.sent: list[tuple[int, np.ndarray]] = []

    def read(self, state: RobotState) -> None:
        super().read(state)
        self.spoil(state)
        self.reads += 1

    def write(self, command: JointCommand) -> None:
        self.sent.append((self.reads, command.position.copy()))
        super().write(command)


@dataclass
class Run:
    """A whole run; `acted_tick` is the tick before which the request was made, or the readings were first spoiled."""

    session: Session
    driver: Faulty
    record: RunTrace
    acted_tick: int

    @property
    def loop(self) -> ControlLoop:
        assert self.session.loop is not None
        return self.session.loop

    @property
    def states(self) -> list[State]:
        """Each state in turn."""
        states = [State(s) for s in self.record.state[: self.record.used]]
        return [s for k, s in enumerate(states) if not k or states[k - 1] is not s]

    @property
    def tilt(self) -> float:
        """Angle of the torso against the vertical at the end [rad]."""
        return float(tilt_of(self.driver.truth().base_quaternion))

    def messages(self, kind: str) -> list[str]:
        return [event.message for event in self.record.events if event.kind == kind]


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def steps() -> Motion:
    """The steps of the default clip, with half a second of standing before them."""
    return default_clip()[225:330]


@pytest.fixture(scope="module")
def run(op3: Robot, steps: Motion) -> Callable[..., Run]:
    """Function (motion, when, request, spoil, options ...) -> a whole run.

    The request is made once `when` holds; the readings are spoiled from then on.
    """

    def make(
        motion: Motion | None = None,
        *,
        when: When = mid_step,
        request: Request | None = None,
        spoil: Spoil | None = None,
        seconds: float = 60.0,
        **options: object,
    ) -> Run:
        driver = Faulty(op3, **options)
        source = ClipSource(steps if motion is None else motion)
        acted: list[int] = []

        def now() -> ControlLoop | None:
            """The loop, once `when` holds."""
            loop = session.loop
            assert loop is not None
            if not acted and when(loop):
                acted.append(loop.tick_count)
            return loop if acted else None

        def operate() -> Request | None:
            loop = now()
            return request if loop is not None and loop.tick_count == acted[0] else None

        def spoiled(state: RobotState) -> None:
            loop = now()
            if loop is not None and spoil is not None:
                spoil(loop, state)

        session = Session(op3, driver, source, load_stream(), seconds, next_request=operate)
        driver.spoil = spoiled
        record = session.run()
        assert acted or (request is None and spoil is None)
        return Run(session, driver, record, acted[0] if acted else -1)

    return make


@pytest.fixture(scope="module")
def whole(run: Callable[..., Run]) -> Run:
    """An undisturbed run of the default clip; read-only."""
    return run(default_clip())


# ---------------------------------------------------------------- undisturbed


def test_the_default_clip_ends_off_parked_and_upright(whole: Run, op3: Robot) -> None:
    record = whole.record
    assert whole.states == STREAMED
    assert record.violations_sent == 0 and record.underruns == 0
    assert whole.messages("fault") == [] and whole.messages("warning") == []
    assert whole.tilt < 0.6  # the rest pose leans forward
    parked = record.true_q[record.used - 1]
    assert np.abs(parked - op3.rest_pose).max() < 0.25
    streaming = record.state[: record.used] == State.STREAMING
    assert tilt_of(record.true_base[: record.used, 3:])[streaming].max() < op3.safety.most_tilt + 0.05


def test_it_makes_the_steps_of_the_clip(whole: Run) -> None:
    human = count_steps(default_clip())
    assert whole.record.steps_planned >= human > 3
    assert whole.record.true_base[whole.record.used - 1, 0] > 0.15


def test_what_was_played_is_on_record(whole: Run) -> None:
    record = whole.record
    streaming = np.flatnonzero(record.state[: record.used] == State.STREAMING)
    inner = streaming[:-1]
    for name in ("q_ref", "qd_ref", "torque_ref", "q_cmd", "q", "qd", "com_ref", "dcm_ref", "com", "dcm", "base_ref"):
        assert np.isfinite(getattr(record, name)[inner]).all(), name
    times = record.source_s[inner]
    np.testing.assert_allclose(np.diff(times[np.isfinite(times)]), 1 / record.rate_hz, atol=1e-9)
    assert np.isnan(record.q_cmd[record.used - 1]).all()  # torque is off


def test_plans_join_on_time_at_the_cadence_of_the_settings(whole: Run) -> None:
    joins = [plan.join_tick for plan in whole.record.plans]
    assert all(plan.join_tick >= plan.asked_tick for plan in whole.record.plans)
    assert set(np.diff(joins)) == {round(load_stream().replan_s * whole.record.rate_hz)}


def test_the_same_seed_twice_gives_the_same_run_bit_for_bit(run: Callable[..., Run]) -> None:
    one, other = (run(seed=3, noise_scale=2.0, seconds=2.0).record for _ in range(2))
    timing = {"work_s", "lateness_s", "sample_s", "retarget_s", "stamp_ns"}
    for name in one.rows.dtype.names:
        if name not in timing:
            np.testing.assert_array_equal(one.rows[name], other.rows[name], err_msg=name)
    assert one.events == other.events and one.repairs == other.repairs


def test_seconds_cut_a_clip_short_with_a_balanced_stop(run: Callable[..., Run]) -> None:
    cut = run(seconds=1.8)
    assert cut.states == STREAMED
    played, most = np.nanmax(cut.record.source_s), 1.8 + load_stream().horizon_s
    assert 1.8 <= played <= most and played < cut.session.source.motion.duration  # type: ignore[attr-defined]
    assert cut.tilt < 0.6 and cut.record.violations_sent == 0
    assert cut.record.used < 9.0 * cut.record.rate_hz


# ---------------------------------------------------------------- stops


@pytest.mark.parametrize("when", [rising, following, mid_step])
def test_a_stop_at_any_time_ends_parked_and_upright(run: Callable[..., Run], when: When) -> None:
    stopped = run(request=Request.END, when=when)
    assert stopped.states[-2:] == [State.PARK, State.OFF]
    assert stopped.messages("fault") == []
    assert stopped.tilt < 0.6 and stopped.record.violations_sent == 0
    # The source is followed no further than to the next join, to which a plan that stops was made.
    followed = np.flatnonzero(np.isfinite(stopped.record.source_s))
    joined = (plan.join_tick for plan in stopped.record.plans if plan.asked_tick >= stopped.acted_tick)
    assert followed.max(initial=0) <= next(joined, stopped.acted_tick)
    assert stopped.record.used < stopped.acted_tick + PARKED_WITHIN_S * stopped.record.rate_hz


@pytest.mark.parametrize("asked", [Request.END, Request.STOP, Request.ESTOP, Request.KILL])
def test_a_request_before_the_start_keeps_torque_off(run: Callable[..., Run], asked: Request) -> None:
    """Ctrl-C during the program's preparations let the robot stand up and park."""
    still = run(request=asked, when=at_once)
    assert still.states == [State.FAULT if asked in (Request.ESTOP, Request.KILL) else State.OFF]
    assert still.driver.sent == []
    assert not still.driver.plant.enabled.any()
    assert any("no start" in message for message in still.messages("note"))


def test_estop_in_mid_walk_freezes_at_once_then_parks_in_fault(run: Callable[..., Run]) -> None:
    frozen = run(request=Request.ESTOP)
    tick = frozen.acted_tick
    assert frozen.states[-3:] == [State.HOLD, State.PARK, State.FAULT]
    record = frozen.record
    assert record.state[tick] == State.HOLD  # within the tick
    held = record.q_cmd[record.state == State.HOLD]
    np.testing.assert_array_equal(held, np.broadcast_to(record.q_cmd[tick - 1], held.shape))
    assert any("e-stop" in message for message in frozen.messages("fault"))
    assert frozen.tilt < 0.8 and record.violations_sent == 0


def swinging(part: float) -> When:
    """When a foot has been in the air for a part of a swing of .3 s."""
    since: int | None = None

    def when(loop: ControlLoop) -> bool:
        nonlocal since
        if loop.now.contacts.all():
            since = None
            return False
        since = loop.tick_count if since is None else since
        return loop.tick_count - since > part * 0.3 * loop.robot.rate_hz

    return when


@pytest.mark.parametrize("stop", get_args(EmergencyStop))
@pytest.mark.parametrize("part", [0.0, 0.5, 0.9])
def test_every_kind_of_emergency_stop_keeps_the_robot_up_in_mid_swing(
    run: Callable[..., Run], op3: Robot, monkeypatch: pytest.MonkeyPatch, stop: EmergencyStop, part: float
) -> None:
    """What an emergency stop did was one for all robots; `benchmarks/robot/emergency_stop.py` has every phase."""
    monkeypatch.setattr(op3, "safety", op3.safety.model_copy(update={"emergency_stop": stop}))
    stopped = run(request=Request.ESTOP, when=swinging(part))
    assert stopped.states[-2:] == [State.PARK, State.FAULT]
    assert (
        stopped.record.state[stopped.acted_tick]
        == {
            "freeze": State.HOLD,
            "captured_stop": State.STREAMING,
            "crouch": State.PARK,
        }[stop]
    )
    assert stopped.tilt < 0.8 and stopped.record.violations_sent == 0


def test_kill_in_mid_walk_cuts_torque_within_the_tick(run: Callable[..., Run]) -> None:
    killed = run(request=Request.KILL)
    assert killed.states[-2:] == [State.STREAMING, State.FAULT]
    assert killed.driver.sent[-1][0] == killed.acted_tick  # reads are one ahead of ticks: this tick sent nothing
    assert not killed.driver.plant.enabled.any()
    assert any("kill" in message for message in killed.messages("fault")) and not killed.record.hardware_failed


def test_a_fall_after_a_push_is_detected_and_damped(run: Callable[..., Run]) -> None:
    felled = run(pushes=[{"at": 1.2, "impulse": [2.5, 0.0, 0.0]}])
    assert felled.states[-2:] == [State.DAMPED, State.FAULT]
    assert any(message.endswith("limit") for message in felled.messages("fault"))
    assert not felled.record.hardware_failed


# ---------------------------------------------------------------- failures


def test_without_an_imu_it_warns_once_and_runs(run: Callable[..., Run]) -> None:
    blind = run(imu=False, seconds=1.0)
    assert blind.states == STREAMED
    assert len(blind.messages("warning")) == 1 and "IMU" in blind.messages("warning")[0]
    assert blind.record.violations_sent == 0


def always(change: Callable[[RobotState], None]) -> Spoil:
    return lambda _loop, state: change(state)


def stale(state: RobotState) -> None:
    state.stale[11] = 6


def overheated(state: RobotState) -> None:
    state.hardware_error[11] = 4


def sagging(state: RobotState) -> None:
    state.voltage[:] = 10.0


def too_hot(state: RobotState) -> None:
    state.temperature[11] = 76.0


def warm(state: RobotState) -> None:
    state.temperature[11] = 71.0


def not_a_number(state: RobotState) -> None:
    state.position[11] = state.velocity[11] = np.nan


def imu_not_a_number(state: RobotState) -> None:
    state.gyro[1] = state.accel[0] = np.nan


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (stale, "servo of l_knee (id 14) does not answer"),
        (overheated, "servo of l_knee (id 14) reports hardware error 0x04"),
        (sagging, "supply at 10.0 V, below 10.2 V"),
        (too_hot, "servo of l_knee (id 14) is at 76 °C and shuts down at 80 °C"),
    ],
)
def test_a_fault_in_mid_walk_stops_parks_and_latches(
    run: Callable[..., Run], change: Callable[[RobotState], None], message: str
) -> None:
    # A knee that holds still may throw the robot in the steps that are left: in 7 of 29 moments of a walk.
    broken = run(spoil=always(change))
    assert broken.states[-4:] == [State.STREAMING, State.HOLD, State.PARK, State.FAULT]
    assert broken.loop.ladder.fault == message and broken.record.hardware_failed
    assert broken.tilt < 0.8
    assert all(np.isfinite(goal).all() for _, goal in broken.driver.sent)
    assert broken.record.violations_sent == 0


def test_a_warm_servo_is_warned_of_once(run: Callable[..., Run]) -> None:
    warned = run(when=standing, spoil=always(warm), seconds=1.0)
    assert warned.states == STREAMED and warned.messages("fault") == []
    assert warned.messages("warning") == ["servo of l_knee (id 14) is at 71 °C and shuts down at 80 °C"]


def test_a_silent_imu_means_open_loop_where_the_robot_file_does_not_require_one(run: Callable[..., Run]) -> None:
    blind = run(when=standing, spoil=always(imu_not_a_number))
    assert blind.states == STREAMED and blind.messages("fault") == []
    assert blind.messages("warning") == ["no IMU: the robot runs open loop, falls are not detected"]
    assert blind.tilt < 0.6


def test_a_silent_imu_parks_a_robot_that_requires_one(
    run: Callable[..., Run], op3: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert op3.config.imu is not None
    required = op3.config.imu.model_copy(update={"required": True})
    monkeypatch.setitem(vars(op3), "config", op3.config.model_copy(update={"imu": required}))
    blind = run(spoil=always(imu_not_a_number))
    assert blind.states[-2:] == [State.PARK, State.FAULT]
    assert blind.messages("fault")[0].endswith("IMU has not answered for 6 reads")


def test_a_joint_that_returns_nan_counts_as_silent(run: Callable[..., Run]) -> None:
    blind = run(spoil=always(not_a_number), when=partial(mid_step, number=4))
    assert blind.states[-1] is State.FAULT
    assert blind.loop.ladder.fault == "servo of l_knee (id 14) does not answer"
    assert all(np.isfinite(goal).all() for _, goal in blind.driver.sent)
    # Assumed to follow its reference, the joint still carries the robot; assumed to stand still, the robot fell.
    assert blind.states[-3:] == [State.HOLD, State.PARK, State.FAULT] and blind.tilt < 0.8
    assert np.isfinite(blind.record.q[: blind.record.used]).all()


def test_a_lost_bus_ends_in_fault_after_the_robot_was_held_and_lowered(run: Callable[..., Run]) -> None:
    """Regression: FAULT came at once, and cut the torque of a walking robot whose servos still heard their goals."""

    def silent(state: RobotState) -> None:
        state.stale[:] = 6

    lost = run(spoil=always(silent))
    assert lost.states[-4:] == [State.STREAMING, State.HOLD, State.PARK, State.FAULT]
    robot = lost.session.robot
    assert lost.record.used - lost.acted_tick > robot.safety.lost_bus_hold_s * robot.rate_hz
    assert "no joint has answered" in lost.messages("fault")[0] and lost.record.hardware_failed


def test_a_few_missed_reads_do_no_harm(run: Callable[..., Run]) -> None:
    """A joint and the IMU return NaN for three reads in a row, every 60 reads."""

    def now_and_then(loop: ControlLoop, state: RobotState) -> None:
        if loop.tick_count % 60 < 3:
            not_a_number(state)
            imu_not_a_number(state)

    shaken = run(when=standing, spoil=now_and_then, seconds=2.5)
    assert shaken.states == STREAMED
    assert shaken.record.violations_sent == 0 and shaken.tilt < 0.6
    assert np.isfinite(shaken.record.q[: shaken.record.used]).all()


def test_it_does_not_start_with_a_joint_without_position(run: Callable[..., Run]) -> None:
    refused = run(when=at_once, spoil=always(not_a_number))
    assert refused.states == [State.OFF]
    assert refused.driver.sent == []
    assert refused.messages("fault") == ["no start: servo of l_knee (id 14) returns no position"]
    assert refused.record.hardware_failed


def test_a_dry_run_may_be_asked_to_lie(run: Callable[..., Run]) -> None:
    """Lies were told on the emulated bus alone; a dry run could not show what a robot makes of them."""
    lied = run(false_readings=0.01, seconds=2.0)
    assert lied.states == STREAMED and not lied.record.hardware_failed
    assert int(lied.record.rows["disbelieved"][-1]) > 5 and lied.record.violations_sent == 0
