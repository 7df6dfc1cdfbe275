"""Do inverse dynamics and static optimisation agree with OpenSim's on the same skeleton and motion?

Exports the human model as `.osim` (segments, inertia, joints, leg muscles). Inverse dynamics: both sides get the
smoothed motion and the time derivatives of its coordinates, without ground forces. Static optimisation: see
`opensim_muscles.py`; it shows that the solver is right. With `--model` the project's activations are compared with
those that OpenSim finds with the muscles of another model, for the same motion and ground forces: see
`opensim_model.py`. Prints the agreement and the ratios of the times.
"""

from __future__ import annotations

import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import opensim
import typer
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.biomechanics.gait_trial import default_path, load_trial
from benchmarks.biomechanics.opensim_model import model_muscles
from benchmarks.biomechanics.opensim_muscles import (
    add_actuators,
    add_muscles,
    leg_muscles,
    opensim_activations,
    own_activations,
    sample_poses,
)
from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.biomechanics.differentiation import derivative, second_derivative
from flexmotion.biomechanics.dynamics import Dynamics, dynamics
from flexmotion.biomechanics.inverse_dynamics import joint_torques
from flexmotion.biomechanics.muscle_geometry import LEG_COORDINATES, muscle_names
from flexmotion.biomechanics.segment_motion import segment_motion
from flexmotion.biomechanics.static_optimisation import static_optimisation
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS, SIDES
from flexmotion.importers import load
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

ROOT = ("pelvis_rz", "pelvis_ry", "pelvis_rx", "pelvis_tx", "pelvis_ty", "pelvis_tz")
AGREE = 0.01
"""Largest difference, as a share of each joint's largest torque plus 1 N·m."""

ACTIVE = 0.02
"""A muscle whose activation never exceeds this is not active."""

ACTIVE_MODEL = 0.05
"""The same for the muscles of another model, whose small activations are below OpenSim's convergence."""

AGREE_MODEL = 0.8
"""Least median correlation with another model's muscles."""

MODEL_SAMPLES = 200
"""Random poses in which another model's paths are sampled."""

AGREE_ACTIVATION = 0.02
"""Largest root mean square difference of activations."""


def main(
    trial: Annotated[
        Path | None, typer.Argument(metavar="TRIAL", help="`.npz` of a trial; default: that of the motion data.")
    ] = None,
    osim: Annotated[Path | None, typer.Option(help="Write the exported model to this file.")] = None,
    other: Annotated[
        Path | None,
        typer.Option("--model", help="`.osim` with muscles, such as Rajagopal2016.osim: compare with its muscles too."),
    ] = None,
) -> Outcome:
    """Compute the dynamics of a trial with both tools and compare."""
    opensim.Logger.setLevelString("Error")
    found = dynamics(_motion(trial or default_path()))
    motion = found.motion
    model = export(motion)
    start = time.perf_counter()
    own = joint_torques(
        motion.body, segment_motion(motion), np.zeros((len(motion), 2, 6)), np.zeros((len(motion), 2, 3))
    )[:, DOF_COUNT - len(JOINTS) :]
    own_time = time.perf_counter() - start
    start = time.perf_counter()
    reference = opensim_torques(model, motion)
    reference_time = time.perf_counter() - start

    inner = slice(4, -4)
    error = np.sqrt(np.mean((own - reference)[inner] ** 2, axis=0))
    largest = np.abs(reference[inner]).max(axis=0)
    for name, difference, peak in zip(JOINTS, error, largest, strict=True):
        print(f"  {name:24s} RMS difference {difference:8.4f} N·m, peak {peak:8.2f} N·m")
    print(f"{len(motion)} frames: own {1e3 * own_time:.1f} ms, OpenSim {1e3 * reference_time:.1f} ms,")
    print(f"ratio {reference_time / own_time:.1f} (OpenSim through its Python binding, model already built)")
    worst = float((error / (largest + 1.0)).max())
    muscles, figures = compare_muscles(model, found, osim)
    torques = Verdict(f"torques: difference {worst:.4f} of the largest (<= {AGREE})", worst <= AGREE)
    inverse = {"rms_nm_most": float(error.max()), "time_ratio": reference_time / own_time}
    verdicts, kept = [torques, muscles], {"inverse_dynamics": inverse, "static_optimisation": figures}
    if other:
        more, kept["model"] = compare_model(other, found)
        verdicts += more
    return Outcome(verdicts, kept)


