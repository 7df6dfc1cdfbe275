"""The trials with force plates: two walks and a drop jump of three people, from joint centres and total mass alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.biomechanics.gait_trial import MOMENTS, POINTS, TURN, Float, GaitTrial
from benchmarks.shared.clips import data_folder
from flexmotion.biomechanics.dynamics import Dynamics
from flexmotion.importers.fit import fit
from flexmotion.importers.landmarks import Landmarks
from flexmotion.importers.refine import refine
from flexmotion.importers.treadmill import belt_velocity, without_belt
from flexmotion.spatial.gravity import GRAVITY

TRIALS = {"treadmill walk": "gait2354_walk", "ground walk": "gait_second_walk", "drop jump": "gait_drop_jump"}
"""Name of a trial and its file among the motion data."""

LOADED = 0.03
"""Least vertical force of a loaded foot [body weights]."""

SLOWEST_BELT = 0.2
"""Slowest belt [m/s]; below it, feet slide on the ground."""


def load_trials(fps: float) -> dict[str, GaitTrial]:
    """All trials at a frame rate.

    Raises:
        ConfigError: there are no motion data.
    """
    return {name: load_plates(data_folder() / f"{file}.npz", fps) for name, file in TRIALS.items()}


def load_plates(path: Path, fps: float) -> GaitTrial:
    """One trial; frames in which a foot stands beside the plates are not valid."""
    content = np.load(path)
    times, names = content["time_s"], list(content["joint_names"])
    centres = content["joint_centres_m"] @ TURN.T
    if "torso" in names:
        of = {f"{point}_{side}": f"{body}_{side}" for point, body in POINTS.items() for side in "lr"}
        of |= {"lumbar": "torso", "neck": "neck"}
    else:
        of = {name: name for name in names}
    points = {point: centres[:, names.index(name)] for point, name in of.items()}
    found = Landmarks(str(path), float((len(times) - 1) / (times[-1] - times[0])), points)
    belt = belt_velocity(found)
    belt = belt * (np.linalg.norm(belt) > SLOWEST_BELT)
    found = without_belt(found, belt).resampled(fps)
    motion = refine(fit(found).motion, found)
    mass = float(content["mass_kg"])
    motion = replace(motion, body=replace(motion.body, mass=mass))

    at = times[0] + np.arange(len(motion)) / fps
    forces = np.stack(
        [
            np.stack([np.interp(at, times, column) for column in (content[f"grf_{side}"][:, :3] @ TURN.T).T], axis=1)
            for side in ("left", "right")
        ],
        axis=1,
    )
    torques, columns = content["inverse_dynamics"], list(content["inverse_dynamics_names"])
    # Of the reference's two models, the newer one flexes the knee in the positive direction.
    knee = 1.0 if "knee_angle_r_beta_force" in columns else -1.0
    return GaitTrial(
        motion=motion,
        times=at,
        valid=_on_plates(forces, mass) if "valid_window_s" not in content else _within(at, content["valid_window_s"]),
        forces=forces,
        moments={
            f"{joint}_{side}": (knee if name == "knee_angle" else sign)
            * np.interp(at, times, torques[:, columns.index(f"{name}_{side}_moment")])
            for joint, (name, sign) in MOMENTS.items()
            for side in "lr"
        },
        belt=belt,
    )


def loaded_feet(trial: GaitTrial) -> NDArray[np.int_]:
    """Number of loaded feet by the plates, (T,)."""
    count: NDArray[np.int_] = (trial.forces[..., 2] > LOADED * trial.motion.body.mass * GRAVITY).sum(axis=1)
    return count


def force_difference(trial: GaitTrial, found: Dynamics) -> Float:
    """Computed less measured force on left and right foot, (T, 2, 3) [body weights]."""
    assert found.motion.wrenches is not None
    return (found.motion.wrenches[..., :3] - trial.forces) / (trial.motion.body.mass * GRAVITY)


def _within(at: Float, window: Float) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (at >= window[0] - 1e-9) & (at <= window[1] + 1e-9)
    return inside


def _on_plates(forces: Float, mass: float) -> NDArray[np.bool_]:
    """Frames from the first on in which the plates carry the body, or nothing does."""
    total = forces[..., 2].sum(axis=1) / (mass * GRAVITY)
    valid = np.ones(len(forces), bool)
    if total[0] > LOADED:
        valid[: int(np.argmax(total >= 1.0)) + 1] = False
    return valid
