"""How well do ground forces and joint moments from kinematics alone agree with force plates and a reference tool?

Prints root mean square errors per foot over the valid window of a trial. Fails where one is over its target.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from matplotlib.axes import Axes
from rich.console import Console
from rich.table import Table

from benchmarks.biomechanics.gait_trial import MOMENTS, Float, GaitTrial, default_path, load_trial
from benchmarks.shared.options import PlotsOption
from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.biomechanics.dynamics import Dynamics, dynamics
from flexmotion.human.skeleton import DOF_COUNT, JOINTS, SIDES
from flexmotion.spatial.gravity import GRAVITY

FORCES = {"vertical": (2, 4.5), "fore-aft": (0, 2.5), "side": (1, 2.5)}
"""Axis of a force and the limit of its error [% of body weight]."""
LIMITS = {"hip": 0.15, "knee": 0.15, "ankle": 0.18}
"""Limit of the error of a joint's moments [N·m/kg]; the hip's holds for flexion, adduction and rotation."""
FEET = ("left", "right")


def force_errors(trial: GaitTrial, found: Dynamics) -> dict[str, Float]:
    """RMSE of the ground force by direction, of the left and right foot, (2,) [% of body weight]."""
    assert found.motion.wrenches is not None
    error = (found.motion.wrenches[..., :3] - trial.forces)[trial.valid]
    rms = 100 * np.sqrt(np.mean(error**2, axis=0)) / (trial.motion.body.mass * GRAVITY)
    return {name: rms[:, axis] for name, (axis, _) in FORCES.items()}


def moment_of(found: Dynamics, joint: str) -> Float:
    """Computed moment per body mass, (T,) [N·m/kg]."""
    assert found.motion.torques is not None
    column = DOF_COUNT - len(JOINTS) + JOINTS.index(joint)
    return found.motion.torques[:, column] / found.motion.body.mass


def moment_errors(trial: GaitTrial, found: Dynamics) -> dict[str, Float]:
    """RMSE of the moment by joint, of the left and right leg, (2,) [N·m/kg]."""

    def error(name: str) -> float:
        reference = trial.moments[name] / trial.motion.body.mass
        return float(np.sqrt(np.mean((moment_of(found, name) - reference)[trial.valid] ** 2)))

    return {joint: np.array([error(f"{joint}_{side}") for side in SIDES]) for joint in MOMENTS}


def moment_limit(joint: str) -> float:
    """Limit of the error of a joint's moment [N·m/kg]."""
    return LIMITS[joint.partition("_")[0]]


def verdicts(forces: dict[str, Float], moments: dict[str, Float]) -> list[Verdict]:
    """The criteria, over both sides."""
    found = []
    for name, (_, limit) in FORCES.items():
        worst = float(forces[name].max())
        found.append(Verdict(f"{name} force: {worst:.2f} % of body weight (<= {limit})", worst <= limit))
    for joint, errors in moments.items():
        worst, limit = float(errors.max()), moment_limit(joint)
        found.append(Verdict(f"{joint} moment: {worst:.3f} N·m/kg (<= {limit})", worst <= limit))
    return found


def table(forces: dict[str, Float], moments: dict[str, Float]) -> Table:
    """Errors of both sides beside their limits."""
    out = Table("RMSE", *FEET, "limit", title="Ground forces [% of body weight], joint moments [N·m/kg]")
    for name, (_, limit) in FORCES.items():
        out.add_row(f"force, {name}", *(f"{value:.2f}" for value in forces[name]), f"{limit:.2f}")
    for joint, errors in moments.items():
        out.add_row(f"moment, {joint}", *(f"{value:.3f}" for value in errors), f"{moment_limit(joint):.2f}")
    return out


def main(
    trial_file: Annotated[
        Path | None, typer.Argument(metavar="TRIAL", help="`.npz` of a trial; default: that of the motion data.")
    ] = None,
    fps: Annotated[float, typer.Option(min=1.0, help="Frame rate to work at.")] = 30.0,
    belt: Annotated[float | None, typer.Option(help="Treadmill speed [m/s]; default: detected.")] = None,
    motion: Annotated[
        Path | None, typer.Option(help="TRC or C3D file of the same recording, instead of the trial's joint centres.")
    ] = None,
    plots: PlotsOption = None,
) -> Outcome:
    """Compute the dynamics of a trial and compare."""
    file = trial_file or default_path()
    trial = load_trial(file, fps, belt, motion)
    begin = time.perf_counter()
    found = dynamics(trial.motion)
    seconds = time.perf_counter() - begin
    body, console = trial.motion.body, Console(width=120)
    console.print(f"{file.name}: {len(trial.motion)} frames at {fps:g} Hz; {body.mass:.1f} kg, fitted height")
    console.print(f"{body.height:.2f} m; belt {-trial.belt[0]:.2f} m/s; dynamics in {1e3 * seconds:.0f} ms")
    forces, moments = force_errors(trial, found), moment_errors(trial, found)
    console.print(table(forces, moments))
    force, moment = np.median(found.residual, axis=0)
    console.print(f"root residual, median: {100 * force:.2f} % of body weight, {moment:.4f} body weights x m")
    if plots is not None:
        plots.mkdir(parents=True, exist_ok=True)
        plot_forces(trial, found, plots / "ground_forces.png")
        plot_moments(trial, found, plots / "joint_moments.png")
    figures = {
        "force_percent": {name: float(errors.max()) for name, errors in forces.items()},
        "moment_nm_kg": {name: float(errors.max()) for name, errors in moments.items()},
        "residual_percent": 100 * float(force),
        "residual_bw_m": float(moment),
    }
    return Outcome(verdicts(forces, moments), figures)


def plot_forces(trial: GaitTrial, found: Dynamics, path: Path) -> None:
    """Measured and computed ground forces over time."""
    from flexmotion.streamer.plots.style import new_figure, save, styled

    weight = trial.motion.body.mass * GRAVITY
    assert found.motion.wrenches is not None
    with styled():
        figure = new_figure(12, 6, "Ground forces", "measured black, computed blue [% of body weight]")
        for side, row in enumerate(figure.subplots(2, 3, sharex=True)):
            for axes, (name, (axis, _)) in zip(row, FORCES.items(), strict=True):
                measured, computed = trial.forces[:, side, axis], found.motion.wrenches[:, side, axis]
                _compare(axes, trial.times, 100 * measured / weight, 100 * computed / weight)
                axes.set_title(f"{FEET[side]}, {name}")
        save(figure, path)


def plot_moments(trial: GaitTrial, found: Dynamics, path: Path) -> None:
    """Moments of the reference and computed ones over time."""
    from flexmotion.streamer.plots.style import new_figure, save, styled

    with styled():
        figure = new_figure(16, 6, "Joint moments", "reference black, computed blue [N·m/kg]")
        for side, row in zip(SIDES, figure.subplots(2, len(MOMENTS), sharex=True), strict=True):
            for axes, joint in zip(row, MOMENTS, strict=True):
                name = f"{joint}_{side}"
                reference = trial.moments[name] / trial.motion.body.mass
                _compare(axes, trial.times, reference, moment_of(found, name))
                axes.set_title(name)
        save(figure, path)


def _compare(axes: Axes, times: Float, reference: Float, computed: Float) -> None:
    from flexmotion.streamer.plots.palette import INK, LEFT

    axes.plot(times, reference, color=INK)
    axes.plot(times, computed, color=LEFT)
    axes.set_xlabel("time [s]")