def _motion(path: Path) -> Motion:
    """Motion of a gait trial (`.npz`), or of any file that the importers read."""
    if path.suffix == ".npz" and "joint_centres_m" in np.load(path):
        return load_trial(path, 60.0).motion
    return load(path)


def compare_muscles(model: opensim.Model, found: Dynamics, osim: Path | None) -> tuple[Verdict, dict[str, float]]:
    """Print the agreement of both static optimisations and their times; return verdict and figures."""
    motion = found.motion
    legs = leg_muscles(motion)
    fit_error = add_actuators(model, motion, legs)
    if osim:
        model.printToXML(str(osim))
    start = time.perf_counter()
    own = own_activations(motion, legs)
    own_time = time.perf_counter() - start
    with tempfile.TemporaryDirectory() as folder:
        values = dict(zip((*ROOT, *JOINTS), coordinate_values(motion).T, strict=True))
        names = [name for leg in legs for name in leg.model.muscles]
        reference, reference_time = opensim_activations(model, values, found, names, Path(folder))
    inner = slice(4, -4)
    error = float(np.sqrt(np.mean((own - reference)[inner] ** 2)))
    active = reference[inner].max(axis=0) > ACTIVE
    likeness = [np.corrcoef(own[inner, i], reference[inner, i])[0, 1] for i in np.flatnonzero(active)]
    print(f"static optimisation, {own.shape[1]} leg muscles: RMS difference of activation {error:.4f},")
    print(
        f"median correlation {np.median(likeness):.4f} over {active.sum()} active ones (moment arms fitted to", end=" "
    )
    print(f"{1e3 * fit_error:.2f} mm); {len(motion)} frames: own {1e3 * own_time:.0f} ms, OpenSim", end=" ")
    print(f"{reference_time:.1f} s, ratio {reference_time / own_time:.0f}")
    figures = {"rms": error, "correlation": float(np.median(likeness)), "time_ratio": reference_time / own_time}
    return Verdict(
        f"activations: RMS difference {error:.4f} (<= {AGREE_ACTIVATION})", error <= AGREE_ACTIVATION
    ), figures


def compare_model(path: Path, found: Dynamics) -> tuple[list[Verdict], dict[str, Any]]:
    """Print the project's activations beside OpenSim's of another model's muscles; return verdicts and figures."""
    motion = found.motion
    muscles, sampled = model_muscles(path, motion, partial(sample_poses, samples=MODEL_SAMPLES))
    human = export(motion)
    poses = {
        f"{joint}_{side}": angles[:, column]
        for side, angles in zip(SIDES, sampled, strict=True)
        for column, joint in enumerate(LEG_COORDINATES)
    }
    fit_error = add_muscles(human, muscles, poses)
    start = time.perf_counter()
    own = static_optimisation(motion).activations
    own_time = time.perf_counter() - start
    names = [item.name for item in muscles]
    with tempfile.TemporaryDirectory() as folder:
        values = dict(zip((*ROOT, *JOINTS), coordinate_values(motion).T, strict=True))
        reference, reference_time = opensim_activations(human, values, found, names, Path(folder), physiology=True)
    inner = slice(4, -4)
    known = muscle_names()
    likeness, ours, theirs = [], {}, {}
    for column, name in enumerate(names):
        if name not in known or reference[inner, column].max() <= ACTIVE_MODEL:
            continue
        pair = own[inner, known.index(name)], reference[inner, column]
        ours[name], theirs[name] = (float(item.max()) for item in pair)
        likeness.append(float(np.corrcoef(*pair)[0, 1]) if pair[0].std() > 0 else 0.0)
        print(f"  {name:14s} r {likeness[-1]:5.2f}, peak {ours[name]:.2f}, OpenSim {theirs[name]:.2f}")
    median = float(np.median(likeness))
    print(f"{path.name}: median r {median:.3f} over {len(likeness)} active muscles (arms fitted to", end=" ")
    print(f"{1e3 * fit_error:.2f} mm); own {own_time:.2f} s with paths and trunk, OpenSim {reference_time:.1f} s")
    figures = {
        "median_r": median,
        "muscles": len(likeness),
        "peaks": ours,
        "peaks_opensim": theirs,
        "time_ratio": reference_time / own_time,
    }
    return [Verdict(f"activations, median r {median:.3f} (>= {AGREE_MODEL})", median >= AGREE_MODEL)], figures


