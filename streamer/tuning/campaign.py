"""`tune`: finds numbers of a robot file by measurement, generation after generation; goes on where it was stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.tunable import ChosenNumber
from flexmotion.streamer.tuning.clip_list import ClipList, TuningClip, refuse_shared
from flexmotion.streamer.tuning.figures import AskedWay, RunFigures
from flexmotion.streamer.tuning.objective import cost_of
from flexmotion.streamer.tuning.search import Search, default_population, needs_cma
from flexmotion.streamer.tuning.state import (
    Campaign,
    CampaignState,
    Candidate,
    Measured,
    Reported,
    folder_digest,
    read_state,
    write_state,
)
from flexmotion.streamer.tuning.trial import Question, Trial

REPORT_SEED = 1000
"""Seeds of the reporting list are this much higher than those of the tuning list."""

Numbers = dict[str, float]


class Measurer(Protocol):
    """What measures: processes, or a test."""

    def trials(self, trials: Sequence[Trial]) -> list[RunFigures]:
        """Figures of each trial, in order."""
        ...

    def ways(self, questions: Sequence[Question]) -> list[AskedWay | str]:
        """The way of each clip, or why it cannot be measured on."""
        ...


@dataclass(frozen=True)
class Plan:
    """What is to be tuned, on what.

    Attributes:
        robot: as it is.
        numbers: that are tuned.
        clips, report: lists that it is tuned on and reported on.
        seed: of the search, and of the first clip; each clip has its own.
        population: candidates of a generation; None: by the number of numbers.
        generations: to search in all.

    Raises:
        ConfigError: the lists share a clip, or the extra `tune` is not installed.
    """

    robot: Robot
    numbers: tuple[ChosenNumber, ...]
    clips: ClipList
    report: ClipList
    generations: int
    seed: int = 0
    population: int | None = None

    def __post_init__(self) -> None:
        needs_cma()
        refuse_shared(self.clips, self.report)

    @property
    def size(self) -> int:
        """Candidates of a generation."""
        return default_population(len(self.numbers)) if self.population is None else self.population

    @property
    def start(self) -> Numbers:
        """The numbers in the robot file."""
        return {number.name: number.start for number in self.numbers}

    @property
    def runs(self) -> int:
        """Runs in all, with both reports."""
        return len(self.clips.clips) * (1 + self.size * self.generations) + 2 * len(self.report.clips)

    def done(self, state: CampaignState) -> int:
        """Those of them that a state holds."""
        generations = sum(len(generation) for generation in state.generations)
        return len(self.clips.clips) * (1 + generations) + (0 if state.reported is None else 2 * len(self.report.clips))

    def campaign(self) -> Campaign:
        """What distinguishes this campaign from others."""
        return Campaign(
            robot=self.robot.name,
            robot_folder=folder_digest(self.robot.folder),
            numbers={number.name: (number.low, number.high) for number in self.numbers},
            clips=tuple(clip.identity for clip in self.clips.clips),
            report=tuple(clip.identity for clip in self.report.clips),
            seed=self.seed,
            population=self.size,
            flexmotion=version("flexmotion"),
            cma=version("cma"),
        )

    def trials(self, numbers: Mapping[str, float], asked: Sequence[AskedWay], *, report: bool = False) -> list[Trial]:
        """The runs of a candidate on the tuning list, or on the reporting list."""
        values = tuple((number.at, numbers[number.name]) for number in self.numbers)
        clips = (self.report if report else self.clips).clips
        return [
            Trial(self.robot.file, values, clip, way, seed)
            for clip, way, seed in zip(clips, asked, self._seeds(clips, report), strict=True)
        ]

    def questions(self, *, report: bool = False) -> list[Question]:
        """What to ask about the clips of a list before the first run."""
        clips = (self.report if report else self.clips).clips
        seeds = self._seeds(clips, report)
        return [Question(self.robot.file, clip, seed) for clip, seed in zip(clips, seeds, strict=True)]

    def _seeds(self, clips: Sequence[TuningClip], report: bool) -> list[int]:
        first = self.seed + (REPORT_SEED if report else 0)
        return [first + place for place in range(len(clips))]


def begin(plan: Plan, folder: Path, measurer: Measurer) -> CampaignState:
    """The state of a campaign with the numbers of the robot file measured: that in the folder, or a new one.

    Raises:
        ConfigError: the folder holds another campaign, a clip cannot be measured on, or the robot as it is cannot run.
    """
    if folder.resolve().is_relative_to(plan.robot.folder.resolve()):
        raise ConfigError(f"{folder}: is inside the robot's folder, which is copied; give another one")
    campaign = plan.campaign()
    state = read_state(folder, campaign)
    if state is not None:
        return state
    asked = _known(measurer.ways(plan.questions()), plan.clips)
    report_asked = _known(measurer.ways(plan.questions(report=True)), plan.report)
    runs = tuple(measurer.trials(plan.trials(plan.start, asked)))
    _refuse_failures(plan, runs)
    start = Measured(numbers=plan.start, cost=cost_of(runs), runs=runs)
    state = CampaignState(campaign=campaign, asked=asked, report_asked=report_asked, start=start, best=start)
    write_state(folder, state)
    return state


def search(
    plan: Plan, folder: Path, state: CampaignState, measurer: Measurer, note: Callable[[str], None]
) -> Iterator[CampaignState]:
    """Search until all generations of the plan are measured; yields the state after each, when it is written.

    Args:
        note: takes a line about each generation.

    Raises:
        ConfigError: the search does not repeat what the state says it has asked.
    """
    asks = Search([number.start_share for number in plan.numbers], plan.size, plan.seed)
    for generation in range(max(plan.generations, len(state.generations))):
        candidates = [_numbers(plan, shares) for shares in asks.ask()]
        if generation < len(state.generations):
            known = state.generations[generation]
            if [one.numbers for one in known] != candidates:
                raise ConfigError(
                    f"{folder}: generation {generation + 1} is not what this search asks for: it was stored on another "
                    "machine or by other libraries; give another folder"
                )
        else:
            state = _measure(plan, state, candidates, measurer)
            write_state(folder, state)
            known = state.generations[generation]
            note(_told(generation, known, state.best))
            yield state
        asks.tell([one.cost for one in known])


def report(plan: Plan, folder: Path, state: CampaignState, measurer: Measurer) -> CampaignState:
    """Measure the numbers of the robot file and those found on the reporting list; the state is written."""
    known, best = state.reported, state.best.numbers
    if known is not None and known.numbers == best:
        return state
    before = measured = known.before if known is not None else _reported(plan, state, plan.start, measurer)
    if best != plan.start:
        measured = _reported(plan, state, best, measurer)
    state = state.model_copy(update={"reported": Reported(before=before, after=measured, numbers=best)})
    write_state(folder, state)
    return state


def _reported(plan: Plan, state: CampaignState, numbers: Numbers, measurer: Measurer) -> tuple[RunFigures, ...]:
    return tuple(measurer.trials(plan.trials(numbers, state.report_asked, report=True)))


def _measure(plan: Plan, state: CampaignState, candidates: list[Numbers], measurer: Measurer) -> CampaignState:
    """The state with one generation more. All its runs are one batch, so that no process waits for another's clip."""
    trials = [trial for numbers in candidates for trial in plan.trials(numbers, state.asked)]
    found, length = measurer.trials(trials), len(state.asked)
    groups = [tuple(found[place * length : (place + 1) * length]) for place in range(len(candidates))]
    measured = [
        Measured(numbers=own, cost=cost_of(runs), runs=runs) for own, runs in zip(candidates, groups, strict=True)
    ]
    generation = tuple(
        Candidate(
            numbers=one.numbers,
            cost=one.cost,
            down=sum(not run.upright for run in one.runs),
            failure=next((run.failure for run in one.runs if run.failure is not None), None),
        )
        for one in measured
    )
    best = min((state.best, *measured), key=lambda one: one.cost)
    return state.model_copy(update={"generations": (*state.generations, generation), "best": best})


def _numbers(plan: Plan, shares: Iterable[float]) -> Numbers:
    return {number.name: number.value(share) for number, share in zip(plan.numbers, shares, strict=True)}


def _known(ways: Sequence[AskedWay | str], clips: ClipList) -> tuple[AskedWay, ...]:
    for way in ways:
        if isinstance(way, str):
            raise ConfigError(f"list of clips {clips.name}: {way}")
    return tuple(way for way in ways if isinstance(way, AskedWay))


def _refuse_failures(plan: Plan, runs: Sequence[RunFigures]) -> None:
    for run in runs:
        if run.failure is not None:
            raise ConfigError(f"{plan.robot.file}: as it is, it cannot follow {run.clip}: {run.failure}")


def _told(generation: int, candidates: Sequence[Candidate], best: Measured) -> str:
    least = min(candidates, key=lambda one: one.cost)
    numbers = ", ".join(f"{name} {value:g}" for name, value in best.numbers.items())
    failed = sum(one.failure is not None for one in candidates)
    return (
        f"generation {generation + 1}: cost {least.cost:.4f}, {least.down} down"
        + (f", {failed} candidates failed" if failed else "")
        + f"; best {best.cost:.4f}: {numbers}"
    )
