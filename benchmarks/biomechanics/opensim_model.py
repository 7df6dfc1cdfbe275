"""Muscles of a user's OpenSim model on the project's skeleton, for `opensim_reference.py --model`.

Lengths and moment arms come from the model's own paths, joints and wrapping surfaces; they are sampled over the poses
of the trial, fitted by polynomials, and scaled to the body as `static_optimisation.strength` scales ours. Greatest
force, optimal fibre length, tendon slack length, pennation and force curves are the model's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import opensim
from numpy.typing import NDArray

from flexmotion.biomechanics.muscle_geometry import LEG_COORDINATES, MODEL_HEIGHT, MODEL_MASS
from flexmotion.configs.errors import ConfigError
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES

Float = NDArray[np.float64]

TURNS = 1e-4
"""A muscle crosses a joint if its moment arm exceeds this in any pose [m]."""

ALIASES = {
    "sar": "sart",
    "rect_fem": "recfem",
    "vas_int": "vasint",
    "vas_lat": "vaslat",
    "vas_med": "vasmed",
    "med_gas": "gasmed",
    "lat_gas": "gaslat",
    "tib_ant": "tibant",
    "tib_post": "tibpost",
    "bifemlh": "bflh",
    "bifemsh": "bfsh",
    "peri": "piri",
    "per_brev": "perbrev",
    "per_long": "perlong",
    "add_long": "addlong",
    "add_brev": "addbrev",
    "ext_dig": "edl",
    "ext_hal": "ehl",
    "flex_dig": "fdl",
    "flex_hal": "fhl",
} | {
    f"glut_{theirs}{part}": f"gl{ours}{part}"
    for theirs, ours in (("max", "max"), ("med", "med"), ("min", "min"))
    for part in (1, 2, 3)
}
"""Names of the models gait2354 and gait2392 -> those of the 2016 model, which are the project's."""


@dataclass(frozen=True)
class ModelMuscle:
    """A muscle of a model in the poses of a trial.

    Attributes:
        name: that of the project's muscle, if it has such a one, else the model's.
        muscle: a copy without a path.
        joints: the project's joints that it crosses, J.
        length: of muscle and tendon, (T,) [m].
        arms: moment arms, positive where a pull turns the joint on, (T, J) [m].
    """

    name: str
    muscle: opensim.Muscle
    joints: tuple[str, ...]
    length: Float
    arms: Float


def model_muscles(path: Path, motion: Motion, poses: Callable[[Float], Float]) -> tuple[list[ModelMuscle], Float]:
    """Muscles of both legs, scaled to the body of a motion, and the joint angles of both legs' samples, (2, N, 5).

    Args:
        path: of an `.osim` file.
        motion: the trial.
        poses: makes sample poses (N, 5) from the joint angles of a leg (T, 5).

    Raises:
        ConfigError: the model has not the coordinates of hip, knee and ankle.
    """
    model = opensim.Model(str(path))
    state = model.initSystem()
    found, sampled = [], []
    for side in SIDES:
        joints = [f"{name}_{side}" for name in LEG_COORDINATES]
        coordinates = [_coordinate(model, f"{name}_{side}", path) for name in LEG_COORDINATES.values()]
        angles = poses(motion.joints[:, [JOINTS.index(name) for name in joints]])
        sampled.append(angles)
        found += _sampled(model, state, side, joints, coordinates, angles, motion)
    return found, np.array(sampled)


def _coordinate(model: opensim.Model, name: str, path: Path) -> opensim.Coordinate:
    coordinates = model.getCoordinateSet()
    if not coordinates.contains(name):
        known = ", ".join(item.getName() for item in coordinates)
        raise ConfigError(f"{path}: no coordinate {name}; it has {known}")
    return coordinates.get(name)


def _sampled(
    model: opensim.Model,
    state: opensim.State,
    side: str,
    joints: list[str],
    coordinates: list[opensim.Coordinate],
    angles: Float,
    motion: Motion,
) -> list[ModelMuscle]:
    """Muscles of one side."""
    # Knees flex in the negative direction in some models.
    turned = [item.getName().startswith("knee") and -item.getRangeMin() > item.getRangeMax() for item in coordinates]
    signs = np.where(turned, -1.0, 1.0)
    mine = [item for item in model.getMuscles() if item.getName().endswith(f"_{side}")]
    lengths, arms = np.empty((len(angles), len(mine))), np.empty((len(angles), len(mine), len(joints)))
    for row, pose in enumerate(angles):
        for coordinate, sign, value in zip(coordinates, signs, pose, strict=True):
            limited = np.clip(sign * value, coordinate.getRangeMin(), coordinate.getRangeMax())
            coordinate.setValue(state, float(limited), False)
        model.assemble(state)
        model.realizePosition(state)
        for column, muscle in enumerate(mine):
            lengths[row, column] = muscle.getPath().getLength(state)
            arms[row, column] = [
                sign * muscle.getPath().computeMomentArm(state, item)
                for sign, item in zip(signs, coordinates, strict=True)
            ]
    height = motion.body.height / MODEL_HEIGHT
    found = []
    for column, muscle in enumerate(mine):
        crossed = np.flatnonzero(np.abs(arms[:, column]).max(axis=0) > TURNS)
        if not len(crossed):
            continue
        base = muscle.getName().removesuffix(f"_{side}")
        name = f"{ALIASES.get(base, base)}_{side}"
        found.append(
            ModelMuscle(
                name=name,
                muscle=_scaled(muscle, name, motion.body.mass / MODEL_MASS, height),
                joints=tuple(joints[at] for at in crossed),
                length=height * lengths[:, column],
                arms=height * arms[:, column, crossed],
            )
        )
    return found


def _scaled(muscle: opensim.Muscle, name: str, mass: float, height: float) -> opensim.Muscle:
    """A copy with scaled force and lengths, and a rigid tendon."""
    kind = getattr(opensim, muscle.getConcreteClassName())
    copy = kind.safeDownCast(muscle).clone()
    copy.setName(name)
    copy.set_max_isometric_force(mass * muscle.get_max_isometric_force())
    copy.set_optimal_fiber_length(height * muscle.get_optimal_fiber_length())
    copy.set_tendon_slack_length(height * muscle.get_tendon_slack_length())
    copy.set_ignore_tendon_compliance(True)
    return copy
