"""Does the robot stay up when every window of human motion is drawn anew, and plans disagree?

The standing and walking clips of `clips.yaml`, every second one of a kind perturbed at 3.5 kg, in lockstep, with an
error that grows to the given size at 1 s lookahead (`streamer/motion/replan_noise.py`), with balance feedback or
without. "join mm/tick" is how far a new plan's divergent component of motion moves away from the old plan's in a tick
while a join is absorbed. Judged are the runs at 5 cm with feedback.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.robot.clip_run import ClipRun
from benchmarks.robot.clips import CLIPS
from benchmarks.robot.simulation import report_of, simulator
from benchmarks.shared.cells import cell, degrees, middle, percent, share
from benchmarks.shared.clips import ClipList, ListedClip, extracted
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.human.motion import Motion
from flexmotion.importers import load
from flexmotion.retarget.plan import Plan
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.planning.planner import Planned, Planner
from flexmotion.streamer.run.session import Session

Float = NDArray[np.float64]

KINDS = ("standing", "walking")
JUDGED_M, UPRIGHT_SHARE, JOIN_MM = 0.05, 0.9, 3.0


class Feedback(StrEnum):
    """Whether balance feedback acts."""

    ON = "on"
    OFF = "off"
    BOTH = "both"


class JoinMeter(Planner):
    """A planner that notes how far each new plan's divergent component moves away from the old one's, tick by tick."""

    moves: list[Float]
    """Of each join, (ticks,) [m]; the first is the jump at the join itself."""

    @classmethod
    def of(cls, planner: Planner) -> JoinMeter:
        """A planner that does the same as another, measured."""
        meter = cls(planner.retargeter, planner.source, planner.settings)
        meter.moves = []
        return meter

    def plan(self, join: int, current: Plan | None, **how: Any) -> Planned:
        """See `Planner.plan`."""
        planned = super().plan(join, current, **how)
        if current is not None:
            rows = np.arange(round(self.settings.dcm_absorb_s * self.rate))
            old = current.dcm[np.clip(join - current.start_tick + rows, 0, len(current) - 1)]
            apart = planned.plan.dcm[: len(rows)] - old
            self.moves.append(np.linalg.norm(np.diff(apart, axis=0, prepend=np.zeros((1, 2))), axis=1))
        return planned


@dataclass(frozen=True)
class Trial:
    """One run of a clip at one size of noise; `moves_m` are the moves at its joins, (N,) [m]."""

    run: ClipRun
    noise_m: float
    feedback: bool
    moves_m: Float


def trials(
    numbered: tuple[int, ListedClip], folder: Path, noises: Sequence[float], feedbacks: Sequence[bool]
) -> list[Trial]:
    """All runs of one clip of a folder."""
    seed, clip = numbered
    file = folder / f"{clip.name}.bvh"
    motion = replace(load(file), source=file.name)
    return [trial(clip, seed, motion, noise, feedback) for noise in noises for feedback in feedbacks]


def trial(clip: ListedClip, seed: int, motion: Motion, noise_m: float, feedback: bool) -> Trial:
    """One run of one clip."""
    robot, source = load_robot("op3"), ClipSource(motion)
    driver = simulator(robot, clip.perturbed, seed)
    noisy = NoisySource(source, noise_m, seed)
    session = Session(robot, driver, noisy, load_stream(), source.seconds, feedback=feedback)
    meter = session.planner = JoinMeter.of(session.planner)
    record = session.run()
    report = json.loads(report_of(session, record, motion, seed, motion.body).json_text())
    return Trial(ClipRun(clip.kind, clip.name, clip.perturbed, report), noise_m, feedback, np.concatenate(meter.moves))


def join_figures(group: Sequence[Trial]) -> tuple[float, float]:
    """99th percentile and greatest move at joins [mm a tick]."""
    moves = 1e3 * np.concatenate([trial.moves_m for trial in group])
    return float(np.percentile(moves, 99)), float(moves.max())


def figures_of(group: Sequence[Trial]) -> dict[str, Any]:
    """Figures of a kind, size of noise and feedback; medians over the runs that stayed upright."""
    up = [t.run.motion for t in group if t.run.upright]
    usual, most = join_figures(group)
    return {
        "runs": len(group),
        "upright": share([t.run.upright for t in group]),
        "walked": share([t.run.walked for t in group]),
        "net_path": middle([m["net_path_ratio"] for m in up]),
        "slip_mm_s": middle([m["foot_slip_mm_s"] for m in up]),
        "leg_deg": middle([degrees(m["joint_rmse_rad"]) for m in up]),
        "heading_deg": middle([degrees(m["heading_rms_rad"]) for m in up]),
        "join_mm_p99": usual,
        "join_mm_most": most,
    }


def grouped(done: Sequence[Trial]) -> dict[tuple[str, float, bool], list[Trial]]:
    """Runs by kind, noise [m] and feedback."""
    groups: dict[tuple[str, float, bool], list[Trial]] = {}
    for t in done:
        groups.setdefault((t.run.kind, t.noise_m, t.feedback), []).append(t)
    return dict(sorted(groups.items(), key=lambda item: (KINDS.index(item[0][0]), item[0][1], not item[0][2])))


def table(done: Sequence[Trial]) -> Table:
    """One row a kind, size of noise and feedback."""
    out = Table(title="Replan noise (medians of those upright)")
    columns = "kind", "noise cm", "feedback", "runs", "upright", "walked", "net path", "slip mm/s", "leg °", "heading °"
    for name in (*columns, "join mm/tick p99", "max"):
        out.add_column(name)
    for (kind, noise_m, feedback), group in grouped(done).items():
        found = figures_of(group)
        out.add_row(
            kind,
            f"{100 * noise_m:.0f}",
            "on" if feedback else "off",
            str(len(group)),
            percent([t.run.upright for t in group]),
            "" if kind == "standing" else percent([t.run.walked for t in group]),
            *(cell(found[name]) for name in ("net_path", "slip_mm_s", "leg_deg")),
            cell(found["heading_deg"], ".1f"),
            *(cell(found[name]) for name in ("join_mm_p99", "join_mm_most")),
        )
    return out


def verdicts(done: Sequence[Trial]) -> list[Verdict]:
    """The criteria."""
    judged = [t for t in done if t.feedback and t.noise_m == JUDGED_M]
    found = []
    for kind in KINDS:
        up = [t.run.upright for t in judged if t.run.kind == kind]
        if up:
            sentence = f"{kind} clips upright at 5 cm: {percent(up)} (>= {100 * UPRIGHT_SHARE:.0f} %)"
            found.append(Verdict(sentence, share(up) >= UPRIGHT_SHARE))
    if judged:
        usual, most = join_figures(judged)
        sentence = f"joins at 5 cm move the DCM by {most:.1f} mm a tick (p99: {usual:.1f}) (<= {JOIN_MM:.0f})"
        found.append(Verdict(sentence, most <= JOIN_MM))
    return found


def csv_row(t: Trial) -> dict[str, Any]:
    """One run's figures."""
    usual, most = join_figures([t])
    own = {"kind": t.run.kind, "clip": t.run.clip, "perturbed": t.run.perturbed, "noise_m": t.noise_m}
    return own | {"feedback": t.feedback, "join_p99_mm": usual, "join_max_mm": most} | t.run.motion


