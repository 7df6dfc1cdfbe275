"""Does the robot do what it is told? Prompts and the default script through the whole live system, judged at the robot.

    python benchmarks/robot_prompts.py [--bundle DIR] [--seeds 20] [--jobs 2] [--kind NAME ...] [--out FILE]
                                       [--zero-forces | --no-forces]

Every prompt of prompts.yaml runs once a seed, the wordings in turn, nominal and perturbed (torso mass, gains, latency,
friction, slope, pushes, 3.5 kg), in lockstep. "did" is at the robot: a wave is seen in its hand, walking moves it at
least .4 of the human's scaled path in the right direction, a turn turns it by half of what the human turned. Results
go to --out, a line of JSON each; runs that are there already are not made again: another version of the program wants
another file. --zero-forces sets the predicted
ground forces to 0, which are not believed: it must go as with --no-forces, which takes them away and leaves contacts
to heights and speeds of the feet. Exits with 1 where a criterion does not hold.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import numpy as np
import typer
import yaml
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from robot_judge import Deeds, deeds
from verdicts import Verdict, benchmark

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.human.motion import Motion
from flexmotion.retarget.human_steps import count_steps
from flexmotion.sampling.sampler import Sampler
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.commands.choice import choose_source, open_sampler
from flexmotion.streamer.commands.driver_options import simulation_options
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.sources import Source
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures
from flexmotion.streamer.report.report import RunInfo, build_report
from flexmotion.streamer.run.played_human import human_motion
from flexmotion.streamer.run.session import Session

PROMPTS = Path(__file__).with_name("prompts.yaml")
SCRIPT = "default script"
SECONDS, WALKING_SECONDS = 5.0, 8.0
"""Length of a prompt's run: of a gesture, and of one that goes somewhere, which begins and ends with a stand."""
NET_PATH, TURNED = 0.4, 0.5
"""Shares of what the human walks and turns that the robot must reach."""
STANDING_UP, WALKING_UP, SCRIPT_OK = 0.9, 0.8, 0.9


@dataclass(frozen=True)
class Task:
    """One run: a kind of prompt in one of its wordings for so long, or the default script, which says so itself."""

    kind: str
    text: str
    seed: int
    perturbed: bool
    forces: str
    bundle: str
    seconds: float

    @property
    def key(self) -> str:
        """Tells runs apart."""
        return json.dumps(asdict(self), sort_keys=True)


class Altered:
    """A source whose predicted ground forces are set to zero, or taken away."""

    def __init__(self, source: Source, forces: str) -> None:
        self.source, self.forces = source, forces
        self.name, self.fps = source.name, source.fps

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """See `Source.window`."""
        motion = self.source.window(first_frame, frames)
        if motion is None or motion.wrenches is None:
            return motion
        if self.forces == "zero":
            return replace(motion, wrenches=np.zeros_like(motion.wrenches), contacts=np.zeros((len(motion), 2), bool))
        return replace(motion, wrenches=None, contacts=None)


@lru_cache
def _robot() -> Robot:
    return load_robot("op3")


@lru_cache
def _sampler(bundle: Path | None) -> Sampler:
    return open_sampler(bundle, "this benchmark")


def run(task: Task, folder: Path | None) -> dict[str, Any]:
    """One run, judged."""
    robot, settings = _robot(), load_stream()
    if task.kind == SCRIPT:
        source = choose_source(robot, bundle=folder, seed=task.seed)
        assert isinstance(source, ModelSource)
    else:
        items = [Item(0.0, Text(task.text))]
        sampler = _sampler(folder)
        pace = human_pace(robot, sampler.body)
        source = ModelSource(sampler, items, f"prompt:{task.text}", task.seed, task.seconds, pace)
    options = simulation_options(task.perturbed, ["total_mass=3.5"] if task.perturbed else [])
    session = Session(
        robot,
        create("sim", robot, **options, seed=task.seed),
        source if task.forces == "predicted" else Altered(source, task.forces),
        settings,
        source.seconds,
    )
    record = session.run("lockstep")
    human = human_motion(source, record)
    assert human is not None
    record.human_steps = count_steps(human)
    figures = RobotFigures.of(robot, human.body.leg)
    info = RunInfo(robot.name, "sim", source.name, task.seed, "lockstep")
    report = build_report(record, info, figures, human=HumanTrack.of(human))
    done = deeds(robot, record)
    turned = float(np.degrees(np.ptp(continuous_heading(human.root_quaternion)[[0, -1]])))
    return {
        **asdict(task),
        "ok": report.ok,
        "upright": not report.motion.fell,
        "net_path": report.motion.net_path_ratio,
        "heading_rms_rad": report.motion.heading_rms_rad,
        "human_steps": report.motion.human_steps,
        "steps_planned": report.motion.steps_planned,
        "steps_inserted": report.motion.steps_inserted,
        "violations": report.limits.violations_sent,
        "faults": report.safety.faults,
        "human_turned": turned,
        **asdict(done),
    }


