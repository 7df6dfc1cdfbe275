"""`StepRunner`: measures at the robot how far a step of a program is, and says what the human does next.

The planner's process calls it with the newest row of the loop. What the robot has done comes from that row alone: way
and turn from the loop's odometry, footsteps from the feet that it lifts, arms from the measured joints, time from its
ticks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from enum import Enum, auto

import numpy as np

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import End, Heard, HeardStep
from flexmotion.streamer.motion.intents import Intent, Text, Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.programs import GESTURE_S, Program, Step
from flexmotion.streamer.planning.step_progress import STILL_S, StepProgress

STANDING = Text("stand still")

_TURN_AHEAD_S, _WALK_AHEAD_S = 0.05, 0.2
"""A robot that is to stop turns and walks on for about this long at its speed [s]."""
_SPEED_S = 1.0
"""The speed is the mean over this time [s]: the torso sways with every step."""
_SETTLE_S, _LONGEST_SETTLE_S = 1.0, 4.0
"""After a walk or a turn the robot stands at least and at most this long before it is measured [s]."""
_STILL_M, _STILL_RAD = 0.008, np.radians(1.5)
"""It stands still when it has moved less than this in `STILL_S` [m, rad]."""
_TURN_TOLERANCE, _WAY_TOLERANCE = np.radians(12.0), 0.12
"""What is missing of a turn [rad], or of a way (share of it), is done in another attempt."""
_ATTEMPTS = 3
_LEAST_WAY_M = 0.03
"""A way that is shorter is not worth another attempt [m]."""
_MOVED_RAD = 0.35
"""A gesture moves a joint from where it was by at least this [rad]."""
_LONGEST_REST_S = 3.0
"""Longest time in which the arms come back after a gesture [s]."""


class _Phase(Enum):
    ACT = auto()
    SETTLE = auto()
    OVER = auto()


class StepRunner:
    """Follows the programs of a source.

    Args:
        source: of the human.
        rate_hz: ticks a second.
        on_heard: called with an answer whose steps have ended.

    Attributes:
        wanted: the intent that the human changes to; None: it goes on. `changed` confirms it.
        resting: the robot is to come to its balanced stop, and stands until something is wanted. A human that is told
            to stand takes seconds, in which the robot walks on.
        done: whether the newest program is done.
    """

    def __init__(self, source: ModelSource, rate_hz: float, on_heard: Callable[[Heard], None]) -> None:
        self.source, self.rate_hz, self.on_heard = source, rate_hz, on_heard
        self.wanted: Intent | None = None
        self.done = self.resting = False
        self._program: Program | None = None
        self._index, self._phase = 0, _Phase.OVER
        self._ends: list[HeardStep] = []
        self._at: StepProgress | None = None
        self._source_s, self._source_tick = math.nan, 0

    def changed(self) -> None:
        """The human changes to what is wanted, or to a new target."""
        self.wanted, self.resting = None, False

    def update(self, row: TickRow, *, halted: bool = False) -> None:
        """Take the newest row of the loop; `halted`: what was asked for has ended by a stop, or by its age."""
        source_s, tick = float(row.source_s), int(row.tick)
        if halted or bool(row.must_stop) or int(row.state) not in (State.STREAMING, State.HOLD):
            self._abandon("stopped")
            return
        if math.isfinite(source_s):
            self._source_s, self._source_tick = source_s, tick
        elif self.resting:
            source_s = self._source_s + (tick - self._source_tick) / self.rate_hz
        if not math.isfinite(source_s):
            return
        found = self.source.program_at(int(source_s * self.source.fps))
        if found is None:
            return
        program = found[1]
        if self._program is None or program.number != self._program.number:
            self._abandon("superseded")
            self._begin(program, row)
        elif program is not self._program:
            self._program = program  # at another speed
            self._ends = [*self._ends[: self._index], *program.heard.steps[self._index :]]
        if self._phase is _Phase.OVER or self._at is None or not np.isfinite(row.odometry).all():
            return
        step = program.steps[self._index]
        self._at.measure(step, row)
        if self.wanted is None:
            self._advance(self._at, step, row)

    # ------------------------------------------------------------ programs and steps

    def _begin(self, program: Program, row: TickRow) -> None:
        self._program, self._index, self.done = program, 0, False
        # While the robot rests nobody follows the script.
        self.wanted = program.steps[0].intent if self.resting else None
        self._ends = list(program.heard.steps)
        self._phase = _Phase.OVER if program.is_open else _Phase.ACT
        self._at = None if program.is_open else self._fresh(row)

    def _fresh(self, row: TickRow) -> StepProgress:
        tick = int(row.tick)
        place = np.nan_to_num(np.array(row.odometry, float))
        return StepProgress(
            begin_tick=tick,
            act_tick=tick,
            acted_from=0.0,
            place=place,
            joints=np.array(row.q, float),
        )

    def _abandon(self, end: End) -> None:
        """The program ends before it is done."""
        if self._program is not None and self._phase is not _Phase.OVER:
            self._ends = [step if step.end is not None else step.model_copy(update={"end": end}) for step in self._ends]
            self._publish()
        self._phase, self.wanted, self.resting = _Phase.OVER, None, self.resting and end == "superseded"

    def _next(self, row: TickRow, end: End, measured: float) -> None:
        """A step has ended."""
        assert self._program is not None
        told = self._ends[self._index].model_copy(update={"end": end, "measured": round(measured, 4)})
        self._ends[self._index] = told
        self._index += 1
        if self._index < len(self._program.steps):
            step = self._program.steps[self._index]
            self._phase, self._at, self.wanted = _Phase.ACT, self._fresh(row), step.intent
            if step.amount is None:
                self._phase = _Phase.OVER  # until something else is asked
        else:
            self._phase, self.wanted, self.done = _Phase.OVER, STANDING, True
        self._publish()

    def _publish(self) -> None:
        assert self._program is not None
        self.on_heard(self._program.heard.model_copy(update={"steps": tuple(self._ends)}))

    # ------------------------------------------------------------ one step

    def _advance(self, at: StepProgress, step: Step, row: TickRow) -> None:
        """Change the phase where the robot has done what the phase asks."""
        assert step.amount is not None and step.limit_s is not None
        tick, quantity, amount = int(row.tick), step.amount.quantity, step.amount.value
        value = self._value(at, step, row)
        elapsed_s = (tick - at.begin_tick) / self.rate_hz
        if elapsed_s > step.limit_s:
            self._next(row, "time limit", value)
            return
        if quantity == "time":
            if elapsed_s >= amount:
                self._next(row, "done", elapsed_s)
        elif quantity == "times":
            self._advance_gesture(at, step, row)
        elif self._phase is _Phase.ACT:
            at.recent.append((tick, value))
            while at.recent[0][0] < tick - _SPEED_S * self.rate_hz:
                at.recent.popleft()
            if self._reached(at, step, value, tick):
                self._settle(at, tick)
        elif self._is_settled(at, tick):
            missing = amount - value
            again = self._is_missing(step, missing) and not (step.amount.quantity == "steps" and missing < 0.0)
            if at.attempts < _ATTEMPTS and again:
                at.attempts += 1
                self._act(at, step, value, tick)
            else:
                self._next(row, "time limit" if self._is_missing(step, missing) else "done", value)

    def _value(self, at: StepProgress, step: Step, row: TickRow) -> float:
        """What is done of the amount, in its unit."""
        assert step.amount is not None
        match step.amount.quantity:
            case "angle":
                return at.turned * (step.turn or 1)
            case "length":
                if step.axis == (0, 0):
                    return math.hypot(at.ahead, at.aside)
                return at.ahead * step.axis[0] + at.aside * step.axis[1]
            case "steps":
                return float(at.steps(step))
            case "times":
                return float(at.counted)
        return (int(row.tick) - at.begin_tick) / self.rate_hz

    def _reached(self, at: StepProgress, step: Step, value: float, tick: int) -> bool:
        """Whether the robot will have done the amount if its human stands from now on."""
        assert step.amount is not None
        amount = step.amount.value
        if step.amount.quantity == "steps":
            return value >= amount
        (first, before), (last, now) = at.recent[0], at.recent[-1]
        speed = (now - before) * self.rate_hz / max(last - first, 1)
        ahead = value + speed * (_TURN_AHEAD_S if step.amount.quantity == "angle" else _WALK_AHEAD_S)
        return ahead <= amount if at.acted_from > amount else ahead >= amount

    def _is_missing(self, step: Step, missing: float) -> bool:
        assert step.amount is not None
        match step.amount.quantity:
            case "angle":
                return abs(missing) > _TURN_TOLERANCE
            case "length":
                return missing > max(_WAY_TOLERANCE * step.amount.value, _LEAST_WAY_M)  # walks do not go back
        # The other foot may close the stance.
        return not -1.5 < missing < 0.5

    def _settle(self, at: StepProgress, tick: int) -> None:
        self._phase, self.resting = _Phase.SETTLE, True
        at.act_tick, at.still = tick, (tick, at.place.copy())

    def _act(self, at: StepProgress, step: Step, value: float, tick: int) -> None:
        """Another attempt, at what is missing."""
        assert step.amount is not None
        self._phase, self.wanted = _Phase.ACT, step.intent
        if step.amount.quantity == "angle" and isinstance(step.intent, Velocity) and value > step.amount.value:
            self.wanted = replace(step.intent, turning=-step.intent.turning)
        at.act_tick, at.acted_from = tick, value
        at.recent.clear()

    def _is_settled(self, at: StepProgress, tick: int) -> bool:
        since_s = (tick - at.act_tick) / self.rate_hz
        assert at.still is not None
        from_tick, place = at.still
        moved = np.abs(at.place - place)
        if moved[:2].max() > _STILL_M or moved[2] > _STILL_RAD:
            at.still = (tick, at.place.copy())
        still_s = (tick - at.still[0]) / self.rate_hz
        return since_s >= _LONGEST_SETTLE_S or (since_s >= _SETTLE_S and still_s >= STILL_S)

    def _advance_gesture(self, at: StepProgress, step: Step, row: TickRow) -> None:
        assert step.amount is not None
        tick = int(row.tick)
        phase_s = (tick - at.act_tick) / self.rate_hz
        if self._phase is _Phase.ACT:
            at.acted_from = max(at.acted_from, at.deviation)
            if phase_s >= GESTURE_S:
                at.counted += int(at.acted_from > _MOVED_RAD)
                self._phase, self.wanted, at.act_tick = _Phase.SETTLE, STANDING, tick
        elif phase_s >= _LONGEST_REST_S or (phase_s >= _SETTLE_S and at.arms_rest(row, self.rate_hz)):
            if at.counted >= step.amount.value:
                self._next(row, "done", at.counted)
            else:
                self._phase, self.wanted, at.act_tick, at.acted_from = _Phase.ACT, step.intent, tick, 0.0
