"""Does a walking robot stay up when the planner fails, or an operator stops it, at a random moment?

The walking clips of `clips.yaml`, in lockstep, nominal and perturbed; the moment is drawn anew for each run.

- silent: no plan is made from that moment on, as when the planner's process is killed or stopped: HOLD, standing;
- STOP: a balanced stop: HOLD, standing 3 s later;
- E-STOP: goals freeze at the next tick, then the robot parks: upright 3 s later.

Judged are the nominal runs. What processes and signals do is tested in `tests/system`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.clips import CLIPS
from benchmarks.robot.simulation import simulator
from benchmarks.shared.cells import share
from benchmarks.shared.clips import ClipList, extracted
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.importers import load
from flexmotion.retarget.plan import Plan
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.planning.planner import Planned, Planner
from flexmotion.streamer.planning.replanning import Superseded
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

KINDS = {"silent": (None, 0.90), "STOP": (Request.STOP, 0.95), "E-STOP": (Request.ESTOP, 0.95)}
"""What is requested, and the share of nominal runs that must end as they should."""
AFTER_S = 3.0
"""Time after the moment in which the robot must stay upright [s]."""
UPRIGHT = np.cos(np.radians(45.0))
STARTED_S = 0.6
"""The robot stands after this [s]."""
FREEZE_TICKS = 2
"""Ticks within which an E-STOP must have frozen the goals."""


class SilentPlanner(Planner):
    """A planner that makes no plan that would join after a given tick."""

    last_tick = 0

    def plan(self, join: int, current: Plan | None, **how: object) -> Planned:
        """See `Planner.plan`."""
        if join > self.last_tick:
            raise Superseded
        return super().plan(join, current, **how)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Task:
    """One run; `share` in [0, 1] is the place of the moment in the clip."""

    kind: str
    clip: str
    perturbed: bool
    share: float
    seed: int


@dataclass(frozen=True)
class Trial:
    """One run and how it ended.

    Attributes:
        moment_s: of the run [s].
        upright: the torso stayed upright until `AFTER_S` after the moment.
        held: the ladder reached HOLD.
        frozen_ticks: ticks after an E-STOP until the goals moved no more; 0 of other kinds.
    """

    kind: str
    clip: str
    perturbed: bool
    moment_s: float
    upright: bool
    held: bool
    frozen_ticks: int

    @property
    def ended_well(self) -> bool:
        """Whether it ended as it should."""
        return self.upright and self.held and self.frozen_ticks <= FREEZE_TICKS


def trial(task: Task, folder: Path) -> Trial:
    """Disturb one walk; the folder holds the clips."""
    request, _ = KINDS[task.kind]
    robot, settings = load_robot("op3"), load_stream()
    source = ClipSource(load(folder / f"{task.clip}.bvh"))
    driver = simulator(robot, task.perturbed, task.seed)
    session = Session(robot, driver, source, settings, source.seconds)
    begin = STARTED_S + settings.lead_in_s
    tick = round((begin + task.share * source.seconds) * robot.rate_hz)
    if request is None:
        silent = SilentPlanner(session.planner.retargeter, source, settings)
        silent.last_tick = tick
        session.planner = silent
    else:
        session.next_request = lambda: request if session.loop is not None and session.loop.tick_count == tick else None
    record = session.run()
    _, x, y, _ = record.true_base[:, 3:].T
    up = 1 - 2 * (x * x + y * y) > UPRIGHT
    goals = record.q_cmd[tick - 1 : tick + 40]
    moved = np.flatnonzero(np.abs(np.diff(goals, axis=0)).max(axis=1) > 0)
    return Trial(
        task.kind,
        task.clip,
        task.perturbed,
        tick / robot.rate_hz,
        upright=bool(up[: tick + round(AFTER_S * robot.rate_hz)].all()),
        held=bool((record.state[tick:] == State.HOLD).any()),
        frozen_ticks=int(moved[-1]) + 1 if request is Request.ESTOP and len(moved) else 0,
    )


def table(groups: dict[tuple[str, bool], list[Trial]]) -> Table:
    """One row a kind and robot."""
    out = Table("what", "robot", "runs", "upright 3 s later", "reached HOLD", "goals moved for [ticks]")
    for (kind, perturbed), group in groups.items():
        out.add_row(
            kind,
            "perturbed" if perturbed else "nominal",
            str(len(group)),
            f"{share([t.upright for t in group]):.0%}",
            f"{share([t.held for t in group]):.0%}",
            f"max {max(t.frozen_ticks for t in group)}" if kind == "E-STOP" else "",
        )
    return out


def verdicts(groups: dict[tuple[str, bool], list[Trial]]) -> list[Verdict]:
    """Of the nominal runs."""
    found = []
    for kind, (_, wanted) in KINDS.items():
        well = share([t.ended_well for t in groups[kind, False]])
        found.append(Verdict(f"{kind}: upright and held {well:.0%} (>= {wanted:.0%})", well >= wanted))
    return found


def figures_of(group: Sequence[Trial]) -> dict[str, float]:
    """Figures of a kind and robot."""
    return {
        "runs": len(group),
        "upright": share([t.upright for t in group]),
        "held": share([t.held for t in group]),
        "frozen_ticks_most": max(t.frozen_ticks for t in group),
    }


def main(
    moments: Annotated[int, typer.Option(min=1, help="Random moments of each kind, nominal and perturbed each.")] = 50,
    clips: Annotated[Path, typer.Option(help="YAML list of clips by kind and collection.")] = CLIPS,
    jobs: JobsOption = 2,
    seed: Annotated[int, typer.Option(help="Of moments and robots.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run every trial and count those that ended as they should."""
    rng, listed = np.random.default_rng(seed), ClipList(clips, ["walking"])
    names = [clip.name for clip in listed.clips]
    tasks = [
        Task(kind, names[k % len(names)], perturbed, rng.uniform(), seed + k)
        for kind in KINDS
        for perturbed in (False, True)
        for k in range(moments)
    ]
    with extracted(listed.by_collection) as folder:
        done = in_order(partial(trial, folder=folder), tasks, jobs)
    groups = {
        (kind, perturbed): [t for t in done if (t.kind, t.perturbed) == (kind, perturbed)]
        for kind in KINDS
        for perturbed in (False, True)
    }
    console = Console()
    console.print(table(groups))
    for t in done:
        if not t.upright:
            console.print(f"fell: {t.kind} {t.clip} at {t.moment_s:.2f} s{' perturbed' if t.perturbed else ''}")
    if csv_out is not None:
        write_csv(csv_out, [asdict(t) for t in done])
    figures = {f"{kind}, {'perturbed' if hard else 'nominal'}": figures_of(own) for (kind, hard), own in groups.items()}
    return Outcome(verdicts(groups), figures)
