"""Static optimisation of the 80 leg muscles by OpenSim, for `opensim_reference.py`.

Muscle paths of the project are exported as lengths and moment arms: polynomials of the joint angles, fitted to MuJoCo's
values around the poses of the trial (not beyond, since paths are valid within their model's joint ranges). Both sides
then solve the same problem: activation times greatest force, without the force curves (OpenSim's option
`use_muscle_physiology` off), the same cost of torque that muscles do not give, the same ground forces. Ideal actuators
hold the trunk, the arms and the root.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import comb
from pathlib import Path

import numpy as np
import opensim
from numpy.typing import NDArray

from benchmarks.biomechanics.opensim_model import ModelMuscle
from flexmotion.biomechanics.box_least_norm import Cost, box_least_norm
from flexmotion.biomechanics.dynamics import Dynamics
from flexmotion.biomechanics.muscle_geometry import MuscleModel, muscle_models
from flexmotion.biomechanics.opensim_files import external_loads, ground_columns, storage
from flexmotion.biomechanics.static_optimisation import strength
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS

Float = NDArray[np.float64]

ORDER = 4
SAMPLES = 400
MARGIN = 0.1
"""Poses for the fit extend those of the trial by this [rad]."""

WEIGHT = 1.0
"""Cost of torque that muscles do not give, on both sides (see `box_least_norm`)."""

HELD = 1000.0
"""Strength of ideal actuators, so large that their cost is negligible [N, N·m]."""


@dataclass(frozen=True)
class Muscles:
    """Muscles of one leg: its model, their greatest forces [N] and moment arms over the trial, (T, J, M) [m]."""

    model: MuscleModel
    force: Float
    arms: Float


def leg_muscles(motion: Motion) -> tuple[Muscles, ...]:
    """Both legs' muscles in the poses of a motion."""
    found = []
    for muscles in muscle_models()[:2]:
        poses = motion.joints[:, muscles.columns]
        arms = np.stack([muscles.lengths_and_slopes(pose)[1].T for pose in poses])
        assert muscles.hill is not None
        found.append(Muscles(muscles, strength(motion.body) * muscles.hill.force, arms))
    return tuple(found)


def own_activations(motion: Motion, legs: tuple[Muscles, ...]) -> Float:
    """Activations by the project's solver, (T, 80)."""
    assert motion.torques is not None
    found = []
    for leg in legs:
        wanted = motion.torques[:, DOF_COUNT - len(JOINTS) + leg.model.columns]
        lower, upper, multipliers = np.zeros(len(leg.force)), np.ones(len(leg.force)), np.zeros(wanted.shape[1])
        rows = []
        for arms, target in zip(leg.arms, wanted, strict=True):
            row, multipliers = box_least_norm(-arms * leg.force, target, lower, upper, multipliers, Cost(WEIGHT))
            rows.append(row)
        found.append(np.array(rows))
    return np.concatenate(found, axis=1)


def add_actuators(model: opensim.Model, motion: Motion, legs: tuple[Muscles, ...]) -> float:
    """Leg muscles, reserves and ideal actuators for all other coordinates; returns the fit's RMS error in arms [m]."""
    paths = _hold(model, [joint for leg in legs for joint in leg.model.joints])
    errors = []
    for leg in legs:
        poses = sample_poses(motion.joints[:, leg.model.columns])
        sampled = [leg.model.lengths_and_slopes(pose) for pose in poses]
        lengths, arms = (np.stack(items) for items in zip(*sampled, strict=True))
        terms: dict[tuple[int, ...], Float] = {}
        for number, name in enumerate(leg.model.muscles):
            crossed = tuple(map(int, np.flatnonzero(np.abs(arms[:, number]).max(axis=0) > 1e-4)))
            if crossed not in terms:
                terms[crossed] = _terms(poses[:, crossed])
            # OpenSim's moment arms are positive where a pull turns the joint on.
            joints = [paths[leg.model.joints[column]] for column in crossed]
            path, error = _path(terms[crossed], lengths[:, number], -arms[:, number, crossed], joints)
            errors.append(error.ravel())
            actuator = opensim.PathActuator()
            actuator.setName(name)
            actuator.set_path(path)
            actuator.setOptimalForce(float(leg.force[number]))
            actuator.setMinControl(0.0)
            actuator.setMaxControl(1.0)
            model.addForce(actuator)
    model.finalizeConnections()
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))


def add_muscles(model: opensim.Model, muscles: list[ModelMuscle], poses: dict[str, Float]) -> float:
    """Muscles of another model, reserves and ideal actuators; returns the fit's RMS error in arms [m].

    Args:
        model: to add to.
        muscles: with lengths and arms in the sample poses.
        poses: joint -> its angle in the sample poses, (N,).
    """
    paths = _hold(model, list(poses))
    errors = []
    terms: dict[tuple[str, ...], Float] = {}
    for item in muscles:
        if item.joints not in terms:
            terms[item.joints] = _terms(np.column_stack([poses[joint] for joint in item.joints]))
        path, error = _path(terms[item.joints], item.length, item.arms, [paths[joint] for joint in item.joints])
        errors.append(error.ravel())
        item.muscle.set_path(path)
        model.addForce(item.muscle)
    model.finalizeConnections()
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))


