"""Plans that disagree with one another: does the robot stay up when every window of human motion is redrawn?

    python benchmarks/replan_noise.py [--noise 0 --noise .05] [--clips FILE] [--jobs 2] [--seed 0] [--csv OUT]

The standing and walking clips of `spine.py`, odd places of each kind perturbed at 3.5 kg as there, in lockstep, with an
error that grows to the given size at 1 s lookahead (`streamer/motion/replan_noise.py`), with balance feedback or not.
Prints a table by kind, noise and feedback. "join mm/tick" is by how much a new plan's divergent component of motion
moves away from the old plan's in a tick while a join is absorbed. Exits 1 where fewer than 90 % of standing or walking
clips stay up at 5 cm with feedback, or where a join moves by more than 3 mm a tick.
"""

from __future__ import annotations

import csv
import json
import os
import sys
import tempfile
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

# Before NumPy is loaded: a run is one thread, --jobs says how many there are.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import typer
import yaml
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from spine import ARCHIVES, CLIPS, Run, cell, degrees, extract, middle

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.human.motion import Motion
from flexmotion.importers import load
from flexmotion.retarget.human_steps import count_steps
from flexmotion.retarget.plan import Plan
from flexmotion.streamer.commands.driver_options import simulation_options
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.planning.planner import Planned, Planner
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures
from flexmotion.streamer.report.report import RunInfo, build_report
from flexmotion.streamer.run.session import Session

KINDS = ("standing", "walking")
JUDGED_M, UPRIGHT_SHARE, JOIN_MM = 0.05, 0.9, 3.0


class WatchedPlanner(Planner):
    """A planner that notes how far each new plan's divergent component moves from the old one's, tick by tick."""

    @classmethod
    def over(cls, planner: Planner) -> WatchedPlanner:
        """The same planner, watched."""
        watched = cls(planner.retargeter, planner.source, planner.settings)
        watched.moves = []
        return watched

    moves: list[np.ndarray]
    """Of each join, (ticks,) [m]; the first is the jump at the join itself."""

    def plan(self, join: int, current: Plan | None, **how: Any) -> Planned:
        """See `Planner.plan`."""
        planned = super().plan(join, current, **how)
        if current is not None:
            rows = np.arange(int(round(self.settings.dcm_absorb_s * self.rate)))
            old = current.dcm[np.clip(join - current.start_tick + rows, 0, len(current) - 1)]
            apart = planned.plan.dcm[: len(rows)] - old
            self.moves.append(np.linalg.norm(np.diff(apart, axis=0, prepend=np.zeros((1, 2))), axis=1))
        return planned


@dataclass(frozen=True)
class Trial:
    """One run of a clip at one size of noise."""

    run: Run
    noise_m: float
    feedback: bool
    moves_m: np.ndarray


@dataclass(frozen=True)
class Task:
    """A clip and how to run it."""

    kind: str
    clip: str
    perturbed: bool
    seed: int


def trials(task: Task, file: Path, noises: list[float], feedbacks: list[bool]) -> list[Trial]:
    """All runs of one clip."""
    motion = replace(load(file), source=file.name)
    return [trial(task, motion, noise, feedback) for noise in noises for feedback in feedbacks]


def trial(task: Task, motion: Motion, noise_m: float, feedback: bool) -> Trial:
    """One run of one clip."""
    robot = load_robot("op3")
    options: dict[str, Any] = simulation_options(task.perturbed, ["total_mass=3.5"] if task.perturbed else [])
    clip = ClipSource(motion)
    source = NoisySource(clip, noise_m, task.seed)
    driver = create("sim", robot, **options, seed=task.seed)
    session = Session(robot, driver, source, load_stream(), clip.seconds, feedback=feedback)
    planner = session.planner = WatchedPlanner.over(session.planner)
    record = session.run("lockstep")
    record.human_steps = count_steps(motion)
    info = RunInfo(robot.name, "sim", motion.source, task.seed, "lockstep")
    figures = RobotFigures.of(robot, motion.body.leg)
    report = build_report(record, info, figures, human=HumanTrack.of(motion))
    run = Run(task.kind, task.clip, task.perturbed, json.loads(report.json_text()))
    return Trial(run, noise_m, feedback, np.concatenate(planner.moves))


def join_figures(group: list[Trial]) -> tuple[float, float]:
    """99th percentile and greatest move at joins [mm a tick]."""
    moves = 1e3 * np.concatenate([trial.moves_m for trial in group])
    return float(np.percentile(moves, 99)), float(moves.max())


