"""Runs by one prompt each, in lockstep, that are asked for places of hands, feet or the head: what they have in common.

Benchmarks of such targets draw the places, send them, and measure where the part was in the end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Protocol, TypeVar

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.robot.model_run import sampler_of
from benchmarks.robot.simulation import simulator
from benchmarks.shared.outcome import Verdict
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.run.session import Session

Float = NDArray[np.float64]
Figures = dict[str, Any]

TargetsOption = Annotated[int, typer.Option("--targets", min=1, help="Of each run.")]
RunsOption = Annotated[int, typer.Option("--runs", min=1, help="How many, with the prompts in turn.")]
PerturbedOption = Annotated[bool, typer.Option("--perturbed", help="Standard perturbations, at 3.5 kg.")]
SeedOption = Annotated[int, typer.Option("--seed", help="Of the first run; results are kept of 1000, 0 is for tuning.")]


class AskedRow(Protocol):
    """One target: the prompt of its run, and the state of its answer."""

    @property
    def prompt(self) -> str:
        """Of the run."""
        ...

    @property
    def state(self) -> str:
        """Of the answer."""
        ...


class AskedRun(Protocol):
    """One run."""

    @property
    def upright(self) -> bool:
        """Whether the robot stayed up and did not fault."""
        ...

    @property
    def violations(self) -> int:
        """Goals outside the envelope."""
        ...


Row = TypeVar("Row", bound=AskedRow)


def prompted_session(prompt: str, seed: int, seconds: float, *, perturbed: bool) -> Session:
    """OP3 follows one prompt through the shipped model; `seed`: of model and simulation."""
    robot, sampler = load_robot("op3"), sampler_of(None)
    pace = human_pace(robot, sampler.body)
    source = ModelSource(sampler, [Item(0.0, Text(prompt))], prompt, seed, seconds + 10.0, pace)
    return Session(robot, simulator(robot, perturbed, seed), source, load_stream(), seconds)


def passed_ticks(session: Session) -> int:
    """Ticks that the loop has done."""
    return 0 if session.loop is None else session.loop.tick_count


def stays_up(record: RunTrace) -> NDArray[np.bool_]:
    """Whether the robot is up, by tick, (T,)."""
    up: NDArray[np.bool_] = ~np.isin(record.ticks.state, (State.DAMPED, State.FAULT))
    return up


def true_state(record: RunTrace, tick: float) -> tuple[Float, Float] | None:
    """True place and quaternion of the torso, (7,), and joint angles, (n,) [rad]; None: the robot fell before."""
    row = int(np.searchsorted(record.ticks.tick, tick))
    if row >= len(record.ticks.tick):
        return None
    return record.ticks.true_base[row], record.ticks.true_q[row]


def share(values: Sequence[float], bound: float) -> float:
    """Share of values that are within a bound; NaN is not."""
    return float(np.mean([value <= bound for value in values]))


def safety(runs: Sequence[AskedRun]) -> list[Verdict]:
    """All runs upright, and no goal outside the envelope."""
    upright, sent = sum(run.upright for run in runs), sum(run.violations for run in runs)
    return [
        Verdict(f"upright: {upright} of {len(runs)} runs (all)", upright == len(runs)),
        Verdict(f"goals outside the envelope: {sent} (0)", sent == 0),
    ]


def untouched(ticks: int) -> Verdict:
    """The robot does not touch itself. `ticks`: in which it does."""
    return Verdict(f"ticks in which it touches itself: {ticks} (0)", ticks == 0)


def states(rows: Sequence[AskedRow]) -> dict[str, int]:
    """How many answers have each state."""
    return {state: sum(row.state == state for row in rows) for state in sorted({row.state for row in rows})}


def by_prompt(rows: Sequence[Row], of: Callable[[Sequence[Row]], Figures]) -> Figures:
    """Figures of all rows, and under `prompts` those of each prompt in the order in which they come."""
    own = {
        prompt: [row for row in rows if row.prompt == prompt] for prompt in dict.fromkeys(row.prompt for row in rows)
    }
    return of(rows) | {"prompts": {prompt: of(part) for prompt, part in own.items()}}


def show(found: Figures, columns: Mapping[str, Callable[[Figures], str]]) -> None:
    """Print a row for each prompt, and one for all. `columns`: heading, and what its cells say of figures."""
    table = Table("prompt", "targets", *columns)
    for name, own in [*found["prompts"].items(), ("all", found)]:
        table.add_row(name, str(own["targets"]), *(cell(own) for cell in columns.values()))
    Console(width=120).print(table)


def percent(name: str) -> Callable[[Figures], str]:
    """A cell with a share in percent."""
    return lambda own: f"{own[name]:.0%}"


def millimetres(name: str) -> Callable[[Figures], str]:
    """A cell with a length [m] in millimetres."""
    return lambda own: f"{1000 * own[name]:.1f} mm"


def degrees(name: str) -> Callable[[Figures], str]:
    """A cell with an angle [°]."""
    return lambda own: f"{own[name]:.1f}°"


def answers(own: Figures) -> str:
    """A cell with the states of the answers."""
    return ", ".join(f"{count} {state}" for state, count in own["states"].items())