def sample_poses(angles: Float, samples: int = SAMPLES) -> Float:
    """Poses to fit polynomials to: random ones around those of a trial (T, J), and the trial's own, (N, J)."""
    generator = np.random.default_rng(0)
    low, high = angles.min(axis=0) - MARGIN, angles.max(axis=0) + MARGIN
    return np.concatenate([generator.uniform(low, high, (samples, angles.shape[1])), angles])


def _hold(model: opensim.Model, moved: list[str]) -> dict[str, str]:
    """Add reserves to joints that muscles move, and ideal actuators to all others; paths of coordinates by name."""
    paths = {}
    for coordinate in model.getCoordinateSet():
        name = coordinate.getName()
        paths[name] = coordinate.getAbsolutePathString()
        actuator = opensim.CoordinateActuator(name)
        actuator.setName(f"hold_{name}")
        actuator.setOptimalForce(WEIGHT**-0.5 if name in moved else HELD)
        actuator.setMinControl(-np.inf)
        actuator.setMaxControl(np.inf)
        model.addForce(actuator)
    return paths


def _path(terms: Float, length: Float, arms: Float, joints: list[str]) -> tuple[opensim.FunctionBasedPath, Float]:
    """Path of polynomials for lengths (N,) and moment arms (N, J), and their errors in moment arms."""
    wanted: Float = np.column_stack([length, arms])
    coefficients, *_ = np.linalg.lstsq(terms, wanted, rcond=None)
    first, *turns = (
        opensim.MultivariatePolynomialFunction(_vector(column), len(joints), ORDER) for column in coefficients.T
    )
    path = opensim.FunctionBasedPath()
    path.setLengthFunction(first)
    for joint, function in zip(joints, turns, strict=True):
        path.appendCoordinatePath(joint)
        path.appendMomentArmFunction(function)
    return path, (terms @ coefficients - wanted)[:, 1:]


def _terms(poses: Float) -> Float:
    """Value of every monomial of OpenSim's polynomial in every pose, (T, K)."""
    count = poses.shape[1]
    function = opensim.MultivariatePolynomialFunction(_vector(np.zeros(comb(count + ORDER, ORDER))), count, ORDER)
    return np.array([function.getTermValues(_vector(pose)).to_numpy() for pose in poses])


def _vector(values: Float) -> opensim.Vector:
    vector = opensim.Vector(len(values), 0.0)
    for index, value in enumerate(values):
        vector.set(index, float(value))
    return vector


def opensim_activations(
    model: opensim.Model,
    coordinates: dict[str, Float],
    found: Dynamics,
    names: list[str],
    folder: Path,
    physiology: bool = False,
) -> tuple[Float, float]:
    """Activations of OpenSim's static optimisation (T, M), and how long it took [s].

    Args:
        model: with actuators.
        coordinates: value of every coordinate over time, (T,) each [m, rad].
        found: ground forces.
        names: of the M muscles.
        folder: for the files that OpenSim's tool works with.
        physiology: whether force curves limit the muscles.
    """
    motion = found.motion
    times = np.arange(len(motion)) / motion.fps
    model.printToXML(str(folder / "human.osim"))
    (folder / "motion.sto").write_bytes(storage("motion", times, coordinates))
    # The exported model has the project's axes and names.
    (folder / "ground.sto").write_bytes(storage("ground", times, ground_columns(found, axes=np.asarray)))
    (folder / "loads.xml").write_bytes(external_loads("ground", "ground.sto", foot="calcaneus"))
    analysis = opensim.StaticOptimization()
    analysis.setStartTime(0.0)
    analysis.setEndTime(float(times[-1]))
    analysis.setUseModelForceSet(True)
    analysis.setUseMusclePhysiology(physiology)
    analysis.setActivationExponent(2.0)
    tool = opensim.AnalyzeTool()
    tool.setName("reference")
    tool.setModelFilename(str(folder / "human.osim"))
    tool.setCoordinatesFileName(str(folder / "motion.sto"))
    tool.setExternalLoadsFileName(str(folder / "loads.xml"))
    tool.setInitialTime(0.0)
    tool.setFinalTime(float(times[-1]))
    tool.setLowpassCutoffFrequency(-1.0)
    tool.setResultsDir(str(folder))
    tool.getAnalysisSet().cloneAndAppend(analysis)
    tool.printToXML(str(folder / "tool.xml"))
    ready = opensim.AnalyzeTool(str(folder / "tool.xml"))
    start = time.perf_counter()
    if not ready.run():
        raise RuntimeError("OpenSim's static optimisation failed")
    seconds = time.perf_counter() - start
    table = opensim.TimeSeriesTable(str(folder / "reference_StaticOptimization_activation.sto"))
    at = np.array(table.getIndependentColumn())
    columns = [np.interp(times, at, table.getDependentColumn(name).to_numpy()) for name in names]
    return np.stack(columns, axis=1), seconds
