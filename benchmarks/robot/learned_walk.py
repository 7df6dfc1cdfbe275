"""How fast does a learned policy walk this robot, in the same envelope?

The measure of what the simulated robot can do. A policy that sees encoders and IMU corrects a periodic gait; its goals
go through the loop's clamp and the bus's delay to the same servos as a plan's (`benchmarks/robot/learned/`). It walks
ahead at each speed, nominal and with the standard perturbations, on seeds that its training did not see. "fastest" is
the greatest speed up to which, at every speed, 95 % of the runs stay upright. Beside it stands the walk by plans, as
fast as the robot file lets it, and the gait without corrections.

`--train FOLDER` searches the gait (CMA-ES) and then trains the policy (PPO) for the given times, or goes on with what
is in the folder; the policy is `FOLDER/policy.npz`. It needs the extras `train` and `tune`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.learned.evaluation import Walked, evaluate, evaluate_plan
from benchmarks.robot.learned.policy import Policy
from benchmarks.robot.learned.walk import SEEN
from benchmarks.shared.cells import cell, middle, share
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import load_robot

SHIPPED = Path(__file__).with_name("learned") / "op3.npz"
"""The policy that is measured unless another one is given."""
SPEEDS = (0.1, 0.2, 0.3, 0.4, 0.45, 0.5, 0.55)
"""That are asked for [m/s]."""
SEED = 5_000
"""First seed of what is reported; training draws its robots anew in every episode, of seeds of its own."""
TRAINED_SEED = 0
UPRIGHT, LIFTED_M, POLICY_US = 0.95, 0.01, 200.0
"""Share of runs that stay upright; height of a swing that is no shuffle [m]; longest time of a policy's step [us]."""
LEARNED, GAIT, PLAN = "learned", "gait alone", "plan"


@dataclass(frozen=True)
class Task:
    """One run: what walks, the asked speed [m/s], whether the robot is perturbed, seed, and length [s]."""

    by: str
    asked: float
    perturbed: bool
    seed: int
    seconds: float


def run(task: Task, file: Path, robot_name: str) -> Walked:
    """One run."""
    robot, policy = load_robot(robot_name), Policy.load(file)
    if task.by == PLAN:
        return evaluate_plan(robot, task.asked, task.perturbed, task.seed, task.seconds)
    own = policy if task.by == LEARNED else Policy.still(policy.gait)
    return evaluate(robot, own, task.asked, task.perturbed, task.seed, task.seconds)


def train(folder: Path, robot_name: str, gait_minutes: float, minutes: float) -> None:
    """Search a gait, unless the folder has one, and train a policy on it.

    Raises:
        ConfigError: an extra is missing.
    """
    for module, extra in (("torch", "train"), ("cma", "tune")):
        if find_spec(module) is None:
            raise ConfigError(f"--train needs the extra {extra!r}: in a clone, pip install '.[{extra}]'")
    import torch

    from benchmarks.robot.learned.gait_search import search_gait
    from benchmarks.robot.learned.training import Training

    torch.set_num_threads(1)
    robot, found = load_robot(robot_name), folder / "gait.npz"
    folder.mkdir(parents=True, exist_ok=True)
    if not found.is_file():
        Policy.still(search_gait(robot, folder, gait_minutes, TRAINED_SEED)).write(found)
    Training(robot, Policy.load(found).gait, TRAINED_SEED, folder).run(60.0 * minutes)


def group_of(runs: Sequence[Walked]) -> dict[str, Any]:
    """Figures of runs at one speed: medians over those upright."""
    up = [own for own in runs if own.upright]
    names = ("speed", "heading_deg", "aside", "slip", "height", "swing_s", "double_share", "torque", "saturated")
    known = {name: middle([abs(v) if np.isfinite(v := getattr(own, name)) else None for own in up]) for name in names}
    return {"runs": len(runs), "upright": len(up), "outside": sum(own.violations for own in runs)} | known


def fastest(groups: dict[float, dict[str, Any]]) -> float:
    """Greatest asked speed up to which enough runs stay upright at every speed; 0 without any [m/s]."""
    best = 0.0
    for asked in sorted(groups):
        if groups[asked]["upright"] < UPRIGHT * groups[asked]["runs"]:
            break
        best = asked
    return best


def step_time(policy: Policy) -> float:
    """Median time of a step of a policy on one robot, in NumPy [us]."""
    seen, times = np.zeros(SEEN), []
    for _ in range(2000):
        begin = time.perf_counter()
        policy.act(seen)
        times.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(times))


