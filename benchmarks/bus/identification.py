"""Does `servo identify` find what it was not told, over the bytes of an emulated bus, and do its uncertainties hold?

The servo of a joint gets figures drawn at random around the catalogue's, and a delay. The motion is planned and fitted
with the catalogue's figures alone. Fails where a figure that is called determined is off by more than a tenth (viscous
friction: of the whole drag, of which it is a part), or too few of the uncertainties cover the true value.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.shared.hidden_servos import drawn, hide
from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.configs.robot import load_robot
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.identification.excitation import plan
from flexmotion.drivers.identification.experiment import Experiment
from flexmotion.drivers.identification.identify import Identified, identify
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.registry import create
from flexmotion.drivers.sim.options import SimOptions

JOINTS = ("l_knee", "l_hip_pitch", "l_sho_pitch", "l_el")
MOST, COVERED = 0.1, 0.9
"""Greatest error of a determined figure, over it; least share of uncertainties that cover the true value."""
LIMP_S = 1.5
"""Time in which the limp robot swings to rest before it is planned for [s]."""


def one(joint: str, seed: int, timestep: float) -> tuple[dict[str, float], Identified]:
    """The hidden figures of a joint, and what was found of them."""
    robot, rng = load_robot("op3"), np.random.default_rng([seed, JOINTS.index(joint) if joint in JOINTS else 99])
    figures, delay = drawn(robot, joint, rng), float(rng.uniform(0.004, 0.012))
    with tempfile.TemporaryDirectory() as folder:
        options = SimOptions(suspended=True, extra_latency_s=delay, timestep=timestep)
        body = SimBody(hide(robot, joint, Path(folder), figures), options)
        world = Loopback(body)
        world.advance(LIMP_S)
        driver = create("dynamixel", robot, port="main")
        assert isinstance(driver, BusDriver)
        driver.open_port = world.open_port
        budget = driver.Bus.budget(robot, "main")
        with driver:
            state = RobotState(robot.n)
            for _ in range(4):
                driver.read(state)
                world.advance(1.0 / robot.rate_hz)
            planned = plan(robot, robot.index(joint), state.position, up=state.accel)
            experiment = Experiment(
                driver, bus_s=budget.write_s - budget.asked_s, clock=lambda: world.now, sleep=world.advance
            )
            record = experiment.run(planned)
    truth = figures | {"delay": delay, "torque_constant": robot.servo(joint).torque_constant or 0.0}
    return truth, identify(robot, robot.index(joint), record, "")


def judge(truth: dict[str, float], found: Identified) -> list[dict[str, Any]]:
    """One row for each figure: its error over what it is judged by, its uncertainty, whether that covers the error."""
    rows = []
    for name, true in truth.items():
        figure = found.figures.get(name)  # type: ignore[call-overload]
        scale = true + (truth["back_emf"] if name == "damping" else 0.0)
        rows.append(
            {
                "figure": name,
                "true": true,
                "found": None if figure is None else figure.value,
                "error": None if figure is None else (figure.value - true) / scale,
                "uncertainty": None if figure is None else figure.uncertainty / scale,
                "covered": None if figure is None else abs(figure.value - true) <= figure.uncertainty,
            }
        )
    return rows


def main(
    joints: Annotated[list[str] | None, typer.Option("--joint", help="Joint (repeatable); default: four.")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Draws for each joint.")] = 3,
    timestep: Annotated[float, typer.Option(help="Physics step of the emulator; goals wait for it [s].")] = 0.0005,
) -> Outcome:
    """Draw, identify, compare."""
    rows: list[dict[str, Any]] = []
    cases = [(joint, seed) for joint in joints or JOINTS for seed in range(seeds)]
    for joint, seed in track(cases, "motions"):
        truth, found = one(joint, seed, timestep)
        rows += [{"joint": joint, "seed": seed, **row} for row in judge(truth, found)]
        print(joint, seed, {r["figure"]: r["error"] and round(r["error"], 4) for r in rows[-len(truth) :]}, flush=True)
    told = [row for row in rows if row["found"] is not None]
    figures: dict[str, Any] = {"determined": len(told) / len(rows)}
    table = Table("figure", "determined", "median |error|", "largest", "median uncertainty", "covered", title="Figures")
    for name in truth:
        own = [row for row in rows if row["figure"] == name]
        known = [row for row in own if row["found"] is not None]
        if not known:
            figures[name] = {"determined": 0.0}
            continue
        errors = np.abs([row["error"] for row in known])
        figures[name] = {
            "determined": len(known) / len(own),
            "error_median": float(np.median(errors)),
            "error_most": float(errors.max()),
            "uncertainty_median": float(np.median([row["uncertainty"] for row in known])),
            "covered": float(np.mean([row["covered"] for row in known])),
        }
        table.add_row(name, *(f"{100 * value:.1f} %" for value in figures[name].values()))
    Console().print(table)
    most = max(abs(row["error"]) for row in told)
    covered = float(np.mean([row["covered"] for row in told]))
    return Outcome(
        [
            Verdict(f"largest error of a determined figure: {100 * most:.1f} % (<= {100 * MOST:g} %)", most <= MOST),
            Verdict(f"uncertainties that cover it: {100 * covered:.0f} % (>= {100 * COVERED:g} %)", covered >= COVERED),
        ],
        figures,
    )
