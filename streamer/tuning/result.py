"""`TuningResult`: the numbers found by a campaign, and the figures before and after."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from flexmotion.streamer.report.figure import Section
from flexmotion.streamer.tuning.campaign import Plan
from flexmotion.streamer.tuning.figures import MeanFigures, RunFigures
from flexmotion.streamer.tuning.objective import STATEMENT, cost_of
from flexmotion.streamer.tuning.state import Campaign, CampaignState


class FoundNumber(Section):
    """A number before and after, with its bounds, all in `unit`."""

    unit: str
    low: float
    high: float
    before: float
    after: float


class ListFigures(Section):
    """Figures on one list: cost, means and runs."""

    cost: float
    mean: MeanFigures
    runs: tuple[RunFigures, ...]

    @classmethod
    def of(cls, runs: tuple[RunFigures, ...]) -> ListFigures:
        """Of the runs of a list."""
        return cls(cost=cost_of(runs), mean=MeanFigures.of(runs), runs=runs)


class BeforeAfter(Section):
    """Figures on one list, with the numbers of the robot file and with those found."""

    before: ListFigures
    after: ListFigures


class TuningResult(Section):
    """The file `tuning.json`.

    Attributes:
        finished: whether all generations and the reporting list were measured; False after an interrupt.
        tuning, reporting: figures on the list that was tuned on, and on the other; None: not measured yet.
        candidates, failed: how many were measured; of how many a run was impossible.
    """

    schema_: Literal["flexmotion.tuning/1"] = Field(default="flexmotion.tuning/1", alias="schema")
    finished: bool
    objective: str
    campaign: Campaign
    numbers: dict[str, FoundNumber]
    generations: int
    candidates: int
    failed: int
    tuning: BeforeAfter
    reporting: BeforeAfter | None

    @property
    def better_elsewhere(self) -> bool | None:
        """Whether the numbers found cost less on the reporting list; None: not measured, or nothing was found."""
        if self.reporting is None or all(number.before == number.after for number in self.numbers.values()):
            return None
        return self.reporting.after.cost < self.reporting.before.cost


def result_of(plan: Plan, state: CampaignState) -> TuningResult:
    """The result of a campaign as far as it is measured."""
    found, measured = state.best.numbers, [one for generation in state.generations for one in generation]
    reported = state.reported if state.reported is not None and state.reported.numbers == found else None
    return TuningResult(
        finished=reported is not None and len(state.generations) >= plan.generations,
        objective=STATEMENT,
        campaign=state.campaign,
        numbers={
            number.name: FoundNumber(
                unit=number.unit, low=number.low, high=number.high, before=number.start, after=found[number.name]
            )
            for number in plan.numbers
        },
        generations=len(state.generations),
        candidates=len(measured),
        failed=sum(one.failure is not None for one in measured),
        tuning=BeforeAfter(before=ListFigures.of(state.start.runs), after=ListFigures.of(state.best.runs)),
        reporting=None
        if reported is None
        else BeforeAfter(before=ListFigures.of(reported.before), after=ListFigures.of(reported.after)),
    )
