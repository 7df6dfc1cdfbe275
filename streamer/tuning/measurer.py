"""`ProcessMeasurer`: measures in processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from flexmotion.streamer.tuning.figures import AskedWay, RunFigures
from flexmotion.streamer.tuning.trial import Question, Trial, asked_way, died, try_out
from flexmotion.streamer.tuning.workers import Workers


class ProcessMeasurer:
    """Runs trials in processes; see `flexmotion.streamer.tuning.campaign.Measurer`.

    Args:
        workers: that run them.
        done: called after every run.
    """

    def __init__(self, workers: Workers, done: Callable[[], None] = lambda: None) -> None:
        self.workers, self.done = workers, done

    def trials(self, trials: Sequence[Trial]) -> list[RunFigures]:
        """Figures of each trial, in order."""
        return self.workers.run(try_out, trials, died, self.done)

    def ways(self, questions: Sequence[Question]) -> list[AskedWay | str]:
        """The way of each clip, or why it cannot be measured on."""
        return self.workers.run(asked_way, questions, lambda asked: f"{asked.clip.name}: the process that read it died")
