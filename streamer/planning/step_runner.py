"""`StepRunner`: measures at the robot how far a step of a program is, and says what the human does next.

The planner's process calls it with the newest row of the loop. What the robot has done comes from that row alone: way
and turn from the loop's odometry, footsteps from the feet that it lifts, gestures from the measured joints and tilt,
time from its ticks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import End, Halt, Heard, HeardStep
from flexmotion.streamer.motion.intents import Intent, Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.programs import GESTURE_S, Program, Step
from flexmotion.streamer.planning.human_ahead import HumanAhead
from flexmotion.streamer.planning.navigator import STANDING, Navigator, Phase, navigator_for
from flexmotion.streamer.planning.robot_size import RobotSize
from flexmotion.streamer.planning.source_clock import SourceClock
from flexmotion.streamer.planning.standstill import SETTLE_S, Closing, LastRest, Standstill, stopping_place
from flexmotion.streamer.planning.step_amounts import done_of, is_missing, is_reached
from flexmotion.streamer.planning.step_progress import StepProgress, is_raised
from flexmotion.streamer.planning.straight_heading import StraightHeading
from flexmotion.streamer.planning.way_keeper import WayKeeper
from flexmotion.text.phrases import seen_parts

Float = NDArray[np.float64]

_ATTEMPTS = 3
"""Moves towards an amount, the first included."""
_LONGEST_REST_S = 3.0
"""Longest time in which the arms come back after a gesture [s]."""
_LOOK_S = 0.04
"""Gestures are looked at so often [s]: arms' kinematics take up to a millisecond, the fastest gesture half a second."""
_WALKED_S = 1.0
"""A robot that has lifted a foot within this time walks [s]."""
_OVER_S = 0.8
"""A source whose last program is done ends after this time of standing [s]."""


class _Phase(Enum):
    ACT = auto()
    SETTLE = auto()
    LOWER = auto()  # the arms come down while the human stands; then the robot rests
    OVER = auto()


