"""Does the robot stay up on real clips, and go where the human went?

Every clip of a list runs through `flexmotion dry-run` in lockstep, every second one of a kind perturbed (torso mass,
gains, latency, friction, slope, pushes) at 3.5 kg. Prints one table by clip and one by kind, and checks that a second
run of the first clip gives the same bytes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.clip_run import ClipRun
from benchmarks.robot.simulation import HEAVY_KG
from benchmarks.shared.cells import cell, degrees, middle, percent, share
from benchmarks.shared.clips import ClipList, ListedClip, extracted
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import ONE_THREAD, in_order

CLIPS = Path(__file__).with_name("clips.yaml")
PERTURBED = ["--perturbed", "--perturb", f"total_mass={HEAVY_KG:g}"]
TIMING_KEYS = ("loop", "planner", "log")
"""Parts of a report that depend on the wall clock."""
WALKED, SLIP_MM_S, LEG_DEG, PACE = 0.9, 5.0, 2.5, 5.0


def dry_run(numbered: tuple[int, ListedClip], folder: Path) -> ClipRun:
    """Run the clip of a folder with a seed; the report of a run that failed a check counts too (exit code 1).

    Raises:
        RuntimeError: there is no report.
    """
    seed, clip = numbered
    command = [sys.executable, "-m", "flexmotion.streamer", "dry-run", "--clip", str(folder / f"{clip.name}.bvh")]
    command += ["--clock", "lockstep", "--seed", str(seed), "--json", *(PERTURBED if clip.perturbed else [])]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | ONE_THREAD)
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{clip.name}: exit {done.returncode}: {done.stderr.strip()}")
    return ClipRun(clip.kind, clip.name, clip.perturbed, json.loads(done.stdout))


def clip_table(runs: Sequence[ClipRun]) -> Table:
    """One row a clip."""
    table = Table(title="Clips (steps: planned + inserted / human's; x: times real time)")
    columns = (
        "kind",
        "clip",
        "",
        "upright",
        "net path",
        "steps",
        "slip mm/s",
        "leg °",
        "heading °",
        "hand",
        "knee",
        "x",
    )
    for name in columns:
        table.add_column(name)
    for run in runs:
        m = run.motion
        table.add_row(
            run.kind,
            run.clip,
            "perturbed" if run.perturbed else "",
            "yes" if run.upright else f"fell at {m['time_to_fall_s']:.1f} s",
            cell(m["net_path_ratio"]),
            f"{run.steps}+{m['steps_inserted']}/{m['human_steps']}",
            cell(m["foot_slip_mm_s"]),
            cell(degrees(m["joint_rmse_rad"])),
            cell(degrees(m["heading_rms_rad"]), ".1f"),
            cell(m["hand_error_share"]),
            f"{100 * run.knee:.0f} %",
            cell(run.report["loop"]["realtime_factor"], ".1f"),
        )
    return table


def figures_of(runs: Sequence[ClipRun]) -> dict[str, Any]:
    """Figures of a kind; medians over the runs that stayed upright."""
    up = [run for run in runs if run.upright]
    return {
        "clips": len(runs),
        "upright": share([run.upright for run in runs]),
        "walked": share([run.walked for run in runs]),
        "net_path": middle([run.motion["net_path_ratio"] for run in up]),
        "slip_mm_s": middle([run.motion["foot_slip_mm_s"] for run in up]),
        "leg_deg": middle([degrees(run.motion["joint_rmse_rad"]) for run in up]),
        "heading_deg": middle([degrees(run.motion["heading_rms_rad"]) for run in up]),
        "hand": middle([run.motion["hand_error_share"] for run in up]),
        "knee": middle([run.knee for run in up]),
    }


def kind_table(runs: Sequence[ClipRun]) -> Table:
    """One row a kind."""
    table = Table(title="Kinds (medians of those upright; knee: RMS torque over stall)")
    for name in ("kind", "clips", "upright", "walked", "net path", "slip mm/s", "leg °", "heading °", "hand", "knee"):
        table.add_column(name)
    for kind in dict.fromkeys(run.kind for run in runs):
        own = [run for run in runs if run.kind == kind]
        found = figures_of(own)
        table.add_row(
            kind,
            str(len(own)),
            percent([run.upright for run in own]),
            "" if kind == "standing" else percent([run.walked for run in own]),
            *(cell(found[name]) for name in ("net_path", "slip_mm_s", "leg_deg")),
            cell(found["heading_deg"], ".1f"),
            *(cell(found[name]) for name in ("hand", "knee")),
        )
    return table


def verdicts(runs: Sequence[ClipRun], same: bool) -> list[Verdict]:
    """The criteria."""
    standing = [run.upright for run in runs if run.kind == "standing"]
    walking = [run.walked for run in runs if run.kind == "walking"]
    slip = middle([run.motion["foot_slip_mm_s"] for run in runs]) or 0.0
    leg = middle([degrees(run.motion["joint_rmse_rad"]) for run in runs]) or 0.0
    sent = sum(run.report["limits"]["violations_sent"] for run in runs)
    pace = middle([run.report["loop"]["realtime_factor"] for run in runs]) or 0.0
    walked = f"walking clips upright, net path >= .4, 80 % of the steps: {percent(walking)} (>= {100 * WALKED:.0f} %)"
    return [
        Verdict(f"standing clips upright: {percent(standing)} (100 %)", all(standing) and bool(standing)),
        Verdict(walked, share(walking) >= WALKED),
        Verdict(f"goals outside the envelope: {sent} (0)", sent == 0),
        Verdict(f"median foot slip: {slip:.2f} mm/s (<= {SLIP_MM_S:g})", slip <= SLIP_MM_S),
        Verdict(f"median leg RMSE: {leg:.2f}° (<= {LEG_DEG:g})", leg <= LEG_DEG),
        Verdict(f"same clip, seed and options twice: {'same bytes' if same else 'different'}", same),
        Verdict(f"median pace: {pace:.1f} times real time (>= {PACE:g} on an idle machine)", pace >= PACE),
    ]


def equal_bytes(first: ClipRun, second: ClipRun) -> bool:
    """Whether two reports agree in all that does not depend on the wall clock."""
    keys = [key for key in second.report if key not in TIMING_KEYS]
    return all(json.dumps(first.report[key]) == json.dumps(second.report[key]) for key in keys)


def csv_row(run: ClipRun) -> dict[str, Any]:
    """One clip's figures."""
    own = {"kind": run.kind, "clip": run.clip, "perturbed": run.perturbed}
    sent = run.report["limits"]["violations_sent"]
    return own | run.motion | {"violations_sent": sent, "knee_rms_of_stall": run.knee}


def main(
    clips: Annotated[Path, typer.Option(help="YAML list of clips by kind and collection.")] = CLIPS,
    jobs: JobsOption = 1,
    seed: Annotated[int, typer.Option(help="Of the first clip; each clip has its own.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run all clips and judge."""
    listed = ClipList(clips)
    numbered = [(seed + number, clip) for number, clip in enumerate(listed.clips)]
    with extracted(listed.by_collection) as folder:
        *runs, again = in_order(partial(dry_run, folder=folder), [*numbered, numbered[0]], jobs)
    console = Console(width=160)
    console.print(clip_table(runs))
    console.print(kind_table(runs))
    if csv_out is not None:
        write_csv(csv_out, [csv_row(run) for run in runs])
    kinds = dict.fromkeys(run.kind for run in runs)
    figures = {kind: figures_of([run for run in runs if run.kind == kind]) for kind in kinds}
    return Outcome(verdicts(runs, equal_bytes(runs[0], again)), figures)