def table(done: list[Trial]) -> Table:
    """One row a kind, size of noise and feedback; medians over the runs that stayed upright."""
    out = Table(title="Replan noise (medians of those upright)")
    columns = "kind", "noise cm", "feedback", "runs", "upright", "walked", "net path", "slip mm/s", "leg °", "heading °"
    for name in (*columns, "join mm/tick p99", "max"):
        out.add_column(name)
    for key in dict.fromkeys((t.run.kind, t.noise_m, t.feedback) for t in done):
        kind, noise_m, feedback = key
        group = [t for t in done if (t.run.kind, t.noise_m, t.feedback) == key]
        up = [t.run.motion for t in group if t.run.upright]
        usual, most = join_figures(group)
        out.add_row(
            kind,
            f"{100 * noise_m:.0f}",
            "on" if feedback else "off",
            str(len(group)),
            f"{100 * len(up) / len(group):.0f} %",
            "" if kind == "standing" else f"{100 * sum(t.run.walked for t in group) / len(group):.0f} %",
            cell(middle([m["net_path_ratio"] for m in up])),
            cell(middle([m["foot_slip_mm_s"] for m in up])),
            cell(middle([degrees(m["joint_rmse_rad"]) for m in up])),
            cell(middle([degrees(m["heading_rms_rad"]) for m in up]), ".1f"),
            f"{usual:.2f}",
            f"{most:.2f}",
        )
    return out


def verdicts(done: list[Trial]) -> list[tuple[str, bool]]:
    """Each criterion as a sentence with its figure, and whether it holds."""
    judged = [t for t in done if t.feedback and t.noise_m == JUDGED_M]
    found = []
    for kind in KINDS:
        group = [t for t in judged if t.run.kind == kind]
        if group:
            share = sum(t.run.upright for t in group) / len(group)
            found.append((f"{kind} clips upright at 5 cm: {100 * share:.0f} % (>= 90 %)", share >= UPRIGHT_SHARE))
    if judged:
        usual, most = join_figures(judged)
        sentence = f"joins at 5 cm move the DCM by {usual:.1f} mm a tick (p99; most: {most:.1f}) (<= {JOIN_MM:.0f})"
        found.append((sentence, most <= JOIN_MM))
    return found


def main(
    noise: Annotated[list[float] | None, typer.Option(help="error at 1 s lookahead [m] (repeatable)")] = None,
    feedback: Annotated[str, typer.Option(help="on, off or both")] = "both",
    clips: Annotated[Path, typer.Option(help="YAML list of clips by kind and collection")] = CLIPS,
    jobs: Annotated[int, typer.Option(help="runs at a time")] = 1,
    seed: Annotated[int, typer.Option(help="seed of the first clip; each has its own")] = 0,
    csv_out: Annotated[Path | None, typer.Option("--csv", help="write one row a run here")] = None,
) -> None:
    """Run all clips and judge."""
    noises = noise or [0.0, 0.02, 0.05, 0.10]
    if feedback not in ("on", "off", "both"):
        raise typer.BadParameter(f"--feedback is {feedback!r}, expected on, off or both")
    feedbacks = {"on": [True], "off": [False], "both": [True, False]}[feedback]
    lists: dict[str, dict[str, list[str]]] = yaml.safe_load(clips.read_text(encoding="utf-8"))
    kinds = {kind: own for kind, own in lists.items() if kind in KINDS}
    named = [
        (kind, clip, place % 2 == 1)
        for kind, collections in kinds.items()
        for place, clip in enumerate(clip for own in collections.values() for clip in own)
    ]
    tasks = [Task(*item, seed + number) for number, item in enumerate(named)]
    console = Console(width=160)
    done: dict[Task, list[Trial]] = {}
    with (
        tempfile.TemporaryDirectory() as name,
        Progress(console=Console(stderr=True)) as progress,
        ProcessPoolExecutor(jobs) as pool,
    ):
        folder = Path(name)
        for collection in ARCHIVES:
            extract(collection, [c for own in kinds.values() for c in own.get(collection, [])], folder)
        bar = progress.add_task("clips", total=len(tasks))
        futures: dict[Future[list[Trial]], Task] = {
            pool.submit(trials, task, folder / f"{task.clip}.bvh", noises, feedbacks): task for task in tasks
        }
        for future in as_completed(futures):
            done[futures[future]] = future.result()
            progress.advance(bar)
    ordered = [trial for task in tasks for trial in done[task]]
    ordered.sort(key=lambda t: (KINDS.index(t.run.kind), t.noise_m, not t.feedback))
    console.print(table(ordered))
    judged = verdicts(ordered)
    for sentence, holds in judged:
        console.print(f"{'[green]PASS' if holds else '[red]FAIL'}[/] {sentence}")
    if csv_out is not None:
        write_csv(csv_out, ordered)
    if not all(holds for _, holds in judged):
        sys.exit(1)


def write_csv(file: Path, done: list[Trial]) -> None:
    """One row a run."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        columns = list(done[0].run.motion)
        head = ["kind", "clip", "perturbed", "noise_m", "feedback", "join_p99_mm", "join_max_mm"]
        writer.writerow(head + columns)
        for t in done:
            row = [t.run.kind, t.run.clip, t.run.perturbed, t.noise_m, t.feedback, *join_figures([t])]
            writer.writerow(row + [t.run.motion[c] for c in columns])


if __name__ == "__main__":
    typer.run(main)
