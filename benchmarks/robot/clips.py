"""Real clips through `flexmotion dry-run` in lockstep: does the robot stay up, and does it go where the human went?

    python benchmarks/spine.py [--clips FILE] [--jobs 2] [--seed 0] [--csv OUT]

Half of the clips run perturbed (torso mass, gains, latency, friction, slope, pushes) at 3.5 kg. The clips come from the
folder in `FLEXMOTION_SHARED` (default: `shared` beside the project). Prints a table by clip, one by kind, whether a
second run of a clip gives the same bytes, and each criterion with its verdict; exits 1 where one fails.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import typer
import yaml
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

CLIPS = Path(__file__).with_name("spine_clips.yaml")
ARCHIVES = {"bandai": "bandai.tar.xz", "cmu": "cmu_raw.tar.xz"}
PERTURBED = ["--perturbed", "--perturb", "total_mass=3.5"]
TIMING_KEYS = ("loop", "planner", "log")


@dataclass(frozen=True)
class Run:
    """One clip and what `dry-run` reported of it."""

    kind: str
    clip: str
    perturbed: bool
    report: dict[str, Any]

    @property
    def motion(self) -> dict[str, Any]:
        """The report's motion figures."""
        figures: dict[str, Any] = self.report["motion"]
        return figures

    @property
    def upright(self) -> bool:
        """Whether the robot did not fall."""
        return not self.motion["fell"]

    @property
    def walked(self) -> bool:
        """Upright, at least .4 of the scaled path, and at least 80 % of the human's steps."""
        ratio, human = self.motion["net_path_ratio"], self.motion["human_steps"]
        made = self.motion["steps_planned"] - self.motion["steps_inserted"]
        return self.upright and (ratio is None or ratio >= 0.4) and made >= 0.8 * human

    @property
    def knee(self) -> float:
        """RMS torque of the harder worked knee over its stall torque."""
        joints = self.report["limits"]["joints"]
        return max(load["rms_share_of_stall"] or 0.0 for name, load in joints.items() if "knee" in name)


def shared() -> Path:
    """Folder of the motion data."""
    root = os.environ.get("FLEXMOTION_SHARED")
    folder = (Path(root) if root else Path(__file__).parents[1] / ".." / "shared") / "data"
    if not folder.is_dir():
        raise typer.BadParameter("no motion data: set FLEXMOTION_SHARED to the folder that holds them")
    return folder


def extract(collection: str, names: list[str], into: Path) -> None:
    """Unpack the named clips of one archive."""
    wanted = {f"{name}.bvh" for name in names}
    with tarfile.open(shared() / ARCHIVES[collection], "r|xz") as stream:
        for member in stream:
            name = Path(member.name).name
            content = stream.extractfile(member) if name in wanted else None
            if content is not None:
                (into / name).write_bytes(content.read())
                wanted.discard(name)
            if not wanted:
                return
    raise typer.BadParameter(f"{collection}: no clip {', '.join(sorted(wanted))}")


