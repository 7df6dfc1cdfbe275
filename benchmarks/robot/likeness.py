"""Do the robot's arms and trunk go where the human's go, and never swing of their own accord?

Every clip of a list runs through the live system in lockstep, every second one of a kind perturbed as in `robot/clips`.
Directions of upper arms and forearms of the executed (simulated, true) motion are compared with the human's, each in
its own trunk's frame: that is what the joints of an arm can follow, and what the trunk lacks counts by itself, as its
range of pitch against the human's within what balance allows. Two lists of clips whose names were drawn by a hash:
`tuning` for choosing settings, `reporting` for figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.simulation import report_of, simulator
from benchmarks.shared.cells import cell, percent
from benchmarks.shared.clips import ClipList, ListedClip, extracted
from benchmarks.shared.likeness_figures import LikenessFigures, likeness_figures
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.importers import load
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.retarget.bend import TrunkBend
from flexmotion.retarget.whole_body import WholeBody
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.session import Session

FOLDER = Path(__file__).parent
LISTS = {name: FOLDER / f"likeness_{name}.yaml" for name in ("reporting", "tuning")}
GESTURES = "gestures"
UPPER_DEG, FORE_DEG, PITCH_SHARE = 20.0, 22.0, 0.85


@dataclass(frozen=True)
class LikenessRun:
    """One clip, how alike the robot was, and whether it stayed up.

    Attributes:
        plan_ms: median time of the retargeting of a plan [ms].
        self_collisions: number of contacts of the robot with itself.
        faults: of the run; one ends it, so that what came after was not followed.
    """

    clip: ListedClip
    figures: LikenessFigures
    upright: bool
    plan_ms: float
    self_collisions: int
    faults: int = 0


@lru_cache
def _robot() -> tuple[Robot, ArmChain, tuple[float, float]]:
    """The OP3, its arms, and the pitch of the trunk that balance allows at standing height [rad]."""
    robot = load_robot("op3")
    least, most = TrunkBend(robot, WholeBody(robot)).balanced[-1]
    return robot, ArmChain(robot), (float(least), float(most))


def follow(numbered: tuple[int, ListedClip], folder: Path) -> LikenessRun:
    """Run the clip of a folder with a seed.

    Raises:
        RuntimeError: the run has no true motion.
    """
    seed, clip = numbered
    motion = load(folder / f"{clip.name}.bvh")
    robot, chain, pitch_bounds = _robot()
    source = ClipSource(motion)
    session = Session(robot, simulator(robot, clip.perturbed, seed), source, load_stream(), source.seconds)
    record = session.run()
    figures = likeness_figures(record, chain, motion, pitch_bounds)
    if figures is None:
        raise RuntimeError(f"{clip.name}: no true motion in the record")
    report = report_of(session, record, motion, seed, motion.body)
    return LikenessRun(
        clip,
        figures,
        upright=not report.motion.fell,
        plan_ms=1e3 * float(np.median([plan.retarget_s for plan in record.plans])),
        self_collisions=report.motion.self_collisions or 0,
        faults=len(report.safety.faults),
    )


def clip_table(runs: Sequence[LikenessRun]) -> Table:
    """One row a clip."""
    table = Table(title="Clips (pitch: the robot's range / the human's)")
    for name in ("kind", "clip", "", "upright", "upper arm °", "forearm °", "swings", "pitch °", "touches", "plan ms"):
        table.add_column(name)
    for run in runs:
        own = run.figures
        table.add_row(
            run.clip.kind,
            run.clip.name,
            "perturbed" if run.clip.perturbed else "",
            "fell" if not run.upright else "fault" if run.faults else "yes",
            f"{own.upper_arm_deg:.1f}",
            f"{own.forearm_deg:.1f}",
            str(own.spurious_swings),
            f"{own.pitch_range_deg:.0f}/{own.human_pitch_range_deg:.0f}",
            str(run.self_collisions),
            f"{run.plan_ms:.1f}",
        )
    return table


def figures_of(runs: Sequence[LikenessRun]) -> dict[str, Any]:
    """Figures of a kind: means over all runs, also of robots that fell."""
    shares = [run.figures.pitch_share for run in runs if run.figures.pitch_share is not None]
    return {
        "clips": len(runs),
        "upright": sum(run.upright for run in runs),
        "upper_arm_deg": float(np.mean([run.figures.upper_arm_deg for run in runs])),
        "forearm_deg": float(np.mean([run.figures.forearm_deg for run in runs])),
        "spurious_swings": sum(run.figures.spurious_swings for run in runs),
        "pitch_share": float(np.mean(shares)) if shares else None,
        "self_collisions": sum(run.self_collisions for run in runs),
        "faults": sum(run.faults > 0 for run in runs),
    }


def kind_table(figures: dict[str, dict[str, Any]]) -> Table:
    """One row a kind."""
    table = Table(title="Kinds (pitch: mean share of what balance allows, where the human bends)")
    for name in ("kind", "clips", "upright", "upper arm °", "forearm °", "swings", "pitch", "touches"):
        table.add_column(name)
    for kind, own in figures.items():
        table.add_row(
            kind,
            *(str(own[name]) for name in ("clips", "upright")),
            *(cell(own[name], ".1f") for name in ("upper_arm_deg", "forearm_deg")),
            str(own["spurious_swings"]),
            cell(own["pitch_share"]),
            str(own["self_collisions"]),
        )
    return table


def verdicts(runs: Sequence[LikenessRun]) -> list[Verdict]:
    """The criteria."""
    gestures = figures_of([run for run in runs if run.clip.kind == GESTURES])
    every = figures_of(runs)
    upper, fore, swings = gestures["upper_arm_deg"], gestures["forearm_deg"], every["spurious_swings"]
    up = [run.upright for run in runs]
    share = every["pitch_share"]
    return [
        Verdict(f"upper arms of gestures: {upper:.1f}° (<= {UPPER_DEG:g})", upper <= UPPER_DEG),
        Verdict(f"forearms of gestures: {fore:.1f}° (<= {FORE_DEG:g})", fore <= FORE_DEG),
        Verdict(f"spurious swings: {swings} (0)", swings == 0),
        Verdict(
            f"pitch of the trunk over what balance allows: {cell(share)} (>= {PITCH_SHARE:g})",
            share is None or share >= PITCH_SHARE,
        ),
        Verdict(f"upright: {percent(up)} (100 %)", all(up)),
        Verdict(f"runs that ended by a fault: {every['faults']} (0)", every["faults"] == 0),
    ]


def csv_row(run: LikenessRun) -> dict[str, Any]:
    """One clip's figures."""
    own = {"kind": run.clip.kind, "clip": run.clip.name, "perturbed": run.clip.perturbed, "upright": run.upright}
    return own | asdict(run.figures) | {"self_collisions": run.self_collisions, "plan_ms": run.plan_ms}


def main(
    clips: Annotated[str, typer.Option(help="reporting, tuning, or a YAML list of clips by kind.")] = "reporting",
    jobs: JobsOption = 1,
    seed: Annotated[int, typer.Option(help="Of the first clip; each clip has its own.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run all clips and judge."""
    listed = ClipList(LISTS.get(clips, Path(clips)))
    with extracted(listed.by_collection) as folder:
        runs = in_order(partial(follow, folder=folder), [(seed + n, clip) for n, clip in enumerate(listed.clips)], jobs)
    kinds = dict.fromkeys(run.clip.kind for run in runs)
    figures = {kind: figures_of([run for run in runs if run.clip.kind == kind]) for kind in kinds}
    console = Console(width=160)
    console.print(clip_table(runs))
    console.print(kind_table(figures))
    if csv_out is not None:
        write_csv(csv_out, [csv_row(run) for run in runs])
    return Outcome(verdicts(runs), figures)
