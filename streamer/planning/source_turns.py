"""`SourceTurns`: lets the source follow something else from a join on: a target, a program's next step, a person."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError
from flexmotion.human.motion import Motion
from flexmotion.retarget.plan import Plan
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.intents import words_of
from flexmotion.streamer.motion.mirror_source import GOES_ON, MirrorSource
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.rest import heard_as_rest
from flexmotion.streamer.motion.sources import LiveSource
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.motion.undo import Undo
from flexmotion.streamer.planning.planner import Planner
from flexmotion.streamer.planning.step_runner import StepRunner
from flexmotion.streamer.planning.target_ledger import TargetLedger

Float = NDArray[np.float64]


class SourceTurns:
    """Args: the planner with its source, the runner of its programs, the record of targets, and where messages go."""

    def __init__(
        self, planner: Planner, runner: StepRunner | None, ledger: TargetLedger, on_note: Callable[[str], None]
    ) -> None:
        self.planner, self.runner, self.ledger, self.on_note = planner, runner, ledger, on_note
        self._undo: list[Undo] = []

    def to_target(
        self,
        target: Target,
        current: Plan | None,
        join: int,
        row: TickRow,
        stands_at: Callable[[], Float],
        stays: str | None = None,
    ) -> bool:
        """Let the source follow a new target; returns whether it can.

        Args:
            current: the plan that plays until the join.
            row: newest one of the loop.
            stands_at: see `StepRunner.update`.
            stays: why the robot makes no step, for which what travels is refused; None: it may.
        """
        source = self.planner.source
        assert isinstance(source, LiveSource)
        played = self._played(current, join)
        before = None if self.runner is None else self.runner.source.program_at(played[0])
        self._undo = [source.kept(), *([] if self.runner is None else [Undo(self.runner)])]
        try:
            remark = source.turn_to(target, *played)
            if stays is not None and self._travels(played[0] + 1):
                for undo in self._undo:
                    undo()
                raise ConfigError(f"{words_of(target.intent)!r} needs steps: {stays}")
        except ConfigError as error:
            self.ledger.refuse(target, str(error))
            self.on_note(str(error))
            return False
        if remark is not None:
            self.on_note(remark)
        goes_on = False
        if self.runner is not None:
            found = self.runner.source.program_at(played[0] + 1)
            goes_on = before is not None and found is not None and found[1].number == before[1].number
            begin = None if found is None else self.runner.turned(found[1], row, stands_at)
            if begin is not None:
                self.runner.source.change(begin, *played[:2], _added(played[2], self.runner.facing))
        self.ledger.turned(target, source.answer if isinstance(source, ModelSource) else None, goes_on=goes_on)
        return True

    def to_rest(self, target: Target) -> None:
        """Follow a target that asks for a stand, of a source that knows none: from now on it is not followed."""
        source, self._undo = self.planner.source, []
        goes_on = [GOES_ON] if isinstance(source, MirrorSource) else []
        goes_on += [] if isinstance(source, LiveSource) else [f"{source.name} is over"]
        self.ledger.turned(target, heard_as_rest(target.intent, *goes_on), rests=tuple(goes_on))
        self.ledger.halted = "stopped"

    def _travels(self, frame: int) -> bool:
        """Whether the program at a frame moves the robot from its place, or turns it."""
        found = None if self.runner is None else self.runner.source.program_at(frame)
        return found is not None and any(step.moves for step in found[1].steps)

    def give_up(self) -> None:
        """Take back the last turn to a target: its plan is given up for a newer one, and nothing of it is played."""
        for undo in self._undo:
            undo()
        self._undo = []
        self.ledger.give_way()

    def to_step(self, runner: StepRunner, current: Plan | None, join: int) -> None:
        """Let the source go on with what the program has next."""
        frame, played, yaw = self._played(current, join)
        wanted = runner.wanted_from(frame + 1)
        assert wanted is not None
        if runner.facing and wanted is runner.wanted:  # only of a robot that stands
            played, yaw = None, _added(self.planner.human_yaw(join, current), runner.facing)
        runner.source.change(wanted, frame, played, yaw)
        runner.changed()

    def to_person(self, source: MirrorSource, current: Plan | None, join: int) -> None:
        """Let the source follow the person who is seen."""
        source.begin(*self._played(current, join))

    def _played(self, current: Plan | None, join: int) -> tuple[int, Motion | None, float | None]:
        """What a source goes on from: see the last three arguments of `LiveSource.turn_to`."""
        frame = self.planner.first_frame(join, current)
        if current is None or current.human is None:
            return frame, None, self.planner.human_yaw(join, current)
        place = frame - current.human_first_frame
        if not 0 <= place < len(current.human):
            return frame, None, self.planner.human_yaw(join, current)
        return frame, current.human[: place + 1], None


def _added(yaw: float | None, turn: float) -> float | None:
    return None if yaw is None else yaw + turn
