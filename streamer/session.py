"""A whole run: robot up, source streamed, robot parked; on a clock that steps (lockstep) or one that passes (real)."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

from configs.robot import Robot
from configs.stream import StreamSettings
from drivers.interface import Driver
from flexmotion.contacts import ContactDetector
from flexmotion.motion import Motion
from retarget.human import HumanWindow
from retarget.retargeter import Retargeter
from streamer.ladder import State
from streamer.loop import ControlLoop
from streamer.planner import Planned, Planner
from streamer.record import PlanEvent, RunRecord
from streamer.sources import Source

_SETTLE_S = 1.0
"""How long the robot stands in HOLD after the source is over, before it parks."""
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
        self._stopping = False

    def run(self, clock: str = "lockstep") -> RunRecord:
        """Run to the end on clock "lockstep" or "real" and return the record."""
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
                self._accept(self._make_plan(self._join_tick()), self.loop.tick_count)
            begin = time.perf_counter()
            self.loop.tick()
            self._stamp(work + time.perf_counter() - begin, 0.0)
            self.driver.advance(period)
            self._note_truth()

    def _run_real(self) -> None:
        period_ns = int(round(1e9 / self.robot.rate_hz))
        lockstep = self.driver.capabilities.lockstep
        pending: Future[Planned] | None = None
        asked = 0
        with ThreadPoolExecutor(1, "planner") as pool:
            deadline = time.perf_counter_ns()
            while not self._finished():
                late = time.perf_counter_ns() - deadline
                begin = time.perf_counter()
                self._operate()
                if pending is None and self._plan_due():
                    asked = self.loop.tick_count
                    pending = pool.submit(self._make_plan, self._join_tick(ahead=True))
                elif pending is not None and pending.done():
                    self._accept(pending.result(), asked)
                    pending = None
                self.loop.tick()
                work = time.perf_counter() - begin
                self._stamp(work, late * 1e-9)
                if lockstep:
                    self.driver.advance(1.0 / self.robot.rate_hz)
                    self._note_truth()
                deadline += period_ns
                behind = time.perf_counter_ns() - deadline
                if behind > 0:
                    self.record.missed_deadlines += 1
                    # Clamp, never re-time: the ticks that were missed are skipped, not caught up.
                    deadline += (behind // period_ns) * period_ns
                else:
                    time.sleep(-behind * 1e-9)

    # ---------------------------------------------------------------- one tick

    def _operate(self) -> None:
        """Act as the operator of the run: start, let it stream, settle, park."""
        loop, inputs = self.loop, self.loop.inputs
        state = loop.ladder.state
        if state is State.OFF and loop.tick_count == 0:
            inputs.start = True
        if self.stop_requested is not None and not self._stopping and self.stop_requested():
            self._stopping = True
            inputs.stop = True
            if state is State.READY:
                inputs.park = True
        if state is State.HOLD:
            self._hold_ticks += 1
            over = self.planner.over or self._stopping or self._stream_over()
            if over and self._hold_ticks >= _SETTLE_S * self.robot.rate_hz:
                inputs.park = True
        else:
            self._hold_ticks = 0
        if self.progress is not None:
            self.progress(min(self._streamed_s() / max(self.seconds, 1e-9), 1.0))

    def _streamed_s(self) -> float:
        if self._stream_start is None:
            return 0.0
        return (self.loop.tick_count - self._stream_start) / self.robot.rate_hz

    def _stream_over(self) -> bool:
        return self._streamed_s() >= self.seconds

    def _finished(self) -> bool:
        if self.loop.tick_count >= self.record.ticks:
            return True
        return self.loop.tick_count > 0 and self.loop.ladder.state in (State.OFF, State.FAULT)

    def _plan_due(self) -> bool:
        loop = self.loop
        if loop.pending is not None:
            return False
        if loop.ready and loop.plan is None:
            return not self._stopping
        if loop.ladder.state is not State.STREAMING:
            return False
        if loop.plan is None or loop.tick_count < self._next_plan_tick:
            return False
        # Once a plan holds the end of the source, or a stop, nothing new is to be planned.
        ending = self.planner.over or self._plan_stops
        return not ending or (self._must_stop() and not self._plan_stops)

    _plan_stops = False

    def _must_stop(self) -> bool:
        return self.loop.ladder.stopping or self._stopping or self._stream_over()

    def _join_tick(self, *, ahead: bool = False) -> int:
        """Tick at which a plan asked for now takes over; on the real clock it must first be made."""
        if self.loop.plan is None:
            return self.loop.tick_count + (self._replan_ticks if ahead else 0)
        return self.loop.tick_count + (self._replan_ticks // 2 if ahead else self._commit_ticks)

    def _make_plan(self, join: int) -> Planned:
        self._plan_stops = self._must_stop()
        return self.planner.plan(join, self.loop.plan, stop=self._plan_stops)

    def _accept(self, planned: Planned, asked: int) -> None:
        plan = planned.plan
        if plan.start_tick < self.loop.tick_count and self.loop.plan is not None:
            # Late: never played late. The next one joins at the next slot.
            self.record.underruns += 1
            self._next_plan_tick = self.loop.tick_count
            return
        if self._stream_start is None:
            self._stream_start = plan.start_tick
        self.loop.pending = plan
        self._next_plan_tick = plan.start_tick + self._replan_ticks - self._commit_ticks
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
