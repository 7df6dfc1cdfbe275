"""Static optimisation of the 80 leg muscles by OpenSim, for `opensim_reference.py`.

Muscle paths are exported as lengths and moment arms: polynomials of the joint angles, fitted to MuJoCo's values around
the poses of the trial (not beyond, since paths are valid within their model's joint ranges). Both sides then solve the
same problem: activation times greatest force, without the force curves (OpenSim's option `use_muscle_physiology` off),
the same cost of torque that muscles do not give, the same ground forces. Ideal actuators hold the trunk, the arms and
the root.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import comb
from pathlib import Path

import mujoco
import numpy as np
import opensim
from numpy.typing import NDArray

from flexmotion.biomechanics.box_least_norm import box_least_norm
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
        lengths_and_arms = [_lengths_and_arms(muscles, pose) for pose in motion.joints[:, muscles.columns]]
        arms = np.stack([arms.T for _, arms in lengths_and_arms])
        # A muscle pulls: MuJoCo's greatest force, counted positive.
        found.append(Muscles(muscles, strength(motion) * muscles.model.actuator_gainprm[:, 2], arms))
    return tuple(found)


def _lengths_and_arms(muscles: MuscleModel, angles: Float) -> tuple[Float, Float]:
    """Lengths of muscles (M,) [m] and their derivatives by the joint angles (M, J)."""
    model = muscles.model
    data = mujoco.MjData(model)
    data.qpos[:], slopes = muscles.pose(angles)
    mujoco.mj_fwdPosition(model, data)
    dense = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(
        dense, data.actuator_moment.ravel(), data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    return data.actuator_length.copy(), dense @ slopes


def own_activations(motion: Motion, legs: tuple[Muscles, ...]) -> Float:
    """Activations by the project's solver, (T, 80)."""
    assert motion.torques is not None
    found = []
    for leg in legs:
        wanted = motion.torques[:, DOF_COUNT - len(JOINTS) + leg.model.columns]
        lower, upper, price = np.zeros(len(leg.force)), np.ones(len(leg.force)), np.zeros(wanted.shape[1])
        rows = []
        for arms, target in zip(leg.arms, wanted, strict=True):
            row, price = box_least_norm(-arms * leg.force, target, lower, upper, price, WEIGHT)
            rows.append(row)
        found.append(np.array(rows))
    return np.concatenate(found, axis=1)


def add_actuators(model: opensim.Model, motion: Motion, legs: tuple[Muscles, ...]) -> float:
    """Leg muscles, reserves and ideal actuators for all other coordinates; returns the fit's RMS error in arms [m]."""
    moved = [joint for leg in legs for joint in leg.model.joints]
    paths = {item.getName(): item.getAbsolutePathString() for item in model.getComponentsList()}
    for coordinate in model.getCoordinateSet():
        name = coordinate.getName()
        paths[name] = coordinate.getAbsolutePathString()
        actuator = opensim.CoordinateActuator(name)
        actuator.setName(f"hold_{name}")
        actuator.setOptimalForce(WEIGHT**-0.5 if name in moved else HELD)
        actuator.setMinControl(-np.inf)
        actuator.setMaxControl(np.inf)
        model.addForce(actuator)
    errors = []
    generator = np.random.default_rng(0)
    for leg in legs:
        angles = motion.joints[:, leg.model.columns]
        poses = generator.uniform(angles.min(axis=0) - MARGIN, angles.max(axis=0) + MARGIN, (SAMPLES, angles.shape[1]))
        sampled = [_lengths_and_arms(leg.model, pose) for pose in np.concatenate([poses, angles])]
        poses = np.concatenate([poses, angles])
        lengths, arms = (np.stack(items) for items in zip(*sampled, strict=True))
        terms: dict[tuple[int, ...], Float] = {}
        for number, name in enumerate(leg.model.muscles):
            crossed = tuple(map(int, np.flatnonzero(np.abs(arms[:, number]).max(axis=0) > 1e-4)))
            if crossed not in terms:
                terms[crossed] = _terms(poses[:, crossed])
            # OpenSim's moment arms are positive where a pull turns the joint on.
            wanted: Float = np.column_stack([lengths[:, number], -arms[:, number, crossed]])
            coefficients, *_ = np.linalg.lstsq(terms[crossed], wanted, rcond=None)
            errors.append((terms[crossed] @ coefficients - wanted)[:, 1:].ravel())
            length, *turns = (
                opensim.MultivariatePolynomialFunction(_vector(column), len(crossed), ORDER)
                for column in coefficients.T
            )
            path = opensim.FunctionBasedPath()
            path.setLengthFunction(length)
            for column, function in zip(crossed, turns, strict=True):
                path.appendCoordinatePath(paths[leg.model.joints[column]])
                path.appendMomentArmFunction(function)
            actuator = opensim.PathActuator()
            actuator.setName(name)
            actuator.set_path(path)
            actuator.setOptimalForce(float(leg.force[number]))
            actuator.setMinControl(0.0)
            actuator.setMaxControl(1.0)
            model.addForce(actuator)
    model.finalizeConnections()
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))


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
    model: opensim.Model, coordinates: dict[str, Float], found: Dynamics, legs: tuple[Muscles, ...], folder: Path
) -> tuple[Float, float]:
    """Activations of OpenSim's static optimisation (T, 80), and how long it took [s].

    Args:
        model: with actuators.
        coordinates: value of every coordinate over time, (T,) each [m, rad].
        found: ground forces.
        legs: with the muscles.
        folder: for the files that OpenSim's tool works with.
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
    analysis.setUseMusclePhysiology(False)
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
    names = [name for leg in legs for name in leg.model.muscles]
    at = np.array(table.getIndependentColumn())
    columns = [np.interp(times, at, table.getDependentColumn(name).to_numpy()) for name in names]
    return np.stack(columns, axis=1), seconds
