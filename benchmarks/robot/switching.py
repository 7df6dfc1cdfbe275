"""Does the robot stay up when its target changes every half second?

Each run streams in lockstep and changes its target at random moments, 0.2 to 1 s apart: to another of six clips,
standing and walking; with --prompts to one of the model's prompts, any kind of `prompts.yaml`. A run ends where the
robot falls, and where it faults otherwise: a blocked joint, for one.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.model_run import sampler_of
from benchmarks.robot.simulation import simulator
from benchmarks.shared.clips import extracted
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from benchmarks.shared.prompts import prompt_kinds
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.human.motion import Motion
from flexmotion.importers import load
from flexmotion.streamer.checks.switching import RandomTargets, switched
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.intents import Intent, Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.sources import LiveSource
from flexmotion.streamer.run.session import Session

CLIPS = tuple(f"dataset-1_{name}_normal_001" for name in ("walk", "bow", "guide", "respond", "byebye", "walk-back"))
MOST = 1 / 200
"""Falls a change that are allowed."""
SPARE_S = 10.0
"""Motion of the model beyond the run's end [s]."""


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        seed: of the run.
        seconds: how long it lasted.
        changes: of target, until its end.
        fell: whether the robot fell.
        fault: what ended it early, a fall or anything else; empty: nothing.
        self_contacts: ticks in which the robot touched itself while it was upright.
        violations: goals outside the envelope.
    """

    seed: int
    seconds: float
    changes: int
    fell: bool
    fault: str
    self_contacts: int
    violations: int


def prompted(seconds: float, seed: int) -> tuple[LiveSource, list[Intent]]:
    """The shipped model, standing at first, and every wording of `prompts.yaml`."""
    intents: list[Intent] = [Text(words) for entry in prompt_kinds() for words in entry.wordings]
    sampler = sampler_of(None)
    pace = human_pace(load_robot("op3"), sampler.body)
    items = [Item(0.0, Text("stand still"))]
    return ModelSource(sampler, items, "switching", seed, seconds + SPARE_S, pace), intents


def run(seed: int, seconds: float, clips: dict[str, Motion] | None, perturbed: bool) -> Run:
    """One run; `clips` by name, None for the model's prompts."""
    robot = load_robot("op3")
    source, intents = prompted(seconds, seed) if clips is None else switched(clips)
    session = Session(robot, simulator(robot, perturbed, seed), source, load_stream(), seconds)
    changes = RandomTargets(session.targets, intents, seed)

    def change() -> None:
        if session.loop is not None:
            changes.at(session.loop.tick_count / robot.rate_hz)

    session.next_request = change
    record = session.run()
    faults = [event.message for event in record.events if event.kind == "fault"]
    upright = ~np.isin(record.ticks.state, (State.DAMPED, State.FAULT))
    return Run(
        seed=seed,
        seconds=record.duration_s,
        changes=changes.sent,
        fell=any("fall" in fault for fault in faults),
        fault=faults[0] if faults else "",
        self_contacts=int(np.count_nonzero(record.ticks.true_self_contact & upright)),
        violations=record.violations_sent,
    )


def main(
    runs: Annotated[int, typer.Option(min=1, help="How many.")] = 12,
    seconds: Annotated[float, typer.Option(min=1.0, help="Length of a run, unless the robot falls [s].")] = 60.0,
    prompts: Annotated[bool, typer.Option("--prompts", help="Prompts for the model instead of clips.")] = False,
    perturbed: Annotated[bool, typer.Option("--perturbed", help="Standard perturbations, at 3.5 kg.")] = False,
    jobs: JobsOption = 2,
    seed: Annotated[int, typer.Option(help="Of the first run.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run them all, and count the falls."""
    clips: dict[str, Motion] | None = None
    if not prompts:
        with extracted({"bandai": CLIPS}) as folder:
            clips = {clip: load(folder / f"{clip}.bvh") for clip in CLIPS}
    one = partial(run, seconds=seconds, clips=clips, perturbed=perturbed)
    done = in_order(one, range(seed, seed + runs), jobs)
    table = Table("run", "seconds", "changes", "touches itself", "ended by")
    for own in done:
        table.add_row(str(own.seed), f"{own.seconds:.1f}", str(own.changes), f"{own.self_contacts} ticks", own.fault)
    Console(width=120).print(table)
    if csv_out is not None:
        write_csv(csv_out, [asdict(own) for own in done])
    changes, falls = sum(own.changes for own in done), sum(own.fell for own in done)
    sent, early = sum(own.violations for own in done), sum(bool(own.fault) and not own.fell for own in done)
    few = changes > 0 and falls <= MOST * changes
    return Outcome(
        [
            Verdict(f"falls: {falls} in {changes} changes (<= 1 in {1 / MOST:.0f})", few),
            Verdict(f"runs ended early by another fault: {early} (0)", early == 0),
            Verdict(f"goals outside the envelope: {sent} (0)", sent == 0),
        ],
        {"runs": runs, "seconds": sum(own.seconds for own in done), "changes": changes, "falls": falls},
    )