def table(groups: dict[str, dict[float, dict[str, Any]]]) -> Table:
    """One row a walk and speed."""
    out = Table(title="Walking ahead (medians of those upright)")
    for name in ("walk", "asked", "upright", "goes", "heading°", "slip mm/s", "lift mm", "swing s", "both", "torque"):
        out.add_column(name, justify="right")
    out.add_column("outside", justify="right")
    for walk, own in groups.items():
        for asked, found in own.items():
            out.add_row(
                walk,
                f"{asked:.3f}",
                f"{found['upright']} of {found['runs']}",
                cell(found["speed"], ".3f"),
                cell(found["heading_deg"], ".1f"),
                cell(_scaled(found["slip"]), ".1f"),
                cell(_scaled(found["height"]), ".1f"),
                cell(found["swing_s"]),
                cell(found["double_share"]),
                cell(found["torque"]),
                str(found["outside"]),
            )
    return out


def verdicts(groups: dict[str, dict[float, dict[str, Any]]], step_us: float) -> list[Verdict]:
    """What the learned walk must keep for its speed to count."""
    found = []
    for name in ("nominal", "perturbed"):
        own, by_plan = groups[f"{LEARNED}, {name}"], groups.get(f"{PLAN}, {name}", {})
        best = fastest(own)
        goes = own[best]["speed"] if best else 0.0
        planned = max((one["speed"] or 0.0 for one in by_plan.values()), default=0.0)
        beside = f" (above the plan's {planned:.3f})" if by_plan else ""
        sentence = f"{name}: upright up to {best:.3f} m/s asked, where it goes {goes:.3f}{beside}"
        found.append(Verdict(sentence, goes > planned))
        lift = own[best]["height"] or 0.0 if best else 0.0
        least = 1e3 * LIFTED_M
        found.append(Verdict(f"{name}: lifts its feet by {1e3 * lift:.1f} mm there (>= {least:.0f})", lift >= LIFTED_M))
    outside = sum(one["outside"] for own in groups.values() for one in own.values())
    found.append(Verdict(f"goals outside the envelope: {outside} (0)", outside == 0))
    found.append(Verdict(f"a step of the policy: {step_us:.0f} us (<= {POLICY_US:.0f})", step_us <= POLICY_US))
    return found


def main(
    policy: Annotated[Path, typer.Option("--policy", help="That walks; default: the one beside the code.")] = SHIPPED,
    train_in: Annotated[Path | None, typer.Option("--train", help="Train in this folder, and measure nothing.")] = None,
    gait_minutes: Annotated[float, typer.Option(min=0.0, help="Of the search for a gait, where there is none.")] = 20.0,
    minutes: Annotated[float, typer.Option(min=0.0, help="Of this part of the training.")] = 50.0,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each speed, nominal and perturbed each.")] = 20,
    seconds: Annotated[float, typer.Option(min=4.0, help="Length of a run [s].")] = 10.0,
    speed: Annotated[float, typer.Option(min=0.0, help="One speed in place of all [m/s].")] = 0.0,
    beside: Annotated[bool, typer.Option("--beside/--alone", help="The gait alone, and plans, as well.")] = True,
    robot: Annotated[str, typer.Option("--robot", help="Robot.")] = "op3",
    jobs: JobsOption = 1,
    csv_out: CsvOption = None,
) -> Outcome:
    """Train, or measure."""
    if train_in is not None:
        train(train_in, robot, gait_minutes, minutes)
        return Outcome()
    pace = load_robot(robot).config.gait.pace
    if pace is None or pace.reached is None:
        raise ConfigError(f"robot {robot}: gait.pace.reached is not set, expected the speed that plans reach")
    speeds = (speed,) if speed else SPEEDS
    walks = [(LEARNED, asked, seeds) for asked in speeds]
    if beside:
        walks += [(GAIT, asked, max(seeds // 2, 1)) for asked in speeds] + [(PLAN, pace.reached, 3)]
    tasks = [
        Task(by, asked, perturbed, SEED + number, seconds)
        for by, asked, runs in walks
        for perturbed in (False, True)
        for number in range(runs)
    ]
    done = in_order(partial(run, file=policy, robot_name=robot), tasks, jobs)
    groups = dict[str, dict[float, list[Walked]]]()
    for task, own in zip(tasks, done, strict=True):
        name = f"{task.by}, {'perturbed' if task.perturbed else 'nominal'}"
        groups.setdefault(name, {}).setdefault(task.asked, []).append(own)
    figures = {name: {asked: group_of(runs) for asked, runs in own.items()} for name, own in groups.items()}
    step_us = step_time(Policy.load(policy))
    console = Console(width=140)
    console.print(table(figures))
    if csv_out is not None:
        write_csv(csv_out, [{"by": task.by} | asdict(own) for task, own in zip(tasks, done, strict=True)])
    kept = {name: {f"{asked:.3f} m/s": one for asked, one in own.items()} for name, own in figures.items()}
    falls = {name: share([run.upright for runs in own.values() for run in runs]) for name, own in groups.items()}
    return Outcome(verdicts(figures, step_us), kept | {"upright_of_all": falls, "step_us": step_us})


def _scaled(value: float | None) -> float | None:
    return None if value is None else 1e3 * value
