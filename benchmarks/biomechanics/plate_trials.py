"""The trials with force plates: two walks and a drop jump of three people, from joint centres and total mass alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.biomechanics.gait_trial import PLATE_SHARE as PLATE_SHARE
from benchmarks.biomechanics.gait_trial import Float, GaitTrial, load_trial
from benchmarks.shared.clips import data_folder
from flexmotion.biomechanics.dynamics import Dynamics
from flexmotion.spatial.gravity import GRAVITY

TRIALS = {"treadmill walk": "gait2354_walk", "ground walk": "gait_second_walk", "drop jump": "gait_drop_jump"}
"""Name of a trial and its file among the motion data."""


def load_trials(fps: float) -> dict[str, GaitTrial]:
    """All trials at a frame rate.

    Raises:
        ConfigError: there are no motion data.
    """
    return {name: load_trial(data_folder() / f"{file}.npz", fps) for name, file in TRIALS.items()}


def loaded_feet(trial: GaitTrial) -> NDArray[np.int_]:
    """Number of loaded feet by the plates, (T,)."""
    count: NDArray[np.int_] = (trial.forces[..., 2] > PLATE_SHARE * trial.motion.body.mass * GRAVITY).sum(axis=1)
    return count


def force_difference(trial: GaitTrial, found: Dynamics) -> Float:
    """Computed less measured force on left and right foot, (T, 2, 3) [body weights]."""
    assert found.motion.wrenches is not None
    return (found.motion.wrenches[..., :3] - trial.forces) / (trial.motion.body.mass * GRAVITY)
