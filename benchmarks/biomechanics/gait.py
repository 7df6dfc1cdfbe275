"""Ground forces and joint moments from kinematics alone, against force plates and a reference tool.

    python benchmarks/biomech_gait.py [TRIAL.npz] [--fps 30] [--belt SPEED] [--plots FOLDER]

Prints root mean square errors per foot; exits with 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from gait_trial import MOMENTS, GaitTrial, default_path, load_trial

from flexmotion.biomechanics.dynamics import Dynamics, dynamics
from flexmotion.human.skeleton import DOF_COUNT, JOINTS
from flexmotion.spatial.gravity import GRAVITY

FORCES = {"vertical": (2, 4.5), "fore-aft": (0, 2.5), "side": (1, 2.5)}
# Adduction and rotation of the hip are held to the limit of the hip.
LIMITS = {"hip": 0.15, "knee": 0.15, "ankle": 0.18}
FEET = ("left", "right")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trial", nargs="?", type=Path, default=default_path())
    parser.add_argument("--fps", type=float, default=30.0)
    parser.add_argument("--belt", type=float, help="treadmill speed [m/s]; estimated from the feet where left out")
    parser.add_argument("--plots", type=Path, help="folder for plots of measured against computed")
    options = parser.parse_args()

    trial = load_trial(options.trial, options.fps, options.belt)
    start = time.perf_counter()
    found = dynamics(trial.motion)
    seconds = time.perf_counter() - start
    body = trial.motion.body
    print(f"{options.trial.name}: {len(trial.motion)} frames at {options.fps:g} Hz, {body.mass:.1f} kg, fitted height")
    print(f"{body.height:.2f} m, belt {-trial.belt[0]:.2f} m/s; dynamics in {1e3 * seconds:.0f} ms\n")
    passed = report_forces(trial, found) & report_moments(trial, found)
    residual = np.median(found.residual, axis=0)
    print(f"\nroot residual, median: {100 * residual[0]:.2f} % of body weight, {residual[1]:.4f} body weights x m")
    if options.plots:
        options.plots.mkdir(parents=True, exist_ok=True)
        plot_forces(trial, found, options.plots / "ground_forces.png")
        plot_moments(trial, found, options.plots / "joint_moments.png")
        print(f"plots: {options.plots}/ground_forces.png, joint_moments.png")
    return 0 if passed else 1


def force_error(trial: GaitTrial, found: Dynamics) -> np.ndarray:
    """RMSE per foot and axis, (2, 3) [% of body weight]."""
    assert found.motion.wrenches is not None
    error = (found.motion.wrenches[..., :3] - trial.forces)[trial.valid]
    return 100 * np.sqrt(np.mean(error**2, axis=0)) / (trial.motion.body.mass * GRAVITY)


def moment_of(found: Dynamics, joint: str) -> np.ndarray:
    """Computed moment per body mass, (T,) [N·m/kg]."""
    assert found.motion.torques is not None
    column = DOF_COUNT - len(JOINTS) + JOINTS.index(joint)
    return found.motion.torques[:, column] / found.motion.body.mass


def report_forces(trial: GaitTrial, found: Dynamics) -> bool:
    error, passed = force_error(trial, found), True
    print("ground force, RMSE [% of body weight]   left   right   target")
    for name, (axis, limit) in FORCES.items():
        left, right = error[:, axis]
        passed &= max(left, right) <= limit
        print(f"  {name:36s} {left:6.2f}  {right:6.2f}   {limit:6.2f}")
    return passed


def report_moments(trial: GaitTrial, found: Dynamics) -> bool:
    passed = True
    print("joint moment, RMSE [N·m/kg]             left   right   target")
    for joint in MOMENTS:
        errors = []
        for side in "lr":
            reference = trial.moments[f"{joint}_{side}"] / trial.motion.body.mass
            errors.append(np.sqrt(np.mean((moment_of(found, f"{joint}_{side}") - reference)[trial.valid] ** 2)))
        limit = LIMITS[joint.partition("_")[0]]
        passed &= max(errors) <= limit
        print(f"  {joint:36s} {errors[0]:6.3f}  {errors[1]:6.3f}   {limit:6.2f}")
    return passed


def plot_forces(trial: GaitTrial, found: Dynamics, path: Path) -> None:
    weight = trial.motion.body.mass * GRAVITY
    assert found.motion.wrenches is not None
    figure, axes = plt.subplots(2, 3, figsize=(12, 6), sharex=True, layout="constrained")
    for side, row in enumerate(axes):
        for axes_of, (name, (axis, _)) in zip(row, FORCES.items(), strict=True):
            axes_of.plot(trial.times, 100 * trial.forces[:, side, axis] / weight, "k", label="measured")
            axes_of.plot(trial.times, 100 * found.motion.wrenches[:, side, axis] / weight, "C0", label="computed")
            axes_of.set_title(f"{FEET[side]}, {name}")
            axes_of.grid(alpha=0.3)
        row[0].set_ylabel("force [% of body weight]")
    axes[0, 0].legend()
    figure.supxlabel("time [s]")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def plot_moments(trial: GaitTrial, found: Dynamics, path: Path) -> None:
    figure, axes = plt.subplots(2, len(MOMENTS), figsize=(16, 6), sharex=True, layout="constrained")
    for side, row in zip("lr", axes, strict=True):
        for axes_of, joint in zip(row, MOMENTS, strict=True):
            name = f"{joint}_{side}"
            axes_of.plot(trial.times, trial.moments[name] / trial.motion.body.mass, "k", label="reference")
            axes_of.plot(trial.times, moment_of(found, name), "C0", label="computed")
            axes_of.set_title(name)
            axes_of.grid(alpha=0.3)
        row[0].set_ylabel("moment [N·m/kg]")
    axes[0, 0].legend()
    figure.supxlabel("time [s]")
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