class StepRunner:
    """Follows the programs of a source.

    A robot that is to stand rests: it plays its own balanced stop. A human that is told to stand takes seconds, in
    which the robot steps on and turns with it; it stands only where arms are to come down, on feet that rest.

    Args:
        source: of the human.
        rate_hz: ticks a second.
        on_heard: called with an answer whose steps have ended.
        size: of the robot.
        gesture_way: how far a gesture has brought it from its stand (`GestureWay`).
        home: joint angles of the stand pose, (n,) [rad]; NaN where a joint does not count (legs).
        scale: length of the human's legs over the robot's.

    Attributes:
        wanted: the intent that the human changes to; None: it goes on. `changed` confirms it.
        facing: by how much the human that stands looks to the left of where the robot's feet point [rad].
        resting: the robot is to come to its balanced stop, and stands until something is wanted.
        over: the robot rests, and its source has nothing more.
        aside: what the human that the robot follows looks aside of a straight course, up to a constant [rad].
    """

    def __init__(
        self,
        source: ModelSource,
        rate_hz: float,
        on_heard: Callable[[Heard], None],
        size: RobotSize,
        gesture_way: Callable[[str, Float, Float, Float], Float],
        home: Float | None = None,
        scale: float = 1.0,
    ) -> None:
        self.source, self.rate_hz, self.on_heard = source, rate_hz, on_heard
        self.size, self.home, self.scale = size, home, scale
        self._gesture_way = gesture_way
        self.wanted: Intent | None = None
        self.facing = 0.0
        self.resting = self.over = False
        self.aside = 0.0
        self._program: Program | None = None
        self._coming: Program | None = None  # of the last target, until its first frame is played
        self._index, self._phase = 0, _Phase.OVER
        self._ends: list[HeardStep] = []
        self._at: StepProgress | None = None
        self._navigator: Navigator | None = None
        self._keeper: WayKeeper | None = None  # of a velocity without an amount
        self._straight: StraightHeading | None = None  # of one without a turn
        self._turned: tuple[int, Navigator | None] = (0, None)  # program of the last target, and how it began
        self._clock = SourceClock(rate_hz)
        self._walked_tick = -(10**9)
        self._place, self._last_rest = np.zeros(3), LastRest(rate_hz)

    @property
    def faces(self) -> bool:
        """Whether the human stands and looks where the robot's feet are to point."""
        return self._navigator is not None and self._navigator.phase is Phase.FACE

    @property
    def travels(self) -> bool:
        """Whether what the program does now, or has still to do, moves the robot from its place, or turns it."""
        if self._coming is not None:
            return any(step.moves for step in self._coming.steps)
        program = self._program
        if program is None or self._index == len(program.steps):
            return False
        return any(step.moves for step in program.steps[min(self._index, len(program.steps) - 1) :])

    @property
    def under_way(self) -> Step | None:
        """The step that the robot does, or that its last target begins with; None: none, or all are done."""
        if self._coming is not None:
            return self._coming.steps[0]
        if self._program is None or self._index >= len(self._program.steps):
            return None
        return self._program.steps[self._index]

    def wanted_from(self, frame: int) -> Intent | None:
        """What the human changes to at a frame: what is wanted, or an item of a script that has begun by then."""
        coming = self.source.program_at(frame)
        if coming is None or self._program is None or coming[1].number == self._program.number:
            return self.wanted
        return coming[1].steps[0].begins

    def changed(self) -> None:
        """The human changes to what is wanted."""
        self.wanted, self.facing, self.resting, self.over = None, 0.0, False, False

    def turned(self, program: Program, row: TickRow, stands_at: Callable[[], Float] | None = None) -> Intent | None:
        """The source turns to the program of a target; other arguments as of `update`.

        Returns:
            What the human does first, where the source does not know it: a goal's first move, or the velocity of the
            step under way. None: what the source takes from the program, or the robot rests (`resting`).
        """
        if self._program is not None and program.number == self._program.number:
            return self._at_another_speed(program)
        rested, self._coming = self.resting, program
        self.changed()
        self._place = stopping_place(row, stands_at)
        step = program.steps[0]
        navigator = self._navigator_to(step, row)
        if navigator is not None:
            self._turned = program.number, navigator
            self.facing, self.resting = navigator.facing, navigator.move is None
            return navigator.asked
        if step.stands:
            self.resting = self._walks(row, rested=rested) or (rested and not is_raised(row, self.home))
        if self._keeper is not None and self._is_kept(step):
            return self._keeper.asked  # the same once more: what was learnt of it stays
        return None

    def _at_another_speed(self, program: Program) -> Intent | None:
        """The program under way goes on at another speed, or at the same: what its human does from now on, as above."""
        if self._index >= len(program.steps):
            return None
        step = program.steps[self._index]
        if self._navigator is not None:
            self._navigator = self._navigator.with_beside(step.beside)
            if step.is_led and isinstance(step.intent, Velocity):
                self._navigator = self._navigator.at(step.intent.turning)
            return self._navigator.asked
        if self._keeper is None:
            return None
        # Of a human that was steered the source does not know which step it does.
        return self._keeper.asked if self._is_kept(step) else step.intent

    def update(self, row: TickRow, *, halted: Halt | None = None, stands_at: Callable[[], Float] | None = None) -> None:
        """Take the newest row of the loop.

        Args:
            halted: what was asked for has ended, and how; None: it has not.
            stands_at: gives where the robot comes to stand if it stops now, in the plan's world (`stopping_place`).
        """
        if not np.all(row.contact_ref):
            self._walked_tick = int(row.tick)
        self._last_rest.update(row)
        if halted or bool(row.must_stop) or int(row.state) not in (State.STREAMING, State.HOLD):
            self._abandon(halted or "stopped", row)
            if halted:
                self._drop_coming(halted, row)
            return
        if not math.isfinite(source_s := self._clock.second(row, runs_on=self.resting)):
            return
        frame = int(source_s * self.source.fps)
        found = self.source.program_at(frame)
        if found is None:
            return
        program = found[1]
        if self._coming is not None and program.number == self._coming.number:
            self._coming = None
        begins = self._program is None or program.number != self._program.number
        if begins or self._phase is not _Phase.OVER:  # else nothing is measured by it, and it is half of the work here
            rested = self._last_rest.place if begins else None
            self._place = stopping_place(row, stands_at) if rested is None else rested
        if begins:
            self._abandon("superseded", row)
            self._begin(program, row)
        elif program is not self._program:
            self._program = program  # at another speed
            self._ends = [*self._ends[: self._index], *program.heard.steps[self._index :]]
            if self._index < len(program.steps):
                self._keep_from(program.steps[self._index], row)
        self.over = self.resting and self.source.is_over(frame)
        if self._keeper is not None and np.isfinite(row.odometry).all():
            self._keep(self._keeper, row, HumanAhead(self.source, source_s))
        if self._phase is _Phase.OVER or self._at is None or not np.isfinite(row.odometry).all():
            return
        step = program.steps[min(self._index, len(program.steps) - 1)]
        self._at.measure(step, row, self._place, resting=self.resting)
        if self.wanted is None:
            self._advance(self._at, step, row)
            if self._is_done(program):
                self.source.finish(frame + round(_OVER_S * self.source.fps))

    # ------------------------------------------------------------ programs and steps

    def _is_done(self, program: Program) -> bool:
        """Whether the last step has ended."""
        return self._phase is _Phase.OVER and self._index == len(program.steps)

    def _begin(self, program: Program, row: TickRow) -> None:
        self._program, self._index = program, 0
        self._ends = list(program.heard.steps)
        number, navigator = self._turned
        if navigator is not None and number == program.number:
            self._navigator, self._phase, self._at = navigator, _Phase.ACT, self._fresh(row)
            self._keep_from(program.steps[0], row)
            return
        step = program.steps[0]
        # While the robot rests nobody follows the script.
        self._start(step, row, step.intent if self.resting else None)

    def _start(self, step: Step, row: TickRow, intent: Intent | None) -> None:
        """Begin a step; `intent`: what the human changes to, None where it has already."""
        self._phase, self._at, self._navigator = _Phase.ACT, self._fresh(row), self._navigator_to(step, row)
        if self._navigator is not None:
            self._follow(self._navigator)
        elif step.stands and (self.resting or self._walks(row)):
            self._settle(self._at, row)
        elif step.stands and step.told.manner is None:
            self._phase, self.wanted = _Phase.LOWER, intent
        else:
            self.wanted = intent
        if step.amount is None and self._phase is _Phase.ACT and self._navigator is None:
            self._phase = _Phase.OVER  # until something else is asked
        self._keep_from(step, row)

    def _keep_from(self, step: Step, row: TickRow) -> None:
        """Keep the velocity of a step from now on, unless it is kept already.

        From one velocity without a turn to the next the heading stays.
        """
        if self._is_kept(step):
            return
        before, self._keeper = self._keeper, self._keeper_of(step, row)
        if before is None or self._keeper is None or before.wanted.turning or self._keeper.wanted.turning:
            self._straight = None

    def _keep(self, keeper: WayKeeper, row: TickRow, ahead: HumanAhead) -> None:
        """Keep a velocity, and the heading where it is to stay."""
        time_s, facing = int(row.tick) / self.rate_hz, float(row.odometry[2])
        asked = keeper.update(row.odometry, time_s, ahead)
        if asked is not None:
            self.source.steer(asked)
        if keeper.wanted.turning:
            return
        if self._straight is None:
            self._straight = StraightHeading(facing, time_s, self.aside)
        self._straight.update(facing, time_s, ahead)
        self.aside = self._straight.aside

    def _keeper_of(self, step: Step, row: TickRow) -> WayKeeper | None:
        """Who keeps an operator's velocity until something else is asked; a script's human is known before it runs."""
        assert self._program is not None
        if not self._program.heard.id or self._phase is not _Phase.OVER or not isinstance(step.intent, Velocity):
            return None
        if not any((step.intent.forward, step.intent.left, step.intent.turning)) or not np.isfinite(row.odometry).all():
            return None
        return WayKeeper(step.intent, self.source.pace, self.scale, row.odometry, int(row.tick) / self.rate_hz)

    def _is_kept(self, step: Step) -> bool:
        """Whether a step is the velocity that is kept already."""
        return step.amount is None and self._keeper is not None and step.intent == self._keeper.wanted

    def _second(self, row: TickRow) -> float:
        return round(int(row.tick) / self.rate_hz, 3)

    def _fresh(self, row: TickRow) -> StepProgress:
        return StepProgress.begun(row, self._place, self.size)

    def _abandon(self, end: End, row: TickRow) -> None:
        """The program ends before it is done."""
        if self._program is not None and self._index < len(self._program.steps) and not self._program.is_open:
            known = {"end": end, "end_s": self._second(row)}
            self._ends = [step if step.end is not None else step.model_copy(update=known) for step in self._ends]
            self._ends[self._index] = self._ends[self._index].model_copy(update=self._cut(end, row))
            self._publish()
            self._index = len(self._program.steps)
        self._phase, self.wanted, self.resting = _Phase.OVER, None, self.resting and end == "superseded"
        if end != "superseded":
            self._keeper = self._straight = None
            if self._program is not None:
                self.source.stopped(self._program)

    def _drop_coming(self, end: Halt, row: TickRow) -> None:
        """Its end came before the first frame of the last target's program was played: nothing of it is under way."""
        coming, self._coming = self._coming, None
        if coming is None:
            return
        self._program, self._index = coming, len(coming.steps)
        self._ends = list(coming.heard.steps)
        if not coming.is_open:
            known = {"end": end, "end_s": self._second(row)}
            self._ends = [step.model_copy(update=known) for step in self._ends]
            self._publish()
        self.source.stopped(coming)

    def _cut(self, end: End, row: TickRow) -> dict[str, object]:
        """What is known of the step under way when its program is ended.

        A stop may come when its amount is done and the robot only comes to rest. A time is done when it is over. Of a
        robot with a fault nothing is done: one that tips over has turned, too, and does not come to rest.
        """
        assert self._program is not None and self._at is not None
        step = self._program.steps[self._index]
        value = None
        if step.amount is not None:
            value = done_of(self._at, step, (int(row.tick) - self._at.begin_tick) / self.rate_hz)
            missing = step.amount.value - value
            rests = self._phase is not _Phase.ACT and step.amount.quantity != "time"
            reached = not is_missing(step, missing, self.size) if rests else missing <= 0.0
            if end != "superseded" and reached and not bool(row.faulted):
                end = "done"
        return self._known(step, row, end, value)

    def _known(self, step: Step, row: TickRow, end: End, measured: float | None) -> dict[str, object]:
        """What the answer says of a step that has ended."""
        known: dict[str, object] = {"end": end, "end_s": self._second(row)}
        if measured is not None:
            known["measured"] = round(measured, 4)
        if step.goal is not None:
            known["place"] = tuple(round(float(value), 4) for value in self._place)
        return known

    def _next(self, row: TickRow, end: End, measured: float | None) -> None:
        """A step has ended."""
        assert self._program is not None
        ended = self._program.steps[self._index]
        known = self._known(ended, row, end, measured)
        self._ends[self._index] = self._ends[self._index].model_copy(update=known)
        self._index += 1
        if self._index < len(self._program.steps):
            step = self._program.steps[self._index]
            self._start(step, row, step.intent)
        else:
            self._come_to_rest(ended, row)
        self._publish()

    def _come_to_rest(self, ended: Step, row: TickRow) -> None:
        """The last step has ended. Arms that a gesture has raised come down while the feet rest."""
        raised = is_raised(row, self.home)
        if raised and ended.stands and self._phase in (_Phase.SETTLE, _Phase.LOWER):
            return  # it took no longer, and they still come down
        if not raised or ended.stands or (ended.moves and ended.beside is None):
            self._phase, self.resting = _Phase.OVER, True
            return
        self._at = self._fresh(row)
        if self._walks(row):
            self._settle(self._at, row)
        else:
            self._phase, self.wanted = _Phase.LOWER, STANDING

    def _publish(self) -> None:
        assert self._program is not None
        self.on_heard(self._program.heard.model_copy(update={"steps": tuple(self._ends)}))

    def _walks(self, row: TickRow, *, rested: bool = False) -> bool:
        """Whether the robot has stepped just now, or what it does moves it; `rested`: it came to a stand before."""
        if int(row.tick) - self._walked_tick < _WALKED_S * self.rate_hz:
            return True
        program = self._program
        under_way = program is not None and self._index < len(program.steps) and not (self.resting or rested)
        return under_way and program is not None and program.steps[self._index].moves

    # ------------------------------------------------------------ one step

    def _advance(self, at: StepProgress, step: Step, row: TickRow) -> None:
        """Change the phase where the robot has done what the phase asks."""
        assert self._program is not None
        tick = int(row.tick)
        done = self._index >= len(self._program.steps)
        if done or (step.amount is None and step.goal is None):
            if self._phase is _Phase.SETTLE and self._is_settled(at, row):
                self._rest(step, row)
            elif self._phase is _Phase.LOWER and self._is_lowered(at, row):
                self._phase, self.resting = _Phase.OVER, True
            return
        if step.amount is None:
            self._navigate(row, None)
            return
        assert step.limit_s is not None
        quantity, amount = step.amount.quantity, step.amount.value
        value = done_of(at, step, (tick - at.begin_tick) / self.rate_hz)
        elapsed_s = (tick - at.begin_tick) / self.rate_hz
        if elapsed_s > step.limit_s:
            # All of a gesture may be counted while the robot still comes to rest after it.
            done = quantity == "times" and value >= amount
            self._next(row, "done" if done else "time limit", value)
        elif self._navigator is not None:
            self._navigate(row, value)
        elif quantity == "time":
            self._advance_time(at, step, row, elapsed_s)
        elif step.rhythm is not None:
            if value >= amount:
                self._next(row, "done", value)
        elif quantity == "times":
            self._advance_gesture(at, step, row)
        elif self._phase is _Phase.ACT:
            if is_reached(at, step, value):
                self._settle(at, row)
        elif self._is_settled(at, row):
            missing = amount - value
            again = is_missing(step, missing, self.size) and not (quantity == "steps" and missing < 0.0)
            if at.attempts < _ATTEMPTS and again:
                at.attempts += 1
                self._act(at, step, value, tick)
            else:
                self._next(row, "time limit" if is_missing(step, missing, self.size) else "done", value)

    def _advance_time(self, at: StepProgress, step: Step, row: TickRow, elapsed_s: float) -> None:
        assert step.amount is not None
        if elapsed_s >= step.amount.value:
            self._next(row, "done", elapsed_s)
        elif (
            self._phase is _Phase.SETTLE
            and at.attempts == 1
            and self._is_settled(at, row)
            and is_raised(row, self.home)
        ):
            self._phase, self.wanted, at.act_tick, at.attempts = _Phase.LOWER, step.intent, int(row.tick), 2
        elif self._phase is _Phase.LOWER and self._is_lowered(at, row):
            self._settle(at, row)

    def _rest(self, step: Step, row: TickRow) -> None:
        """The robot stands; where its arms are raised, or a manner is asked for, the human stands too."""
        assert self._program is not None
        self._phase, over = _Phase.OVER, self._index == len(self._program.steps)
        if step.told.manner is not None and not over:
            self.wanted = step.intent
        elif is_raised(row, self.home):
            asked = STANDING if over else step.intent
            self._phase, self.wanted, self._at = _Phase.LOWER, asked, self._fresh(row)

    def _is_lowered(self, at: StepProgress, row: TickRow) -> bool:
        phase_s = (int(row.tick) - at.act_tick) / self.rate_hz
        return phase_s >= _LONGEST_REST_S or (phase_s >= SETTLE_S and at.arms_rest(row, self.rate_hz))

    # ------------------------------------------------------------ goals in the odometry

    def _navigator_to(self, step: Step, row: TickRow) -> Navigator | None:
        return navigator_for(step, self.source.pace, self._place, int(row.tick) / self.rate_hz, self.size)

    def _navigate(self, row: TickRow, measured: float | None) -> None:
        navigator = self._navigator
        assert navigator is not None
        before = navigator.move
        navigator.update(self._place, int(row.tick) / self.rate_hz)
        if navigator.move is not before:
            self._follow(navigator)
        if navigator.over:
            self._next(row, "done" if navigator.arrived else "time limit", measured)

    def _follow(self, navigator: Navigator) -> None:
        self.wanted, self.facing = navigator.asked, navigator.facing
        self.resting |= navigator.move is None

    # ------------------------------------------------------------ amounts

    def _settle(self, at: StepProgress, row: TickRow) -> None:
        self._phase, self.resting = _Phase.SETTLE, True
        at.act_tick, at.standstill = int(row.tick), Standstill(at.place, int(row.tick) / self.rate_hz, self.size)

    def _act(self, at: StepProgress, step: Step, value: float, tick: int) -> None:
        """Another attempt, at what is missing."""
        assert step.amount is not None
        self._phase, self.wanted = _Phase.ACT, step.intent
        if step.amount.quantity == "angle" and isinstance(step.intent, Velocity) and value > step.amount.value:
            self.wanted = replace(step.intent, turning=-step.intent.turning)
        at.act_tick, at.acted_from = tick, value
        at.closing = Closing()

    def _is_settled(self, at: StepProgress, row: TickRow) -> bool:
        assert at.standstill is not None
        return at.standstill.settled(at.place, int(row.tick) / self.rate_hz)

    def _look(self, at: StepProgress, step: Step, row: TickRow) -> None:
        """Count the gestures that are seen by now."""
        tick = int(row.tick)
        due = at.looked_tick is None or tick - at.looked_tick >= _LOOK_S * self.rate_hz
        if due and np.isfinite(row.q).all() and np.isfinite(row.tilt).all():
            at.repetitions.update(float(self._gesture_way(step.kind, row.q, row.tilt, at.joints)))
            at.looked_tick = tick

    def _advance_gesture(self, at: StepProgress, step: Step, row: TickRow) -> None:
        """Ask for the gesture until it has come back by itself or has taken its time; then stand until it is over."""
        assert step.amount is not None
        tick, made = int(row.tick), at.repetitions
        phase_s = (tick - at.act_tick) / self.rate_hz
        self._look(at, step, row)
        # A human that has bowed stands bent by 20°; the robot's own stop straightens it, but holds raised arms up.
        rests = "arm" not in seen_parts(step.kind)
        if self._phase is _Phase.ACT:
            # A model that is asked on begins the next one.
            if rests and made.done > at.acted_from:
                self._settle(at, row)
            elif made.done > at.acted_from or phase_s >= GESTURE_S:
                self._phase, self.wanted, at.act_tick = _Phase.SETTLE, STANDING, tick
            return
        late = phase_s >= _LONGEST_REST_S
        if self.resting:
            over = self._is_settled(at, row)
        elif rests and (late or not made.away):
            self._settle(at, row)
            return
        else:
            over = late or (phase_s >= SETTLE_S and not made.away and at.arms_rest(row, self.rate_hz))
        if over and made.done >= step.amount.value:
            self._next(row, "done", made.done)
        elif over:
            self._phase, self.wanted, at.act_tick, at.acted_from = _Phase.ACT, step.intent, tick, made.done