def main(
    noise: Annotated[list[float] | None, typer.Option(help="Error at 1 s lookahead [m]; may be given again.")] = None,
    feedback: Annotated[Feedback, typer.Option(help="Balance feedback.")] = Feedback.BOTH,
    clips: Annotated[Path, typer.Option(help="YAML list of clips by kind and collection.")] = CLIPS,
    jobs: JobsOption = 1,
    seed: Annotated[int, typer.Option(help="Of the first clip; each clip has its own.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run all clips and judge."""
    noises = noise or [0.0, 0.02, 0.05, 0.10]
    feedbacks = {Feedback.ON: [True], Feedback.OFF: [False], Feedback.BOTH: [True, False]}[feedback]
    listed = ClipList(clips, KINDS)
    numbered = [(seed + number, clip) for number, clip in enumerate(listed.clips)]
    with extracted(listed.by_collection) as folder:
        one = partial(trials, folder=folder, noises=noises, feedbacks=feedbacks)
        done = [t for own in in_order(one, numbered, jobs) for t in own]
    Console(width=160).print(table(done))
    if csv_out is not None:
        write_csv(csv_out, [csv_row(t) for t in done])
    figures = {
        f"{kind}, {100 * noise_m:g} cm, feedback {'on' if on else 'off'}": figures_of(group)
        for (kind, noise_m, on), group in grouped(done).items()
    }
    return Outcome(verdicts(done), figures)
