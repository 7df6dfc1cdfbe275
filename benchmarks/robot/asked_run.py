"""Runs by one prompt each, in lockstep, that are asked for places of hands, feet or the head: what they have in common.

Benchmarks of such targets draw the places, send them, and measure where the part was in the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Protocol

import numpy as np
import typer
from numpy.typing import NDArray

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

TargetsOption = Annotated[int, typer.Option("--targets", min=1, help="Of each run.")]
RunsOption = Annotated[int, typer.Option("--runs", min=1, help="How many, with the prompts in turn.")]
PerturbedOption = Annotated[bool, typer.Option("--perturbed", help="Standard perturbations, at 3.5 kg.")]
SeedOption = Annotated[int, typer.Option("--seed", help="Of the first run; results are kept of 1000, 0 is for tuning.")]


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


def prompted_session(prompt: str, seed: int, seconds: float, *, perturbed: bool) -> Session:
    """OP3 follows one prompt through the shipped model; `seed`: of model and simulation."""
    robot, sampler = load_robot("op3"), sampler_of(None)
    pace = human_pace(robot, sampler.body)
    source = ModelSource(sampler, [Item(0.0, Text(prompt))], prompt, seed, seconds + 10.0, pace)
    return Session(robot, simulator(robot, perturbed, seed), source, load_stream(), seconds)


def passed_ticks(session: Session) -> int:
    """Ticks that the loop has done."""
    return 0 if session.loop is None else session.loop.tick_count


def up_ticks(record: RunTrace) -> NDArray[np.bool_]:
    """Whether the robot is up, by tick, (T,)."""
    up: NDArray[np.bool_] = ~np.isin(record.ticks.state, (State.DAMPED, State.FAULT))
    return up


def true_state(record: RunTrace, tick: float) -> tuple[Float, Float] | None:
    """True place and quaternion of the torso, (7,), and joint angles, (n,) [rad]; None: the robot fell before."""
    row = int(np.searchsorted(record.ticks.tick, tick))
    if row >= len(record.ticks.tick):
        return None
    return record.ticks.true_base[row], record.ticks.true_q[row]


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