def export(motion: Motion) -> opensim.Model:
    """Segments, inertia and joints of the human model as an OpenSim model; z up, so gravity is along -z."""
    human = human_model(motion.body).model
    model = opensim.Model()
    model.setName("flexmotion_human")
    model.setGravity(opensim.Vec3(0, 0, -GRAVITY))
    bodies = {0: model.getGround()}
    for index in range(1, human.nbody):
        inertia = opensim.Inertia(*(float(v) for v in np.maximum(human.body_inertia[index], 1e-9)))
        mass, com = float(max(human.body_mass[index], 1e-9)), _vector(human.body_ipos[index])
        body = opensim.Body(human.body(index).name, mass, com, inertia)
        model.addBody(body)
        bodies[index] = body
    for index in range(1, human.nbody):
        body, parent = bodies[index], bodies[int(human.body_parentid[index])]
        zero = opensim.Vec3(0, 0, 0)
        place = zero if index == 1 else _vector(human.body_pos[index])
        turn = zero
        if index > 1:
            turn = _vector(Rotation.from_quat(human.body_quat[index], scalar_first=True).as_euler("XYZ"))
        spatial = opensim.SpatialTransform()
        if index == 1:
            for axis, (name, direction) in enumerate(zip(ROOT, np.vstack([np.eye(3)[::-1], np.eye(3)]), strict=True)):
                _drive(spatial, axis, name, direction)
        else:
            first, count = int(human.body_jntadr[index]), int(human.body_jntnum[index])
            axes = [human.jnt_axis[first + number] for number in range(count)]
            for axis in range(count):
                _drive(spatial, axis, human.joint(first + axis).name, axes[axis])
            for axis in range(count, 3):
                spare = next(e for e in np.eye(3) if np.linalg.matrix_rank(np.array([*axes, e])) == len(axes) + 1)
                axes.append(spare)
                spatial.updTransformAxis(axis).setAxis(_vector(spare))
                spatial.updTransformAxis(axis).set_function(opensim.Constant(0.0))
            for axis in range(3, 6):
                spatial.updTransformAxis(axis).set_function(opensim.Constant(0.0))
        name = f"{human.body(index).name}_joint"
        if index > 1 and not human.body_jntnum[index]:
            model.addJoint(opensim.WeldJoint(name, parent, place, turn, body, zero, zero))
        else:
            model.addJoint(opensim.CustomJoint(name, parent, place, turn, body, zero, zero, spatial))
    model.finalizeConnections()
    return model


def _drive(spatial: opensim.SpatialTransform, axis: int, name: str, direction: Float) -> None:
    names = opensim.ArrayStr()
    names.append(name)
    transform = spatial.updTransformAxis(axis)
    transform.setCoordinateNames(names)
    transform.setAxis(_vector(direction))
    transform.set_function(opensim.LinearFunction(1.0, 0.0))


def _vector(values: Float) -> opensim.Vec3:
    return opensim.Vec3(*(float(value) for value in values))


def coordinate_values(motion: Motion) -> Float:
    """Values of the coordinates `ROOT`, then `JOINTS`, (T, 32)."""
    euler = Rotation.from_quat(motion.root_quaternion, scalar_first=True).as_euler("ZYX")
    return np.concatenate([np.unwrap(euler, axis=0), motion.root_position, motion.joints], axis=1)


def opensim_torques(model: opensim.Model, motion: Motion) -> Float:
    """Generalised forces of the joints in the order of `JOINTS`, (T, 26)."""
    state = model.initSystem()
    values = coordinate_values(motion)
    rates, accelerations = derivative(values, motion.fps), second_derivative(values, motion.fps)
    coordinates = [model.getCoordinateSet().get(name) for name in (*ROOT, *JOINTS)]
    # Index of a coordinate among the system's speeds: where the state changes when it alone is set.
    place = []
    for coordinate in coordinates:
        before = state.getU().to_numpy().copy()
        coordinate.setSpeedValue(state, 1.0)
        place.append(int(np.argmax(np.abs(state.getU().to_numpy() - before))))
        coordinate.setSpeedValue(state, 0.0)
    solver = opensim.InverseDynamicsSolver(model)
    torques = np.empty((len(motion), len(JOINTS)))
    for frame in range(len(motion)):
        for coordinate, value, rate in zip(coordinates, values[frame], rates[frame], strict=True):
            coordinate.setValue(state, float(value), False)
            coordinate.setSpeedValue(state, float(rate))
        acceleration = opensim.Vector(len(place), 0.0)
        for at, value in zip(place, accelerations[frame], strict=True):
            acceleration.set(at, float(value))
        found = solver.solve(state, acceleration).to_numpy()
        torques[frame] = found[place[len(ROOT) :]]
    return torques
