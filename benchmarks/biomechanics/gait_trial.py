"""A gait trial with force plates: joint centres, measured forces and reference moments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.shared.clips import data_folder
from flexmotion.human.motion import Motion
from flexmotion.importers import read
from flexmotion.importers.fit import fit
from flexmotion.importers.landmarks import Landmarks
from flexmotion.importers.refine import refine
from flexmotion.importers.treadmill import belt_velocity, without_belt
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

PLATE_SHARE = 0.03
"""Least measured vertical force of a loaded foot [body weights]."""

# From x forward, y up, z right to x forward, y left, z up.
TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])

POINTS = {"hip": "femur", "knee": "tibia", "ankle": "talus", "toe": "toes", "shoulder": "humerus"}

# Joint of the project -> the reference tool's, and the sign between them.
MOMENTS = {
    "hip_flexion": ("hip_flexion", 1.0),
    "hip_adduction": ("hip_adduction", 1.0),
    "hip_rotation": ("hip_rotation", 1.0),
    "knee_flexion": ("knee_angle", -1.0),
    "ankle_dorsiflexion": ("ankle_angle", 1.0),
}


@dataclass(frozen=True)
class GaitTrial:
    """One trial.

    Attributes:
        motion: fitted to the joint centres alone; the body has the measured mass.
        times: of its frames [s].
        valid: frames in which the reference holds, (T,) bool.
        forces: measured on the left and right foot, (T, 2, 3) [N].
        moments: joint name of the project -> the reference's moment, (T,) [N·m].
        belt: velocity of the treadmill's belt that was removed, (2,) [m/s].
    """

    motion: Motion
    times: Float
    valid: NDArray[np.bool_]
    forces: Float
    moments: dict[str, Float]
    belt: Float


def default_path() -> Path:
    """The example trial among the motion data.

    Raises:
        ConfigError: there are no motion data.
    """
    return data_folder() / "gait2354_walk.npz"


def load_trial(path: Path, fps: float, belt: float | None = None, motion_file: Path | None = None) -> GaitTrial:
    """Read a trial and fit a human to its joint centres, or to a motion file of the same recording.

    Frames in which a foot stands beside the plates are not valid.

    Args:
        path: `.npz` with `time_s`, `joint_names`, `joint_centres_m` (y up), `grf_left`, `grf_right`, `mass_kg`,
            `inverse_dynamics` and their names, and optionally `valid_window_s`.
        fps: frame rate to work at.
        belt: speed of a treadmill's belt, backwards [m/s]; None: detected.
        motion_file: TRC or C3D file with y up, in the axes of the plates; its times are those of the trial.
    """
    content = np.load(path)
    mass = float(content["mass_kg"])
    motion, velocity, start = (
        _of_file(motion_file, fps, belt, mass) if motion_file is not None else _of_centres(path, content, fps, belt)
    )
    motion = replace(motion, body=replace(motion.body, mass=mass))
    return _with_plates(motion, velocity, content, start)


def _of_file(path: Path, fps: float, belt: float | None, mass: float) -> tuple[Motion, Float, float]:
    """Motion of a file in the axes of the trial, velocity of its belt (2,) [m/s], and time of the first frame [s]."""
    found = read(path, fps=fps, mass=mass, belt="detect" if belt is None else belt)
    turn = Rotation.from_euler("z", found.placement.on_floor[0])
    root = turn * Rotation.from_quat(found.motion.root_quaternion, scalar_first=True)
    motion = replace(
        found.motion,
        root_position=turn.apply(found.motion.root_position),
        root_quaternion=continuous_quaternions(root.as_quat(scalar_first=True)),
    )
    return motion, turn.apply([*found.belt, 0.0])[:2], found.placement.start


def _of_centres(
    path: Path, content: Mapping[str, Float], fps: float, belt: float | None
) -> tuple[Motion, Float, float]:
    times, names = content["time_s"], list(content["joint_names"])
    centres = content["joint_centres_m"] @ TURN.T
    if "torso" in names:
        of = {f"{point}_{side}": f"{body}_{side}" for point, body in POINTS.items() for side in "lr"}
        of |= {"lumbar": "torso", "neck": "neck"}
    else:
        of = {name: name for name in names}
    points = {point: centres[:, names.index(name)] for point, name in of.items()}
    found = Landmarks(str(path), float((len(times) - 1) / (times[-1] - times[0])), points)
    velocity = belt_velocity(found) if belt is None else np.array([-belt, 0.0])
    found = without_belt(found, velocity).resampled(fps)
    return refine(fit(found).motion, found), velocity, float(times[0])


def _with_plates(motion: Motion, velocity: Float, content: Mapping[str, Float], start: float) -> GaitTrial:
    times = content["time_s"]
    at = start + np.arange(len(motion)) / motion.fps
    forces = np.stack(
        [_sampled(at, times, content[f"grf_{side}"][:, :3] @ TURN.T) for side in ("left", "right")], axis=1
    )
    torques, columns = content["inverse_dynamics"], list(content["inverse_dynamics_names"])
    # Of the reference's two models, the newer one flexes the knee in the positive direction.
    knee = 1.0 if "knee_angle_r_beta_force" in columns else -1.0
    return GaitTrial(
        motion=motion,
        times=at,
        valid=_within(at, content["valid_window_s"])
        if "valid_window_s" in content
        else _on_plates(forces, motion.body.mass),
        forces=forces,
        moments={
            f"{joint}_{side}": (knee if name == "knee_angle" else sign)
            * np.interp(at, times, torques[:, columns.index(f"{name}_{side}_moment")])
            for joint, (name, sign) in MOMENTS.items()
            for side in "lr"
        },
        belt=velocity,
    )


def _sampled(at: Float, times: Float, signal: Float) -> Float:
    return np.stack([np.interp(at, times, column) for column in signal.T], axis=1)


def _within(at: Float, window: Float) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (at >= window[0] - 1e-9) & (at <= window[1] + 1e-9)
    return inside


def _on_plates(forces: Float, mass: float) -> NDArray[np.bool_]:
    """Frames from the first on in which the plates carry the body, or nothing does."""
    total = forces[..., 2].sum(axis=1) / (mass * GRAVITY)
    valid = np.ones(len(forces), bool)
    if total[0] > PLATE_SHARE:
        valid[: int(np.argmax(total >= 1.0)) + 1] = False
    return valid
