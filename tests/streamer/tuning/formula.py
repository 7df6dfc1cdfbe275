"""A robot that is a formula: quick to measure, and with a known best."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from flexmotion.streamer.tuning.figures import AskedWay, RunFigures
from flexmotion.streamer.tuning.trial import Question, Trial

NUMBERS = ("gait.clearance", "gait.double_support_min_s")
BEST = {"gait.clearance": 0.025, "gait.double_support_min_s": 0.12}
"""Numbers with which the formula goes the whole way."""


class FormulaMeasurer:
    """Measures by a formula; a candidate whose clearance is below `breaks_below` cannot run.

    Attributes:
        batches: number of batches of trials measured.
        interrupt: batch that is interrupted, from 0; None: none is.
    """

    breaks_below = 0.0

    def __init__(self, interrupt: int | None = None, done: Callable[[], None] = lambda: None) -> None:
        self.batches, self.interrupt, self.done = 0, interrupt, done

    def trials(self, trials: Sequence[Trial]) -> list[RunFigures]:
        if self.batches == self.interrupt:
            raise KeyboardInterrupt
        self.batches += 1
        for _ in trials:
            self.done()
        return [self.figures(trial) for trial in trials]

    def figures(self, trial: Trial) -> RunFigures:
        clip, values = trial.clip, {str(at[-1]): value for at, value in trial.values}
        if values["clearance"] < self.breaks_below:
            return RunFigures.failed(clip.name, clip.kind, clip.perturbed, "RetargetError: no swing")
        away = abs(values["clearance"] - 0.025) / 0.02 + abs(values["double_support_min_s"] - 0.12) / 0.2
        return RunFigures(
            clip=clip.name, kind=clip.kind, perturbed=clip.perturbed, upright=True, lasted=1.0, way_share=1.0 - away / 2
        )

    def ways(self, questions: Sequence[Question]) -> list[AskedWay | str]:
        return [AskedWay(way_m=3.0) for _ in questions]
