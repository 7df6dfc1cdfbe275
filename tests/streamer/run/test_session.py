"""Whole runs in lockstep: how each ends when all is well, when it is stopped, and when something breaks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.human_steps import count_steps
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.report.metrics import tilt
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

RATE = 125
MID_WALK = 3.46
"""Seconds into a run of `steps` at which a foot is in the air, or nearly."""
STREAMED = (State.OFF, State.READY, State.STREAMING, State.HOLD, State.PARK)

Spoil = Callable[[int, RobotState], None]


class Faulty(SimDriver):
    """A simulated robot whose readings a test may spoil, and which keeps what it was sent."""

    def __init__(self, robot: Robot, spoil: Spoil | None = None, **options: object) -> None:
        super().__init__(robot, options=SimOptions.model_validate(options))
        self.spoil, self.reads = spoil, 0
        self.sent: list[tuple[int, np.ndarray]] = []

    def read(self, state: RobotState) -> None:
        super().read(state)
        if self.spoil is not None:
            self.spoil(self.reads, state)
        self.reads += 1

    def write(self, command: JointCommand) -> None:
        self.sent.append((self.reads, command.position.copy()))
        super().write(command)


@dataclass
class Run:
    session: Session
    driver: Faulty
    record: RunTrace

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
        return float(tilt(self.driver.truth().base_quaternion[None])[0])

    def told(self, kind: str) -> list[str]:
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
    """Function (motion, request, spoil, options ...) -> a whole run; `request(session, tick)` acts as an operator."""

    def make(
        motion: Motion | None = None,
        *,
        request: Request | None = None,
        at: float = MID_WALK,
        spoil: Spoil | None = None,
        seconds: float = 60.0,
        **options: object,
    ) -> Run:
        driver = Faulty(op3, spoil, **options)
        source = ClipSource(steps if motion is None else motion)

        def operate() -> Request | None:
            assert session.loop is not None
            return request if session.loop.tick_count == int(at * RATE) else None

        session = Session(op3, driver, source, load_stream(), seconds, next_request=operate)
        return Run(session, driver, session.run())

    return make


@pytest.fixture(scope="module")
def whole(run: Callable[..., Run]) -> Run:
    """An undisturbed run of the default clip; treat as read-only."""
    return run(default_clip())


# ---------------------------------------------------------------- all is well


def test_the_default_clip_ends_off_parked_and_upright(whole: Run, op3: Robot) -> None:
    record = whole.record
    assert whole.states == [*STREAMED[1:], State.OFF]
    assert record.violations_sent == 0 and record.underruns == 0
    assert whole.told("fault") == [] and whole.told("warning") == []
    assert whole.tilt < 0.6  # the rest pose leans forward
    parked = record.true_q[record.used - 1]
    assert np.abs(parked - op3.rest_pose).max() < 0.25
    streaming = record.state[: record.used] == State.STREAMING
    up = 1 - 2 * (record.true_base[: record.used, 4] ** 2 + record.true_base[: record.used, 5] ** 2)
    assert np.arccos(up[streaming]).max() < op3.safety.fall_tilt


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
    np.testing.assert_allclose(np.diff(times[np.isfinite(times)]), 1 / RATE, atol=1e-9)
    assert np.isnan(record.q_cmd[record.used - 1]).all()  # torque is off


def test_plans_join_on_time_a_quarter_second_apart(whole: Run) -> None:
    joins = [plan.join_tick for plan in whole.record.plans]
    assert all(plan.join_tick >= plan.asked_tick for plan in whole.record.plans)
    assert set(np.diff(joins)) == {round(0.25 * RATE)}


def test_the_same_seed_twice_gives_the_same_run_bit_for_bit(run: Callable[..., Run]) -> None:
    one, other = (run(seed=3, noise_scale=2.0, seconds=2.0).record for _ in range(2))
    timing = {"work_s", "lateness_s", "sample_s", "retarget_s", "stamp_ns"}
    for name in one.rows.dtype.names:
        if name not in timing:
            np.testing.assert_array_equal(one.rows[name], other.rows[name], err_msg=name)
    assert one.events == other.events and one.repairs == other.repairs


def test_seconds_cut_a_clip_short_with_a_balanced_stop(run: Callable[..., Run]) -> None:
    cut = run(seconds=1.8)
    assert cut.states == [*STREAMED[1:], State.OFF]
    assert cut.record.used < RATE * 9 and cut.tilt < 0.6 and cut.record.violations_sent == 0


# ---------------------------------------------------------------- stops


@pytest.mark.parametrize("at", [0.2, 1.8, MID_WALK])
def test_a_stop_at_any_time_ends_parked_and_upright(run: Callable[..., Run], at: float) -> None:
    stopped = run(request=Request.END, at=at)
    assert stopped.states[-2:] == [State.PARK, State.OFF]
    assert stopped.told("fault") == []
    assert stopped.tilt < 0.6 and stopped.record.violations_sent == 0
    assert stopped.record.used < (at + 6.5) * RATE


@pytest.mark.parametrize("asked", [Request.END, Request.STOP, Request.ESTOP, Request.KILL])
def test_what_is_asked_for_before_the_start_keeps_torque_off(run: Callable[..., Run], asked: Request) -> None:
    """Ctrl-C while the program still got ready let the robot stand up, to park it then."""
    still = run(request=asked, at=0.0)
    assert still.states == [State.FAULT if asked is Request.KILL else State.OFF]
    assert still.driver.sent == []
    assert not still.driver.plant.enabled.any()
    assert any("no start" in message for message in still.told("note"))


def test_estop_in_mid_walk_freezes_at_once_then_parks_in_fault(run: Callable[..., Run]) -> None:
    frozen = run(request=Request.ESTOP)
    tick = int(MID_WALK * RATE)
    assert frozen.states[-3:] == [State.HOLD, State.PARK, State.FAULT]
    record = frozen.record
    assert record.state[tick] == State.HOLD  # within the tick
    held = record.q_cmd[tick : tick + RATE // 2]
    np.testing.assert_array_equal(held, np.broadcast_to(record.q_cmd[tick - 1], held.shape))
    assert any("e-stop" in message for message in frozen.told("fault"))
    assert frozen.tilt < 0.8 and record.violations_sent == 0


def test_kill_in_mid_walk_cuts_torque_within_the_tick(run: Callable[..., Run]) -> None:
    killed = run(request=Request.KILL)
    tick = int(MID_WALK * RATE)
    assert killed.states[-2:] == [State.STREAMING, State.FAULT]
    assert killed.driver.sent[-1][0] == tick  # reads are one ahead of ticks: nothing was sent in this one
    assert not killed.driver.plant.enabled.any()
    assert any("kill" in message for message in killed.told("fault")) and not killed.record.hardware_failed


def test_a_shove_that_fells_it_is_noticed_and_damped(run: Callable[..., Run]) -> None:
    felled = run(pushes=[{"at": 1.2, "impulse": [2.5, 0.0, 0.0]}])
    assert felled.states[-2:] == [State.DAMPED, State.FAULT]
    assert any(message.endswith("limit") for message in felled.told("fault"))
    assert not felled.record.hardware_failed


# ---------------------------------------------------------------- what breaks


def test_without_an_imu_it_warns_once_and_runs(run: Callable[..., Run]) -> None:
    blind = run(imu=False, seconds=1.0)
    assert blind.states == [*STREAMED[1:], State.OFF]
    assert len(blind.told("warning")) == 1 and "IMU" in blind.told("warning")[0]
    assert blind.record.violations_sent == 0


def from_tick(tick: int, change: Callable[[RobotState], None]) -> Spoil:
    def spoil(read: int, state: RobotState) -> None:
        if read >= tick:
            change(state)

    return spoil


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
    broken = run(spoil=from_tick(int(MID_WALK * RATE), change))
    assert broken.states[-4:] == [State.STREAMING, State.HOLD, State.PARK, State.FAULT]
    assert broken.loop.ladder.fault == message and broken.record.hardware_failed
    assert broken.tilt < 0.8
    assert all(np.isfinite(goal).all() for _, goal in broken.driver.sent)
    assert broken.record.violations_sent == 0


def test_a_warm_servo_is_told_of_once(run: Callable[..., Run]) -> None:
    warned = run(spoil=from_tick(RATE, warm), seconds=1.0)
    assert warned.states == [*STREAMED[1:], State.OFF] and warned.told("fault") == []
    assert warned.told("warning") == ["servo of l_knee (id 14) is at 71 °C and shuts down at 80 °C"]


def test_a_silent_imu_means_open_loop_where_the_robot_file_does_not_require_one(run: Callable[..., Run]) -> None:
    blind = run(spoil=from_tick(RATE, imu_not_a_number))
    assert blind.states == [*STREAMED[1:], State.OFF] and blind.told("fault") == []
    assert blind.told("warning") == ["no IMU: the robot runs open loop, falls are not detected"]
    assert blind.tilt < 0.6


def test_a_silent_imu_parks_a_robot_that_requires_one(
    run: Callable[..., Run], op3: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert op3.config.imu is not None
    required = op3.config.imu.model_copy(update={"required": True})
    monkeypatch.setitem(vars(op3), "config", op3.config.model_copy(update={"imu": required}))
    blind = run(spoil=from_tick(int(MID_WALK * RATE), imu_not_a_number))
    assert blind.states[-2:] == [State.PARK, State.FAULT]
    assert blind.told("fault")[0].endswith("IMU has not answered for 6 reads")


def test_a_joint_that_returns_no_number_is_a_joint_that_does_not_answer(run: Callable[..., Run]) -> None:
    blind = run(spoil=from_tick(int(MID_WALK * RATE), not_a_number))
    assert blind.states[-1] is State.FAULT
    assert blind.loop.ladder.fault == "servo of l_knee (id 14) does not answer"
    assert all(np.isfinite(goal).all() for _, goal in blind.driver.sent)
    # Taken to follow its reference it still carries the robot home; held at its last position it felled it.
    assert blind.states[-3:] == [State.HOLD, State.PARK, State.FAULT] and blind.tilt < 0.8
    assert np.isfinite(blind.record.q[: blind.record.used]).all()


def test_a_lost_bus_ends_in_fault_at_once(run: Callable[..., Run]) -> None:
    def silent(state: RobotState) -> None:
        state.stale[:] = 6

    lost = run(spoil=from_tick(int(MID_WALK * RATE), silent))
    assert lost.states[-2:] == [State.STREAMING, State.FAULT]
    assert lost.record.used == int(MID_WALK * RATE) + 1
    assert "no joint has answered" in lost.told("fault")[0] and lost.record.hardware_failed


def test_a_few_missed_reads_do_no_harm(run: Callable[..., Run]) -> None:
    """Now and then a joint or the IMU gives no number for three reads in a row."""

    def now_and_then(read: int, state: RobotState) -> None:
        if read > RATE and read % 60 < 3:
            not_a_number(state)
            imu_not_a_number(state)

    shaken = run(spoil=now_and_then, seconds=2.5)
    assert shaken.states == [*STREAMED[1:], State.OFF]
    assert shaken.record.violations_sent == 0 and shaken.tilt < 0.6
    assert np.isfinite(shaken.record.q[: shaken.record.used]).all()


def test_it_does_not_start_on_a_joint_that_has_no_position(run: Callable[..., Run]) -> None:
    refused = run(spoil=from_tick(0, not_a_number))
    assert refused.states == [State.OFF]
    assert refused.driver.sent == []
    assert refused.told("fault") == ["no start: servo of l_knee (id 14) returns no position"]
    assert refused.record.hardware_failed
