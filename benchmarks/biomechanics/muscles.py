"""Muscles of walking clips put back into MuJoCo's own actuators, and what presses in the joints.

    python benchmarks/biomech_muscles.py [FOLDER] [--clips 10]

FOLDER holds motion data; so many walking clips are taken evenly from each collection. A forward pass of MuJoCo with a
frame's activations has to make the frame's torques within 2 %. Exits with 1 below 90 % of all frames, or where an
activation leaves [0, 1] or changes faster than activation dynamics allow.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from gait_trial import default_path
from numpy.typing import NDArray

from flexmotion.biomechanics.activation import activation_limits
from flexmotion.biomechanics.differentiation import derivative
from flexmotion.biomechanics.dynamics import dynamics
from flexmotion.biomechanics.joint_contact import joint_contact_forces
from flexmotion.biomechanics.muscle_geometry import muscle_models
from flexmotion.biomechanics.static_optimisation import MuscleState, infeasible, static_optimisation, strength
from flexmotion.dataset.clips import Clip, find_clips
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS
from flexmotion.importers import load
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

CLOSE = 0.02
TARGET = 0.9


@dataclass(frozen=True)
class Result:
    """Of one clip.

    Attributes:
        whole: error of a frame's torques as a share of them, all joints that muscles move together, (T,).
        each: greatest error of a joint as a share of that joint's largest torque in the clip, (T,).
        missing: frames that muscles cannot make, by joint, (T, 13).
        outside: activations beyond [0, 1] or faster than allowed.
        peaks: greatest compression along the segment at each crossing, (7,) [body weights].
        residual: median force and moment of the root, (2,) [body weights, body weights x m].
    """

    whole: Float
    each: Float
    missing: NDArray[np.bool_]
    outside: int
    peaks: Float
    residual: Float


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=default_path().parent)
    parser.add_argument("--clips", type=int, default=10)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    muscles = muscle_models()
    joints = [joint for model in muscles for joint in model.joints]
    crossings = [crossing for model in muscles for crossing in model.crossings]
    close: list[NDArray[np.bool_]] = []
    outside_all = 0
    with tempfile.TemporaryDirectory() as work:
        for collection, clips in walking(find_clips([options.folder], Path(work)), options.clips).items():
            results = [examined(clip) for clip in clips]
            whole, each = (np.concatenate([getattr(item, name) for item in results]) for name in ("whole", "each"))
            missing = np.concatenate([item.missing for item in results])
            outside = sum(item.outside for item in results)
            close.append(whole <= CLOSE)
            outside_all += outside
            print(f"{collection}: {len(clips)} clips, {len(whole)} frames")
            print(f"  torques made within 2 %: {100 * np.mean(close[-1]):.1f} % of the frames", end="; ")
            print(f"every joint within 2 % of its largest: {100 * np.mean(each <= CLOSE):.1f} %")
            counts = ", ".join(f"{joint} {count}" for joint, count in zip(joints, missing.sum(axis=0), strict=True))
            print(f"  infeasible frames: {100 * missing.any(axis=1).mean():.1f} %; by joint: {counts}")
            print(f"  activations outside [0, 1] or too fast: {outside}")
            force, moment = np.median([item.residual for item in results], axis=0)
            print(f"  root residual, median of medians: {100 * force:.2f} % of body weight, {moment:.4f} BW·m")
            peaks = np.median([item.peaks for item in results], axis=0)
            text = ", ".join(f"{name} {peak:.1f}" for name, peak in zip(crossings, peaks, strict=True))
            print(f"  largest compression of a joint, median over clips [body weights]: {text}")
    if not close:
        print(f"no walking clips in {options.folder}")
        return 1
    share = float(np.mean(np.concatenate(close)))
    print(f"all: torques made within 2 % on {100 * share:.1f} % of the frames, target {100 * TARGET:.0f} %")
    return 0 if share >= TARGET and not outside_all else 1


def walking(clips: list[Clip], count: int) -> dict[str, list[Clip]]:
    """Walking clips of every collection, so many each, spread over all."""
    found: dict[str, list[Clip]] = {}
    for clip in clips:
        if "walk" in (clip.labels.get("content"), clip.labels.get("action")):
            found.setdefault(clip.collection, []).append(clip)
    return {
        name: [all_[number * len(all_) // count] for number in range(min(count, len(all_)))]
        for name, all_ in found.items()
    }


def examined(clip: Clip) -> Result:
    found = dynamics(load(clip.path, clip=clip.member or None))
    motion = found.motion
    state = static_optimisation(motion)
    assert motion.torques is not None
    columns = [DOF_COUNT - len(JOINTS) + JOINTS.index(joint) for joint in state.joints]
    wanted, made = motion.torques[:, columns], forward_torques(motion, state)
    error = made - wanted
    # The torso stands on the lumbar joint, the other segments hang from theirs.
    up = np.array([1.0 if name == "lumbar" else -1.0 for name in state.crossings])
    compression = up * joint_contact_forces(found, state)[..., 2]
    return Result(
        whole=np.linalg.norm(error, axis=1) / np.linalg.norm(wanted, axis=1),
        each=np.max(np.abs(error) / np.abs(wanted).max(axis=0), axis=1),
        missing=infeasible(state, motion),
        outside=outside_dynamics(motion, state),
        peaks=compression.max(axis=0) / (motion.body.mass * GRAVITY),
        residual=np.median(found.residual, axis=0),
    )


def forward_torques(motion: Motion, state: MuscleState) -> Float:
    """Joint torques of a full forward pass with these activations, (T, 13) [N·m]."""
    columns, column = [], 0
    for muscles in muscle_models():
        model, data = muscles.model, mujoco.MjData(muscles.model)
        rates = derivative(motion.joints[:, muscles.columns], motion.fps)
        made = np.empty((len(motion), len(muscles.joints)))
        for frame in range(len(motion)):
            qpos, slopes = muscles.pose(motion.joints[frame, muscles.columns])
            data.qpos[:], data.qvel[:] = qpos, slopes @ rates[frame]
            data.ctrl[:] = data.act[:] = state.activations[frame, column : column + model.nu]
            mujoco.mj_forward(model, data)
            made[frame] = slopes.T @ data.qfrc_actuator
        columns.append(strength(motion) * made)
        column += model.nu
    return np.concatenate(columns, axis=1)


def outside_dynamics(motion: Motion, state: MuscleState) -> int:
    """How many activations are beyond [0, 1], or further from the frame before than excitations of 0 and 1 get them."""
    count, column = 0, 0
    for muscles in muscle_models():
        rise, fall = muscles.model.actuator_dynprm[0, :2]
        limits = activation_limits(1.0 / motion.fps, float(rise), float(fall))
        mine = state.activations[:, column : column + muscles.model.nu]
        lower, upper = limits.bounds(mine[:-1])
        count += int(((mine < 0) | (mine > 1)).sum())
        count += int(((mine[1:] < lower - 1e-9) | (mine[1:] > upper + 1e-9)).sum())
        column += muscles.model.nu
    return count


if __name__ == "__main__":
    sys.exit(main())
