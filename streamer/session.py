"""A whole run: robot up, source streamed, robot parked; on a clock that steps (lockstep) or one that passes (real)."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial

from configs.errors import ConfigError, FlexMotionError
from configs.robot import Robot
from configs.stream import StreamSettings
from drivers.interface import Driver
from flexmotion.contacts import ContactDetector
from flexmotion.motion import Motion
from retarget.human import HumanWindow
from retarget.plan import Plan
from retarget.retargeter import Retargeter
from streamer.ladder import State
from streamer.loop import ControlLoop
from streamer.planner import Planned, Planner
from streamer.record import PlanEvent, RunRecord
from streamer.sources import Source

_SETTLE_S = 1.0
"""How long the robot stands in HOLD after the source is over, before it parks."""
_PARKING_S = 12.0
"""What a run that has gone on too long is left to stop and park."""
_MARGIN_S = 30.0
"""Longest run beyond the source's length: standing up, stopping, parking."""


@dataclass
class Session:
    """One robot, one source, one run.

    Args:
        seconds: longest that the source is streamed [s].
        feedback: whether balance feedback acts.
        progress: called each tick with the share of the run that is done, in [0, 1].
        stop_requested: asked each tick; True asks for a balanced stop, parking and the end.
    """

    robot: Robot
    driver: Driver
    source: Source
    settings: StreamSettings
    seconds: float
    feedback: bool = True
    progress: Callable[[float], None] | None = None
    stop_requested: Callable[[], bool] | None = None
    planner: Planner = field(init=False)
    loop: ControlLoop = field(init=False)
    record: RunRecord = field(init=False)

    def __post_init__(self) -> None:
        rate = self.robot.rate_hz
        self.record = RunRecord(rate, self.robot.joint_names, int((self.seconds + _MARGIN_S) * rate))
        retargeter = Retargeter(self.robot, self.settings)
        self.planner = Planner(retargeter, self.source, self.settings)
        # The loop has a retargeter of its own: on the real clock the planner works in another thread.
        self.loop = ControlLoop(
            self.robot, self.driver, Retargeter(self.robot, self.settings), self.record, feedback=self.feedback
        )
        self._replan_ticks = int(round(self.settings.replan_s * rate))
        self._commit_ticks = max(int(round(self.settings.commit_s * rate)), 1)
        self._next_plan_tick = 0
        self._stream_start: int | None = None
        self._hold_ticks = 0
        self._ending = False  # somebody asked for the end of the run
        self._source_over = self._stop_planned = False  # what the last plan that was accepted holds
        self._broken: str | None = None  # why no more plans can be made

    def run(self, clock: str = "lockstep") -> RunRecord:
        """Run to the end on clock "lockstep" or "real" and return the record.

        Raises:
            ConfigError: lockstep is asked for with a driver whose time cannot be stepped.
        """
        if clock == "lockstep" and not self.driver.capabilities.lockstep:
            raise ConfigError(f"driver {self.driver.name!r} runs on the real clock only; use --clock real")
        with self.driver:
            if clock == "lockstep":
                self._run_lockstep()
            else:
                self._run_real()
            self.record.violations_sent = self.driver.violations
        return self.record

    # ---------------------------------------------------------------- clocks

    def _run_lockstep(self) -> None:
        period = 1.0 / self.robot.rate_hz
        while not self._finished():
            begin = time.perf_counter()
            self._operate()
            work = time.perf_counter() - begin
            if self._plan_due():
                make = partial(self._make_plan, *self._request(self._commit_ticks))
                self._accept(self._planned(make), self.loop.tick_count)
            begin = time.perf_counter()
            self.loop.tick()
            self._stamp(work + time.perf_counter() - begin, 0.0)
            self.driver.advance(period)
            self._note_truth()

    def _run_real(self) -> None:
        period_ns = int(round(1e9 / self.robot.rate_hz))
        simulated = self.driver.capabilities.lockstep
        pending: Future[Planned] | None = None
        asked = 0
        pool = ThreadPoolExecutor(1, "planner")
        try:
            deadline = time.perf_counter_ns()
            while not self._finished():
                late = time.perf_counter_ns() - deadline
                begin = time.perf_counter()
                self._operate()
                if pending is None and self._plan_due():
                    asked = self.loop.tick_count
                    pending = pool.submit(self._make_plan, *self._request(self._replan_ticks // 2))
                elif pending is not None and pending.done():
                    self._accept(self._planned(pending.result), asked)
                    pending = None
                self.loop.tick()
                self._stamp(time.perf_counter() - begin, late * 1e-9)
                if simulated:
                    self.driver.advance(1.0 / self.robot.rate_hz)
                    self._note_truth()
                deadline += period_ns
                behind = time.perf_counter_ns() - deadline
                if behind <= 0:
                    time.sleep(-behind * 1e-9)
                    continue
                missed = behind // period_ns + 1
                self.record.missed_deadlines += missed
                deadline += (missed - 1) * period_ns
                if not simulated:
                    # Clamp, never re-time: a real robot's plan has gone on meanwhile. Simulated time has not.
                    self.loop.tick_count += missed - 1
        finally:
            pool.shutdown(wait=False, cancel_futures=True)

    # ---------------------------------------------------------------- one tick

    def _operate(self) -> None:
        """Act as the operator of the run: start, let it stream, settle, park."""
        loop, inputs = self.loop, self.loop.inputs
        state = loop.ladder.state
        if state is State.OFF and loop.tick_count == 0:
            inputs.start = True
        if self.stop_requested is not None and not self._ending and self.stop_requested():
            self._ending = True
            inputs.stop = True
        if self._broken is not None:
            inputs.fault = f"planner: {self._broken}"
        if loop.tick_count == self.record.ticks - int(_PARKING_S * self.robot.rate_hz):
            inputs.fault = "the run went on past its time"
        if state is State.READY and self._ending:
            inputs.park = True
        if state is State.HOLD:
            self._hold_ticks += 1
            over = self._source_over or self._ending or self._stream_over()
            if over and self._hold_ticks >= _SETTLE_S * self.robot.rate_hz:
                inputs.park = True
        else:
            self._hold_ticks = 0
        if self.progress is not None:
            self.progress(min(self._streamed_s() / max(self.seconds, 1e-9), 1.0))

    def _streamed_s(self) -> float:
        """How much of the source has been played [s]; the lead-in before it does not count."""
        if self._stream_start is None:
            return 0.0
        since = (self.loop.tick_count - self._stream_start) / self.robot.rate_hz
        return max(since - self.settings.lead_in_s, 0.0)

    def _stream_over(self) -> bool:
        return self._streamed_s() >= self.seconds

    def _finished(self) -> bool:
        if self.loop.tick_count >= self.record.ticks:
            return True
        return self.loop.tick_count > 0 and self.loop.ladder.state in (State.OFF, State.FAULT)

    def _plan_due(self) -> bool:
        """Whether a plan is to be asked for now."""
        loop = self.loop
        if loop.pending is not None or self._broken is not None:
            return False
        if loop.ready and loop.plan is None:
            return not self._ending and loop.ladder.fault is None
        if loop.plan is None or loop.ladder.state not in (State.STREAMING, State.HOLD):
            return False
        if self._must_stop():
            return not self._stop_planned and not loop.plan_over
        # Once a plan holds the end of the source nothing new is to be planned.
        return not self._source_over and loop.tick_count >= self._next_plan_tick

    def _must_stop(self) -> bool:
        return self.loop.ladder.stopping or self.loop.ladder.fault is not None or self._ending or self._stream_over()

    def _request(self, ahead: int) -> tuple[int, Plan | None, bool]:
        """Join tick, the plan that plays until then, and whether to stop: all that a plan is made from."""
        loop = self.loop
        return loop.tick_count + ahead, loop.plan, self._must_stop()

    def _make_plan(self, join: int, current: Plan | None, stop: bool) -> Planned:
        return self.planner.plan(join, current, stop=stop)

    def _planned(self, make: Callable[[], Planned]) -> Planned | None:
        """The plan, or None where source or retargeter failed: what plays then ends in its own stop."""
        try:
            return make()
        except (FlexMotionError, ArithmeticError, ValueError, LookupError) as error:
            self._broken = f"{type(error).__name__}: {error}"
            return None

    def _accept(self, planned: Planned | None, asked: int) -> None:
        loop = self.loop
        if planned is None or loop.ladder.state not in (State.READY, State.STREAMING, State.HOLD):
            return
        plan = planned.plan
        if plan.start_tick < loop.tick_count:
            # Never played late. The next one joins at the next slot.
            self.record.underruns += 1
            self._next_plan_tick = loop.tick_count
            return
        if self._stream_start is None:
            self._stream_start = plan.start_tick
        loop.pending = plan
        self._source_over, self._stop_planned = planned.source_over, planned.stops
        self._next_plan_tick = plan.start_tick + self._replan_ticks - (plan.start_tick - asked)
        self.record.plans.append(PlanEvent(asked, plan.start_tick, planned.sample_s, planned.retarget_s))

    def _stamp(self, work: float, lateness: float) -> None:
        row = self.loop.tick_count - 1
        if row < self.record.ticks:
            self.record.work_s[row], self.record.lateness_s[row] = work, lateness

    def _note_truth(self) -> None:
        if not self.driver.capabilities.truth:
            return
        record, row = self.record, self.loop.tick_count - 1
        if row >= record.ticks:
            return
        truth = self.driver.truth()
        record.true_base[row, :3], record.true_base[row, 3:] = truth.base_position, truth.base_quaternion
        record.true_q[row], record.true_com[row] = truth.joint_position, truth.com
        record.true_foot[row], record.true_foot_velocity[row] = truth.foot_position, truth.foot_velocity
        record.true_foot_force[row] = truth.foot_force
        record.true_torque[row], record.true_saturated[row] = truth.torque, truth.saturated
        record.true_self_contact[row] = truth.self_contact


def count_human_steps(motion: Motion, retargeter: Retargeter) -> int:
    """Steps that the human makes in a motion, by the measure of the footstep planner."""
    window = HumanWindow(motion, 0.0, ContactDetector().initial(), None)
    return sum(1 for swing in window.swings if swing.landed and retargeter.footsteps.worth(window, swing))
