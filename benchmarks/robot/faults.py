"""What becomes of a walk when the planner goes silent, or an operator stops it, at a random moment?

    python benchmarks/faults.py [--moments 50] [--clips FILE] [--jobs 2] [--seed 0]

Walking clips of `spine.py`, each moment drawn anew while the robot streams; in lockstep, with the nominal robot and
with the perturbed one of `spine.py`. The mechanics in real processes (signals, scheduling) are tests: `tests/system`.

- silent: no plan is made from that moment on, as when the planner's process is killed or stopped: HOLD, standing;
- STOP: a balanced stop: HOLD, standing 3 s later;
- E-STOP: goals freeze at the next tick, then the robot parks: upright 3 s later.

Exits 1 where fewer than 90 % (silent) or 95 % (stops) of the nominal runs stay up.
"""

from __future__ import annotations

import os
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

# Before NumPy is loaded: a run is one thread, --jobs says how many there are.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import typer
import yaml
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from spine import ARCHIVES, CLIPS, extract

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.importers import load
from flexmotion.retarget.plan import Plan
from flexmotion.streamer.commands.driver_options import simulation_options
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.planning.planner import Planned, Planner
from flexmotion.streamer.planning.replanning import Superseded
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

KINDS = {"silent": (None, 0.90), "STOP": (Request.STOP, 0.95), "E-STOP": (Request.ESTOP, 0.95)}
AFTER_S = 3.0
TILTED = np.cos(np.radians(45.0))


class FallsSilent(Planner):
    """A planner that makes no more plans that would join after a given tick."""

    last_tick = 0

    def plan(self, join: int, current: Plan | None, **how: object) -> Planned:
        """See `Planner.plan`."""
        if join > self.last_tick:
            raise Superseded
        return super().plan(join, current, **how)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Trial:
    """One run: what happened when, and how it ended."""

    kind: str
    clip: str
    perturbed: bool
    moment_s: float
    upright: bool
    held: bool
    frozen_ticks: int


def trial(kind: str, file: Path, perturbed: bool, share: float, seed: int) -> Trial:
    """Disturb one walk; `share` in [0, 1] says where in the clip."""
    request, _ = KINDS[kind]
    robot = load_robot("op3")
    options = simulation_options(perturbed, ["total_mass=3.5"] if perturbed else [])
    source, settings = ClipSource(load(file)), load_stream()
    session = Session(robot, create("sim", robot, **options, seed=seed), source, settings, source.seconds)
    begin = 0.6 + settings.lead_in_s  # the robot is up, and what precedes the clip is over
    tick = round((begin + share * source.seconds) * robot.rate_hz)
    if request is None:
        silent = FallsSilent(session.planner.retargeter, source, settings)
        silent.last_tick = tick
        session.planner = silent
    else:
        session.next_request = lambda: request if session.loop is not None and session.loop.tick_count == tick else None
    record = session.run("lockstep")
    w, x, y, z = record.true_base[:, 3:].T
    up = 1 - 2 * (x * x + y * y) > TILTED
    until = tick + round(AFTER_S * robot.rate_hz)
    goals = record.q_cmd[tick - 1 : tick + 40]
    moved = np.flatnonzero(np.abs(np.diff(goals, axis=0)).max(axis=1) > 0)
    return Trial(
        kind,
        file.stem,
        perturbed,
        tick / robot.rate_hz,
        upright=bool(up[:until].all()),
        held=bool((record.state[tick:] == State.HOLD).any()),
        frozen_ticks=int(moved[-1]) + 1 if request is Request.ESTOP and len(moved) else 0,
    )


def main(
    moments: Annotated[int, typer.Option(help="Random moments of each kind, nominal and perturbed.")] = 50,
    clips: Annotated[Path, typer.Option(help="List of clips.")] = CLIPS,
    jobs: Annotated[int, typer.Option(help="Runs at a time.")] = 2,
    seed: Annotated[int, typer.Option(help="Of moments and robots.")] = 0,
) -> None:
    """Run every trial and print the shares that stayed up."""
    console, rng = Console(), np.random.default_rng(seed)
    walking = yaml.safe_load(clips.read_text(encoding="utf-8"))["walking"]
    done: list[Trial] = []
    with (
        tempfile.TemporaryDirectory() as name,
        Progress(console=Console(stderr=True)) as progress,
        ProcessPoolExecutor(jobs) as pool,
    ):
        folder = Path(name)
        for collection in ARCHIVES:
            extract(collection, walking.get(collection, []), folder)
        names = [clip for own in walking.values() for clip in own]
        futures = [
            pool.submit(trial, kind, folder / f"{names[k % len(names)]}.bvh", perturbed, rng.uniform(), seed + k)
            for kind in KINDS
            for perturbed in (False, True)
            for k in range(moments)
        ]
        bar = progress.add_task("moments", total=len(futures))
        for future in as_completed(futures):
            done.append(future.result())
            progress.advance(bar)
    table = Table("what", "robot", "runs", "upright 3 s later", "reached HOLD", "goals moved for [ticks]")
    failed = False
    for kind, (_, wanted) in KINDS.items():
        for perturbed in (False, True):
            group = [t for t in done if t.kind == kind and t.perturbed == perturbed]
            up = sum(t.upright for t in group) / len(group)
            held = sum(t.held for t in group) / len(group)
            moved = f"max {max(t.frozen_ticks for t in group)}" if kind == "E-STOP" else ""
            table.add_row(
                kind, "perturbed" if perturbed else "nominal", str(len(group)), f"{up:.0%}", f"{held:.0%}", moved
            )
            ends_right = sum(t.upright and t.held and t.frozen_ticks <= 2 for t in group) / len(group)
            failed |= not perturbed and ends_right < wanted
    console.print(table)
    for t in done:
        if not t.upright:
            console.print(f"fell: {t.kind} {t.clip} at {t.moment_s:.2f} s{' perturbed' if t.perturbed else ''}")
    if failed:
        sys.exit(1)


if __name__ == "__main__":
    typer.run(main)