def dry_run(clip: Path, perturbed: bool, seed: int) -> dict[str, Any]:
    """The report of one run (exit code 1 means that a check failed, and still reports)."""
    command = [sys.executable, "-m", "flexmotion.streamer", "dry-run", "--clip", str(clip), "--clock", "lockstep"]
    command += ["--seed", str(seed), "--json"]
    done = subprocess.run(
        command + (PERTURBED if perturbed else []),
        capture_output=True,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{clip.name}: exit {done.returncode}: {done.stderr.strip()}")
    report: dict[str, Any] = json.loads(done.stdout)
    return report


def middle(values: list[float | None]) -> float | None:
    """Median of what is known."""
    known = [value for value in values if value is not None]
    return median(known) if known else None


def cell(value: float | None, form: str = ".2f") -> str:
    """A figure, or a dash."""
    return "-" if value is None else format(value, form)


def degrees(value: float | None) -> float | None:
    """Radians to degrees."""
    return None if value is None else value * 57.29578


def clip_table(runs: list[Run]) -> Table:
    """One row a clip."""
    table = Table(title="Clips")
    for name in (
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
    ):
        table.add_column(name)
    for run in runs:
        m = run.motion
        table.add_row(
            run.kind,
            run.clip,
            "perturbed" if run.perturbed else "",
            "yes" if run.upright else f"fell at {m['time_to_fall_s']:.1f} s",
            cell(m["net_path_ratio"]),
            f"{m['steps_planned'] - m['steps_inserted']}+{m['steps_inserted']}/{m['human_steps']}",
            cell(m["foot_slip_mm_s"]),
            cell(degrees(m["joint_rmse_rad"])),
            cell(degrees(m["heading_rms_rad"]), ".1f"),
            cell(m["hand_error_share"]),
            f"{100 * run.knee:.0f} %",
            cell(run.report["loop"]["realtime_factor"], ".1f"),
        )
    return table


def kind_table(runs: list[Run]) -> Table:
    """One row a kind; medians over the runs that stayed upright."""
    table = Table(title="Kinds (medians of those upright; knee: RMS torque over stall)")
    for name in ("kind", "clips", "upright", "walked", "net path", "slip mm/s", "leg °", "heading °", "hand", "knee"):
        table.add_column(name)
    for kind in dict.fromkeys(run.kind for run in runs):
        own = [run for run in runs if run.kind == kind]
        up = [run for run in own if run.upright]
        table.add_row(
            kind,
            str(len(own)),
            f"{100 * len(up) / len(own):.0f} %",
            "" if kind == "standing" else f"{100 * sum(run.walked for run in own) / len(own):.0f} %",
            cell(middle([run.motion["net_path_ratio"] for run in up])),
            cell(middle([run.motion["foot_slip_mm_s"] for run in up])),
            cell(middle([degrees(run.motion["joint_rmse_rad"]) for run in up])),
            cell(middle([degrees(run.motion["heading_rms_rad"]) for run in up]), ".1f"),
            cell(middle([run.motion["hand_error_share"] for run in up])),
            cell(middle([run.knee for run in up])),
        )
    return table


def verdicts(runs: list[Run], same: bool) -> list[tuple[str, bool]]:
    """Each criterion as a sentence with its figure, and whether it holds."""
    standing = [run for run in runs if run.kind == "standing"]
    walking = [run for run in runs if run.kind == "walking"]
    slip = middle([run.motion["foot_slip_mm_s"] for run in runs]) or 0.0
    leg = middle([degrees(run.motion["joint_rmse_rad"]) for run in runs]) or 0.0
    sent = sum(run.report["limits"]["violations_sent"] for run in runs)
    pace = middle([run.report["loop"]["realtime_factor"] for run in runs]) or 0.0
    up = sum(run.upright for run in standing) / max(len(standing), 1)
    walked = sum(run.walked for run in walking) / max(len(walking), 1)
    return [
        (f"standing clips upright: {100 * up:.0f} % (100 %)", up == 1.0),
        (f"walking clips upright, net path >= .4, 80 % of the steps: {100 * walked:.0f} % (>= 90 %)", walked >= 0.9),
        (f"goals outside the envelope: {sent} (0)", sent == 0),
        (f"median foot slip: {slip:.2f} mm/s (<= 5)", slip <= 5.0),
        (f"median leg RMSE: {leg:.2f}° (<= 2.5)", leg <= 2.5),
        (f"same clip, seed and options twice: {'same bytes' if same else 'different'}", same),
        (f"median pace: {pace:.1f} times real time (>= 5; read it with --jobs 1)", pace >= 5.0),
    ]


def main(
    clips: Annotated[Path, typer.Option(help="YAML list of clips by kind and collection")] = CLIPS,
    jobs: Annotated[int, typer.Option(help="runs at a time")] = 1,
    seed: Annotated[int, typer.Option(help="seed of the first clip; each has its own")] = 0,
    csv_out: Annotated[Path | None, typer.Option("--csv", help="write one row a clip here")] = None,
) -> None:
    """Run all clips and judge."""
    kinds: dict[str, dict[str, list[str]]] = yaml.safe_load(clips.read_text(encoding="utf-8"))
    console = Console(width=160)
    with tempfile.TemporaryDirectory() as name, Progress(console=Console(stderr=True)) as progress:
        folder = Path(name)
        for collection in ARCHIVES:
            extract(collection, [c for kind in kinds.values() for c in kind.get(collection, [])], folder)
        work = [
            (kind, clip, place % 2 == 1)
            for kind, collections in kinds.items()
            for place, clip in enumerate(clip for own in collections.values() for clip in own)
        ]
        task = progress.add_task("clips", total=len(work) + 1)

        def one(item: tuple[int, tuple[str, str, bool]]) -> Run:
            number, (kind, clip, perturbed) = item
            run = Run(kind, clip, perturbed, dry_run(folder / f"{clip}.bvh", perturbed, seed + number))
            progress.advance(task)
            return run

        with ThreadPoolExecutor(jobs) as pool:
            runs = list(pool.map(one, enumerate(work)))
        again = one((0, work[0]))
        same = all(
            json.dumps(again.report[key]) == json.dumps(runs[0].report[key])
            for key in again.report
            if key not in TIMING_KEYS
        )
    console.print(clip_table(runs))
    console.print(kind_table(runs))
    judged = verdicts(runs, same)
    for sentence, holds in judged:
        console.print(f"{'[green]PASS' if holds else '[red]FAIL'}[/] {sentence}")
    if csv_out is not None:
        with csv_out.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            columns = list(runs[0].motion)
            writer.writerow(["kind", "clip", "perturbed", *columns, "violations_sent", "knee_rms_of_stall"])
            for run in runs:
                sent = run.report["limits"]["violations_sent"]
                writer.writerow([run.kind, run.clip, run.perturbed, *(run.motion[c] for c in columns), sent, run.knee])
    if not all(holds for _, holds in judged):
        sys.exit(1)


if __name__ == "__main__":
    typer.run(main)
