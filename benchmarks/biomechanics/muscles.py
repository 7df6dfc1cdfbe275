"""Do the muscle activations of walking clips give the joint torques, without overload of muscles and joints?

Walking clips are taken evenly from each collection of a folder of motion data. A forward pass of MuJoCo with a frame's
activations (of the legs: with their forces at MuJoCo's own lengths and speeds) must give the frame's torques within
2 %. Fails below 90 % of all frames, where an activation leaves [0, 1] or changes faster than activation dynamics allow,
where a leg muscle is saturated in more than 5 % of the frames, or where hip or knee carry more than implants measure:
4.5 and 3.2 body weights, as peak of a stance phase, in the mean over all walks (Bergmann et al., PLoS ONE 9(1), 2014;
Fregly et al., J. Orthop. Res. 30(4), 2012).
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
import typer
from numpy.typing import NDArray

from benchmarks.shared.clips import data_folder
from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.biomechanics.activation import activation_limits
from flexmotion.biomechanics.differentiation import derivative
from flexmotion.biomechanics.dynamics import dynamics
from flexmotion.biomechanics.joint_contact import compression, joint_contact_forces, stance_peaks
from flexmotion.biomechanics.muscle_geometry import muscle_models
from flexmotion.biomechanics.static_optimisation import MuscleState, infeasible, static_optimisation, strength
from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.clips import Clip, find_clips
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS
from flexmotion.importers import load
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

CLOSE = 0.02
TARGET = 0.9

SATURATED = 0.99
"""Activation of a saturated muscle; a bound of activation dynamics is below 1 by some thousandths."""

MOST_SATURATED = 0.05
"""Most frames with a saturated leg muscle, as a share."""

MOST_PEAK = {"hip": 4.5, "knee": 3.2}
"""Greatest peak compression of a stance phase, mean over walks [body weights]."""

GOOD = 0.1
"""Residuals of frames whose contact forces count, as in a set [body weights, body weights x m]."""


@dataclass(frozen=True)
class Result:
    """Figures of one clip.

    Attributes:
        whole: error of a frame's torques as a share of them, all joints that muscles move together, (T,).
        each: greatest error of a joint as a share of that joint's largest torque in the clip, (T,).
        missing: frames whose torque the muscles cannot give, by joint, (T, 13).
        outside: activations beyond [0, 1] or faster than allowed.
        peaks: greatest compression along the segment at each crossing, (7,) [body weights].
        stance_peaks: the same as mean over stance phases, (7,) [body weights]; NaN without one.
        saturated: frames with a saturated leg muscle, (T,).
        residual: median force and moment of the root, (2,) [body weights, body weights x m].
    """

    whole: Float
    each: Float
    missing: NDArray[np.bool_]
    outside: int
    peaks: Float
    stance_peaks: Float
    saturated: NDArray[np.bool_]
    residual: Float


def walking(clips: list[Clip], count: int) -> dict[str, list[Clip]]:
    """At most `count` walking clips of every collection, spread over all."""
    found: dict[str, list[Clip]] = {}
    for clip in clips:
        if "walk" in (clip.labels.get("content"), clip.labels.get("action")):
            found.setdefault(clip.collection, []).append(clip)
    return {
        name: [all_[number * len(all_) // count] for number in range(min(count, len(all_)))]
        for name, all_ in found.items()
    }


def examined(clip: Clip) -> Result:
    """Dynamics and muscles of a clip, and its figures."""
    found = dynamics(load(clip.path, clip=clip.member or None))
    motion = found.motion
    state = static_optimisation(motion)
    assert motion.torques is not None
    columns = [DOF_COUNT - len(JOINTS) + JOINTS.index(joint) for joint in state.joints]
    wanted, made = motion.torques[:, columns], forward_torques(motion, state)
    error = made - wanted
    assert motion.contacts is not None
    pressed = compression(joint_contact_forces(found, state), state.crossings, motion.body.mass * GRAVITY)
    legs = sum(model.model.nu for model in muscle_models()[:2])
    return Result(
        whole=np.linalg.norm(error, axis=1) / np.linalg.norm(wanted, axis=1),
        each=np.max(np.abs(error) / np.abs(wanted).max(axis=0), axis=1),
        missing=infeasible(state, motion),
        outside=outside_dynamics(motion, state),
        peaks=pressed.max(axis=0),
        stance_peaks=stance_peaks(
            pressed, state.crossings, motion.contacts, found.residual.max(axis=1) <= GOOD, motion.fps
        ),
        saturated=state.activations[:, :legs].max(axis=1) >= SATURATED,
        residual=np.median(found.residual, axis=0),
    )


def forward_torques(motion: Motion, state: MuscleState, every: int = 1) -> Float:
    """Joint torques of a full forward pass with these activations in every n-th frame, (T / n, 13) [N·m]."""
    columns, column = [], 0
    for muscles in muscle_models():
        model, data = muscles.model, mujoco.MjData(muscles.model)
        rates = derivative(motion.joints[:, muscles.columns], motion.fps)
        chosen = range(0, len(motion), every)
        made = np.empty((len(chosen), len(muscles.joints)))
        for row, frame in enumerate(chosen):
            qpos, slopes = muscles.pose(motion.joints[frame, muscles.columns])
            data.qpos[:], data.qvel[:] = qpos, slopes @ rates[frame]
            activations = state.activations[frame, column : column + model.nu]
            if muscles.hill is None:
                data.act[:] = activations
            else:
                # MuJoCo's own lengths and speeds.
                mujoco.mj_forward(model, data)
                activations = activations * muscles.hill.tension(data.actuator_length, data.actuator_velocity)
            data.ctrl[:] = activations
            mujoco.mj_forward(model, data)
            made[row] = slopes.T @ data.qfrc_actuator
        columns.append(strength(motion.body) * made)
        column += model.nu
    return np.concatenate(columns, axis=1)


def outside_dynamics(motion: Motion, state: MuscleState) -> int:
    """Number of activations outside [0, 1], or out of reach from the frame before with excitations of 0 to 1."""
    count, column = 0, 0
    for muscles in muscle_models():
        limits = activation_limits(1.0 / motion.fps, *muscles.time_constants)
        mine = state.activations[:, column : column + muscles.model.nu]
        lower, upper = limits.bounds(mine[:-1])
        count += int(((mine < 0) | (mine > 1)).sum())
        count += int(((mine[1:] < lower - 1e-9) | (mine[1:] > upper + 1e-9)).sum())
        column += muscles.model.nu
    return count


def figures_of(results: Sequence[Result]) -> dict[str, Any]:
    """Figures of a collection."""
    muscles = muscle_models()
    joints = [joint for model in muscles for joint in model.joints]
    whole, each = (np.concatenate([getattr(item, name) for item in results]) for name in ("whole", "each"))
    missing = np.concatenate([item.missing for item in results])
    force, moment = np.median([item.residual for item in results], axis=0)
    peaks = np.mean([item.peaks for item in results], axis=0)
    stance = np.nanmean([item.stance_peaks for item in results], axis=0)
    return {
        "clips": len(results),
        "frames": len(whole),
        "close": float(np.mean(whole <= CLOSE)),
        "each_joint_close": float(np.mean(each <= CLOSE)),
        "infeasible": float(missing.any(axis=1).mean()),
        "infeasible_by_joint": dict(zip(joints, map(int, missing.sum(axis=0)), strict=True)),
        "outside": sum(item.outside for item in results),
        "saturated": float(np.concatenate([item.saturated for item in results]).mean()),
        "residual_percent": 100 * float(force),
        "residual_bw_m": float(moment),
        "compression_bw": dict(zip(crossings(), map(float, peaks), strict=True)),
        "stance_peaks_bw": dict(zip(crossings(), map(float, stance), strict=True)),
    }


def summary(name: str, found: dict[str, Any]) -> str:
    """Figures of a collection in words."""
    counts = ", ".join(f"{joint} {count}" for joint, count in found["infeasible_by_joint"].items())
    peaks, stance = (
        ", ".join(f"{crossing} {peak:.1f}" for crossing, peak in found[kind].items())
        for kind in ("compression_bw", "stance_peaks_bw")
    )
    return "\n".join(
        [
            f"{name}: {found['clips']} clips, {found['frames']} frames",
            f"  torque within 2 %: {100 * found['close']:.1f} % of the frames; every joint within 2 % of its largest:"
            f" {100 * found['each_joint_close']:.1f} %",
            f"  infeasible frames: {100 * found['infeasible']:.1f} %; by joint: {counts}",
            f"  activations outside [0, 1] or too fast: {found['outside']}",
            f"  root residual, median of medians: {found['residual_percent']:.2f} % of body weight,"
            f" {found['residual_bw_m']:.4f} BW·m",
            f"  a leg muscle at {SATURATED} or more: {100 * found['saturated']:.1f} % of the frames",
            f"  largest compression of a joint, mean over clips [body weights]: {peaks}",
            f"  peak of a stance phase, mean over clips [body weights]: {stance}",
        ]
    )


def main(
    folder: Annotated[Path | None, typer.Argument(help="Motion data; default: those beside the project.")] = None,
    clips: Annotated[int, typer.Option(min=1, help="Walking clips of each collection.")] = 10,
) -> Outcome:
    """Estimate the muscles of each collection's clips and put them back."""
    # Importers warn of every clip with guessed joints.
    warnings.simplefilter("ignore")
    place = folder or data_folder()
    with tempfile.TemporaryDirectory() as work:
        collections = walking(find_clips([place], Path(work)), clips)
        figures, results = {}, {}
        for name, own in collections.items():
            results[name] = [examined(clip) for clip in own]
            figures[name] = figures_of(results[name])
            print(summary(name, figures[name]), flush=True)
    if not figures:
        raise ConfigError(f"{place}: no walking clips")
    frames = sum(found["frames"] for found in figures.values())
    close = sum(found["close"] * found["frames"] for found in figures.values()) / frames
    outside = sum(found["outside"] for found in figures.values())
    saturated = sum(found["saturated"] * found["frames"] for found in figures.values()) / frames
    verdicts = [
        Verdict(
            f"torque within 2 %: {100 * close:.1f} % of {frames} frames (>= {100 * TARGET:.0f} %)", close >= TARGET
        ),
        Verdict(f"activations outside [0, 1] or too fast: {outside} (0)", outside == 0),
        Verdict(
            f"a leg muscle saturated: {100 * saturated:.1f} % (<= {100 * MOST_SATURATED:.0f} %)",
            saturated <= MOST_SATURATED,
        ),
    ]
    walks = [item for own in results.values() for item in own]
    contact = {}
    for joint, most in MOST_PEAK.items():
        columns = [at for at, name in enumerate(crossings()) if name.startswith(joint)]
        contact[joint] = float(np.nanmean([item.stance_peaks[columns] for item in walks]))
        verdicts.append(
            Verdict(
                f"peak compression of the {joint}: {contact[joint]:.1f} body weights (<= {most})",
                contact[joint] <= most,
            )
        )
    found = {"close": close, "frames": frames, "outside": outside, "saturated": saturated, "contact_bw": contact}
    return Outcome(verdicts, found | {"collections": figures})


def crossings() -> list[str]:
    """Joints whose contact force is computed."""
    return [crossing for model in muscle_models() for crossing in model.crossings]
