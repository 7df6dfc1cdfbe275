"""What becomes of a robot that is asked for something else every half second?

    python benchmarks/switching.py [--runs 12] [--seconds 60] [--prompts] [--perturbed] [--jobs 2] [--seed 0]

Each run streams for so long, in lockstep, and changes what the robot is to do at random moments, 0.2 to 1 s apart: to
another of six clips, standing and walking (from the folder in `FLEXMOTION_SHARED`, default `shared` beside the
project); with --prompts to one of the model's prompts, any kind of prompts.yaml. A run ends where the robot falls.
--perturbed takes the robot of `spine.py`. Exits with 1 where there is more than one fall in 200 changes, or a goal
outside the envelope.
"""

from __future__ import annotations

import os
import tempfile
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated

# Before NumPy is loaded: a run is one thread, --jobs says how many there are.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import typer
import yaml
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from robot_prompts import PROMPTS
from spine import extract
from verdicts import Verdict, benchmark

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.human.motion import Motion
from flexmotion.importers import load
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.checks.latency import RandomTargets, switched
from flexmotion.streamer.commands.choice import open_sampler
from flexmotion.streamer.commands.driver_options import simulation_options
from flexmotion.streamer.motion.intents import Intent, Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.sources import LiveSource
from flexmotion.streamer.run.session import Session

CLIPS = tuple(f"dataset-1_{name}_normal_001" for name in ("walk", "bow", "guide", "respond", "byebye", "walk-back"))
MOST = 1 / 200


@dataclass(frozen=True)
class Run:
    """One run: how long the robot stayed up, and how often it was asked for something else by then."""

    seed: int
    seconds: float
    changes: int
    fell: bool
    violations: int


@lru_cache
def _sampler() -> Sampler:
    return open_sampler(None, "this benchmark")


def prompted(seconds: float, seed: int) -> tuple[LiveSource, list[Intent]]:
    """The model, and all that prompts.yaml asks of it."""
    entries = yaml.safe_load(PROMPTS.read_text(encoding="utf-8"))
    intents: list[Intent] = [Text(words) for entry in entries for words in entry["wordings"]]
    sampler = _sampler()
    pace = human_pace(load_robot("op3"), sampler.body)
    items = [Item(0.0, Text("stand still"))]
    return ModelSource(sampler, items, "switching", seed, seconds + 10.0, pace), intents


def run(seed: int, seconds: float, clips: dict[str, Motion] | None, perturbed: bool) -> Run:
    """One run; `clips` by name, None: the model's prompts."""
    robot = load_robot("op3")
    source, intents = prompted(seconds, seed) if clips is None else switched(clips)
    options = simulation_options(perturbed, ["total_mass=3.5"] if perturbed else [])
    session = Session(robot, create("sim", robot, **options, seed=seed), source, load_stream(), seconds)
    changes = RandomTargets(session.targets, intents, seed)

    def change() -> None:
        if session.loop is not None:
            changes.at(session.loop.tick_count / robot.rate_hz)

    session.request = change
    record = session.run("lockstep")
    fell = any("fall" in event.message for event in record.events if event.kind == "fault")
    return Run(seed, record.duration_s, changes.sent, fell, record.violations_sent)


def main(
    runs: Annotated[int, typer.Option(help="How many.")] = 12,
    seconds: Annotated[float, typer.Option(help="Each, unless the robot falls [s].")] = 60.0,
    prompts: Annotated[bool, typer.Option("--prompts", help="Ask the model, instead of switching clips.")] = False,
    perturbed: Annotated[bool, typer.Option("--perturbed", help="The robot of spine.py.")] = False,
    jobs: Annotated[int, typer.Option(help="Runs at a time.")] = 2,
    seed: Annotated[int, typer.Option(help="Of the first run.")] = 0,
) -> list[Verdict]:
    """Run them all, and count the falls."""
    clips: dict[str, Motion] | None = None
    if not prompts:
        with tempfile.TemporaryDirectory() as name:
            extract("bandai", list(CLIPS), Path(name))
            clips = {clip: load(Path(name) / f"{clip}.bvh") for clip in CLIPS}
    done: list[Run] = []
    with ProcessPoolExecutor(jobs) as pool, Progress(console=Console(stderr=True)) as progress:
        futures = [pool.submit(run, seed + k, seconds, clips, perturbed) for k in range(runs)]
        bar = progress.add_task("runs", total=runs)
        for future in as_completed(futures):
            done.append(future.result())
            progress.advance(bar)
    table = Table("run", "seconds", "changes", "fell")
    for one in sorted(done, key=lambda one: one.seed):
        table.add_row(str(one.seed), f"{one.seconds:.1f}", str(one.changes), "yes" if one.fell else "")
    Console(width=120).print(table)
    changes, falls = sum(one.changes for one in done), sum(one.fell for one in done)
    sent = sum(one.violations for one in done)
    return [
        Verdict(
            f"falls: {falls} in {changes} changes (<= 1 in {1 / MOST:.0f})", changes > 0 and falls <= MOST * changes
        ),
        Verdict(f"goals outside the envelope: {sent} (0)", sent == 0),
    ]


if __name__ == "__main__":
    benchmark(main)