def did(check: dict[str, Any], result: dict[str, Any]) -> bool | None:
    """Whether the robot did what a kind's check asks of the human; None where the robot cannot show it."""
    done = Deeds(**{name: result[name] for name in Deeds.__dataclass_fields__})
    verdicts = [RULES[name](wanted, done, result) for name, wanted in check.items() if name in RULES]
    return all(verdicts) if verdicts else None


def _walks(wanted: float, done: Deeds, result: dict[str, Any]) -> bool:
    return (result["net_path"] or 0.0) >= NET_PATH and done.forward * wanted > 0


def _sideways(wanted: float, done: Deeds, result: dict[str, Any]) -> bool:
    return (result["net_path"] or 0.0) >= NET_PATH and done.left * wanted > 0


def _turns(wanted: float, done: Deeds, result: dict[str, Any]) -> bool:
    least = TURNED * max(abs(wanted), result["human_turned"])
    return done.turned * np.sign(wanted) >= least


SIDES = {"left": (0,), "right": (1,), "both": (0, 1)}
RULES: dict[str, Callable[[Any, Deeds, dict[str, Any]], bool]] = {
    "walks": _walks,
    "sideways": _sideways,
    "turns": _turns,
    "rises": lambda wanted, done, _: all(done.raised[side] for side in SIDES[wanted]),
    "swings": lambda wanted, done, _: all(done.waved[side] for side in SIDES[wanted]),
}
"""At the robot, what the checks of prompts.yaml ask of the human; it cannot bow as deep, and stays if it stays up."""


def moves(check: dict[str, Any]) -> bool:
    """Whether a kind goes somewhere or turns."""
    return bool({"walks", "sideways", "turns"} & set(check))


def table(results: list[dict[str, Any]], checks: dict[str, dict[str, Any]]) -> Table:
    """One row a kind, nominal and perturbed side by side."""
    out = Table(title="At the robot: upright, did what was asked (nominal, perturbed); medians of those upright")
    for name in ("kind", "runs", "upright", "did", "net path", "went m", "turned °", "human °", "steps/human"):
        out.add_column(name)
    for kind in dict.fromkeys(result["kind"] for result in results):
        own = [result for result in results if result["kind"] == kind]
        up = [result for result in own if result["upright"]]
        halves = [[r for r in own if r["perturbed"] is perturbed] for perturbed in (False, True)]
        out.add_row(
            kind,
            str(len(own)),
            ", ".join(_percent([r["upright"] for r in half]) for half in halves),
            ", ".join(_percent([r["upright"] and _done(r, checks) for r in half]) for half in halves),
            _middle([r["net_path"] for r in up]),
            _middle([float(np.hypot(r["forward"], r["left"])) for r in up]),
            _middle([r["turned"] for r in up], ".0f"),
            _middle([r["human_turned"] for r in up], ".0f"),
            f"{_middle([r['steps_planned'] for r in up], '.0f')}/{_middle([r['human_steps'] for r in up], '.0f')}",
        )
    return out


def _done(result: dict[str, Any], checks: dict[str, dict[str, Any]]) -> bool:
    if result["kind"] == SCRIPT:
        return bool(result["ok"])
    return did(checks[result["kind"]], result) is not False


def _percent(values: Sequence[bool]) -> str:
    return f"{100 * np.mean(values):.0f} %" if values else "-"


def _middle(values: Sequence[float | None], form: str = ".2f") -> str:
    known = [value for value in values if value is not None]
    return format(median(known), form) if known else "-"


