"""`Session`: one run of a robot that follows a source with given settings, in lockstep or on the real clock.

`flexmotion.streamer.run.lifecycle.Lifecycle` is the robot's course through it: start, stream, settle, park.
`stepping` steps it in lockstep, `real_time` runs it on the real clock, `answers` collects what it has heard.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from numbers import Real
from types import TracebackType
from typing import Any, Self

from flexmotion.configs.errors import ConfigError, SessionError
from flexmotion.human.body import Body
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.motion.intents import WORDS, Intent
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.part_intents import PartIntent
from flexmotion.streamer.motion.rest import asks_for_rest
from flexmotion.streamer.motion.robot_pace import human_scale
from flexmotion.streamer.motion.sources import LiveSource, Performance, Source
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.run.parts import RunParts
from flexmotion.streamer.run.real_time import run_in_real_time
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session_state import SessionState
from flexmotion.streamer.run.stepping import stepped


class Phase(Enum):
    """A session is run once."""

    NEW = "has not begun"
    RUNNING = "is running"
    ENDED = "has ended"


@dataclass(eq=False, repr=False)
class Session(RunParts):
    """One robot, one source, one run. Its arguments are those of `RunParts`.

    Attributes:
        phase: whether the run has begun and ended.
        elapsed_s: wall-clock time that the last run took [s]; None before its end.
    """

    elapsed_s: float | None = field(init=False, default=None)
    phase: Phase = field(init=False, default=Phase.NEW)
    _entered: ExitStack = field(init=False)
    _step: Callable[[], bool] | None = field(init=False, default=None)
    _over: bool = field(init=False, default=False)  # the last tick has been stepped; the driver may still be open
    _begin_s: float = field(init=False, default=0.0)

    def __repr__(self) -> str:
        parts = (self.robot.name, self.driver.name, self.source.name, self.clock)
        return f"Session({', '.join(map(repr, parts))}: {self.phase.value})"

    def run(self) -> RunTrace:
        """Run to the end and return the record.

        Raises:
            ConfigError: the clock is lockstep and the driver's time cannot be stepped.
            SessionError: the session has begun already.
            DriverError: the driver failed.
        """
        if self.clock == "lockstep":
            with ExitStack() as ending:
                ending.push(self._begun(bool(self.stay)).__exit__)
                while self.step():
                    pass
            return self.record
        self._begin(bool(self.stay))
        try:
            run_in_real_time(self)
            return self.record
        finally:
            self._end()

    # ---------------------------------------------------------------- stepped by a program, in lockstep

    def __enter__(self) -> Self:
        """Open the driver and begin a run that `step` and `advance` carry on.

        Raises:
            ConfigError: the clock is not lockstep, or the driver's time cannot be stepped.
            SessionError: the session has begun already.
            DriverError: the driver failed.
        """
        if self.clock != "lockstep":
            raise ConfigError(f"{self!r}: clock {self.clock!r} passes by itself; call run() instead of stepping")
        endless = isinstance(self.source, LiveSource) and self.seconds is None and _length(self.source) is None
        return self._begun(endless if self.stay is None else self.stay)

    def _begun(self, stay: bool) -> Self:
        self._begin(stay)
        self._entered = ExitStack()
        try:
            self._step = self._entered.enter_context(stepped(self))
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the services and close the driver: torque is off."""
        self._step = None
        try:
            self._entered.__exit__(kind, error, trace)
        finally:
            self._end()

    def _begin(self, stay: bool) -> None:
        if self.phase is not Phase.NEW:
            raise SessionError(f"{self!r}: a session is run once; open another")
        self.phase, self.stay, self._begin_s = Phase.RUNNING, stay, time.perf_counter()

    def _end(self) -> None:
        self.phase, self.elapsed_s = Phase.ENDED, time.perf_counter() - self._begin_s

    def step(self) -> bool:
        """Run one tick; returns whether the run goes on.

        Raises:
            SessionError: the session has not been entered (`with session:`), or has been left.
            DriverError: the driver failed.
        """
        if self._step is None:
            raise SessionError(f"{self!r}: steps are taken within its context: with session: session.step()")
        goes_on = self._step()
        self._over = not goes_on
        return goes_on

    def advance(self, seconds: float) -> bool:
        """Run as many ticks as `seconds` hold, fewer where the run ends; returns whether it goes on. See `step`.

        Raises:
            ConfigError: less than one tick, or no finite number.
        """
        given: Any = seconds  # a program without a type checker may give anything
        finite = isinstance(given, Real) and math.isfinite(given)
        ticks = round(seconds * self.robot.rate_hz) if finite else 0
        if ticks < 1:
            raise ConfigError(f"seconds: {seconds!r}, expected at least a tick, {1.0 / self.robot.rate_hz:g} s")
        return all(self.step() for _ in range(ticks))

    def finish(self) -> RunTrace:
        """Request the end and step to it: the robot comes to a balanced stop, parks, torque goes off. See `step`.

        Of a run that is over already it only gives the record.
        """
        if self._step is None or not self._over:
            self.ask(Request.END)
            while self.step():
                pass
        return self.record

    # ---------------------------------------------------------------- on either clock

    def send(self, intent: Intent, *, holds_s: float = math.inf) -> Target:
        """Set the target that the robot follows from now on.

        A target that the source cannot follow, a clip for a model say, is refused when it is to be followed, by a note.

        Args:
            intent: what to do.
            holds_s: the robot comes to a stand after this time [s]; infinite: it follows until the next target.

        Raises:
            ConfigError: no intent, the source follows no targets, or the target's text is too long.
            SessionError: the run has ended.
        """
        if not isinstance(intent, Intent):
            raise ConfigError(
                f"target: {intent!r}, expected one of: {', '.join(one.__name__ for one in WORDS.values())}"
            )
        if not (isinstance(self.source, LiveSource) or isinstance(intent, PartIntent) or asks_for_rest(intent)):
            raise ConfigError(
                f"{self.source.name}: a source that follows no targets but a stand; a model or a clip library does"
            )
        self._require_open()
        return self.targets.send(intent, holds_s=holds_s)

    def ask(self, request: Request) -> None:
        """Request a stop, an emergency stop or the end; it acts on the next tick.

        Raises:
            ValueError: no `Request`.
            SessionError: the run has ended.
        """
        self._require_open()
        self.requests.send(Request(request))

    def _require_open(self) -> None:
        if self._over or self.phase is Phase.ENDED:
            own = f"{self!r}: " if self.phase is Phase.ENDED else f"the run of {self.robot.name} is over: "
            raise SessionError(f"{own}nothing acts on it any more")

    @property
    def heard(self) -> list[Heard]:
        """The answers so far, each in its newest version: those to the script or the prompt, then those to targets.

        Of a long run the newest thousand targets are kept.
        """
        return self.answers.newest()

    @cached_property
    def human_scale(self) -> float:
        """Metres of the human for one of the robot, by the length of their legs: velocities are those of the human."""
        return human_scale(self.robot, self.source.body if isinstance(self.source, ModelSource) else Body())

    @property
    def state(self) -> SessionState:
        """The newest tick; before the first one with tick -1 and without values (NaN)."""
        row = self.telemetry.ticks.latest()
        if row is None:
            row = blank(TickRow.dtype(joints=self.robot.n))
            row["tick"] = -1
        return SessionState.of(TickRow(row), self.robot.rate_hz)


def _length(source: Source) -> float | None:
    """Length of a source [s]; None: without an end."""
    return source.seconds if isinstance(source, Performance) else None