def verdicts(results: list[dict[str, Any]], checks: dict[str, dict[str, Any]]) -> list[Verdict]:
    """The criteria, over nominal and perturbed runs together."""
    prompts = [result for result in results if result["kind"] != SCRIPT]
    standing = [result for result in prompts if not moves(checks[result["kind"]])]
    moving = [result for result in prompts if moves(checks[result["kind"]])]
    script = [result["ok"] for result in results if result["kind"] == SCRIPT and not result["perturbed"]]
    found = []
    for name, values, least in (
        ("standing and gesture prompts upright", [r["upright"] for r in standing], STANDING_UP),
        ("walking and turning prompts upright", [r["upright"] for r in moving], WALKING_UP),
        ("standing and gesture prompts done", [r["upright"] and _done(r, checks) for r in standing], STANDING_UP),
        ("walking and turning prompts done", [r["upright"] and _done(r, checks) for r in moving], WALKING_UP),
        ("default script, unperturbed: ok", script, SCRIPT_OK),
    ):
        if values:
            share = float(np.mean(values))
            found.append(Verdict(f"{name}: {100 * share:.0f} % (>= {100 * least:.0f} %)", share >= least))
    sent = sum(result["violations"] for result in results)
    return [*found, Verdict(f"goals outside the envelope: {sent} (0)", sent == 0)]


def tasks(kinds: Sequence[str], seeds: int, forces: str, name: str) -> list[Task]:
    """All runs, seed by seed, so that an unfinished benchmark says something of every kind."""
    wordings = {entry["kind"]: entry["wordings"] for entry in _prompts()}
    known = [*wordings, SCRIPT]
    if unknown := set(kinds) - set(known):
        raise typer.BadParameter(f"unknown kinds {', '.join(sorted(unknown))}, expected some of: {', '.join(known)}")

    def wording(kind: str, seed: int) -> str:
        return wordings[kind][seed % len(wordings[kind])] if kind in wordings else ""

    def seconds(kind: str) -> float:
        return 0.0 if kind == SCRIPT else WALKING_SECONDS if moves(_checks()[kind]) else SECONDS

    return [
        Task(kind, wording(kind, seed), seed, hard, forces, name, seconds(kind))
        for seed in range(seeds)
        for kind in known
        if not kinds or kind in kinds
        for hard in (False, True)
    ]


@lru_cache
def _checks() -> dict[str, dict[str, Any]]:
    return {entry["kind"]: entry["check"] for entry in _prompts()}


def _prompts() -> list[dict[str, Any]]:
    table: list[dict[str, Any]] = yaml.safe_load(PROMPTS.read_text(encoding="utf-8"))
    return table


def done_before(out: Path) -> list[dict[str, Any]]:
    """Results in a file that an earlier, perhaps unfinished, benchmark left."""
    if not out.is_file():
        return []
    text = out.read_text(encoding="utf-8")
    # What was cut short when the last one was stopped is made again.
    out.write_text(text[: text.rfind("\n") + 1], encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()[: text.count("\n")]]


def main(
    bundle: Annotated[Path | None, typer.Option(help="bundle to sample from; else the shipped one")] = None,
    seeds: Annotated[int, typer.Option(help="runs of each kind, nominal and perturbed each")] = 20,
    jobs: Annotated[int, typer.Option(help="runs at a time")] = 1,
    kinds: Annotated[list[str] | None, typer.Option("--kind", help="only these kinds (repeatable)")] = None,
    zero_forces: Annotated[
        bool, typer.Option("--zero-forces", help="predicted ground forces are set to 0, and not believed")
    ] = False,
    no_forces: Annotated[bool, typer.Option("--no-forces", help="contacts by heights and speeds of the feet")] = False,
    out: Annotated[
        Path | None, typer.Option(help="file of results, a line each; what is there is not run again")
    ] = None,
) -> list[Verdict]:
    """Run all prompts and judge."""
    forces = "zero" if zero_forces else "none" if no_forces else "predicted"
    checks = _checks()
    work = tasks(kinds or (), seeds, forces, _sampler(bundle).bundle.hash)
    wanted = {task.key: task for task in work}
    before = [] if out is None else done_before(out)
    found = {Task(**{name: r[name] for name in Task.__dataclass_fields__}).key: r for r in before}
    results = {key: result for key, result in found.items() if key in wanted}
    missing = [task for key, task in wanted.items() if key not in results]
    # Each run has a processor to itself; children that are spawned read this before numpy.
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool, Progress(console=Console(stderr=True)) as progress:
        running = {pool.submit(run, task, bundle): task for task in missing}
        bar = progress.add_task("runs", total=len(work), completed=len(results))
        for future in as_completed(running):
            result = future.result()
            results[running[future].key] = result
            if out is not None:
                with out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(result) + "\n")
            progress.advance(bar)
    ordered = [results[task.key] for task in work]
    Console(width=140).print(table(ordered, checks))
    return verdicts(ordered, checks)


if __name__ == "__main__":
    benchmark(main)
