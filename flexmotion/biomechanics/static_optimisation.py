"""Static optimisation: the muscle activations that produce the joint torques with the least effort.

For every frame    min Σ a² + w Σ c²    subject to    torque = R (gain a + bias),    fall(a⁻) <= a <= rise(a⁻)

with moment arms R, active force per activation (gain) and passive force (bias) of the muscles at this length and speed,
the activation a⁻ of the frame before, and the compression c of hip and knee by the leg's muscles [body weights]. High
activations of leg muscles cost more. Torque that the muscles cannot produce is penalised and reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.activation import activation_limits
from flexmotion.biomechanics.box_least_norm import Cost, box_least_norm
from flexmotion.biomechanics.differentiation import derivative
from flexmotion.biomechanics.muscle_geometry import (
    MODEL_HEIGHT,
    MODEL_MASS,
    UP,
    MuscleModel,
    muscle_models,
)
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

FEASIBLE = 0.02
"""Greatest error of the torque at a joint in a feasible frame, relative to the joint's greatest torque in the clip."""

ERROR_COST = 10.0
"""Cost of torque that muscles do not give, relative to squared activation [1/(N·m)²]."""

COMPRESSION_COST = 0.1
"""Cost w of squared compression, relative to squared activation [1/(body weight)²]; effect: docs/decisions.md."""

SUSTAINED, STEEPNESS = 0.8, 30.0
"""Activation from which a leg muscle costs more, and cost of the squared part above it, relative to squared activation.

Load passes to other muscles before one is saturated.
"""

RELIEVED = ("hip", "knee")
"""Joints whose compression has a cost."""


@dataclass(frozen=True)
class MuscleState:
    """Activations and forces of muscles over a clip.

    Attributes:
        activations: of all muscles in the order of `muscle_names`, (T, 290).
        missing: torque of `joints` that muscles cannot produce, (T, 13) [N·m].
        joints: the joints with muscles.
        muscle_pull: force of the muscles on the segment beyond each crossing, along that crossing's slides (about the
            segment's forward, upward and rightward axes), (T, 7, 3) [N].
        crossings: names of those joints.
    """

    activations: Float
    missing: Float
    joints: tuple[str, ...]
    muscle_pull: Float
    crossings: tuple[str, ...]


@dataclass(frozen=True)
class _Actuation:
    """One model over a clip: moments per activation, passive moments, and the same for the forces at crossings."""

    active: Float
    passive: Float
    pull_active: Float
    pull_passive: Float


def strength(body: Body) -> float:
    """Muscle torques of a human relative to those of the models: in proportion to mass and height."""
    return body.mass * body.height / (MODEL_MASS * MODEL_HEIGHT)


def static_optimisation(motion: Motion) -> MuscleState:
    """Muscle activations for the torques of a motion.

    Raises:
        ConfigError: `myo-sim` is not installed.
        ValueError: the motion has no torques.
    """
    if motion.torques is None:
        raise ValueError("static optimisation needs torques: run `dynamics` first")
    scale = strength(motion.body)
    activations, missing, pulls = [], [], []
    for muscles in muscle_models():
        wanted = motion.torques[:, DOF_COUNT - len(JOINTS) + muscles.columns] / scale
        actuation = _actuation(muscles, motion)
        found, left = _solve(muscles, actuation, wanted, motion.fps)
        activations.append(found)
        missing.append(scale * left)
        pull = np.einsum("tcm,tm->tc", actuation.pull_active, found) + actuation.pull_passive
        # Forces scale with mass; moment arms scale with height.
        pulls.append(pull.reshape(len(motion), -1, 3) * motion.body.mass / MODEL_MASS)
    models = muscle_models()
    return MuscleState(
        activations=np.concatenate(activations, axis=1),
        missing=np.concatenate(missing, axis=1),
        joints=tuple(joint for model in models for joint in model.joints),
        muscle_pull=np.concatenate(pulls, axis=1),
        crossings=tuple(joint for model in models for joint in model.crossings),
    )


def infeasible(state: MuscleState, motion: Motion) -> NDArray[np.bool_]:
    """Whether muscles cannot produce a joint's torque, (T, 13)."""
    assert motion.torques is not None
    columns = [DOF_COUNT - len(JOINTS) + JOINTS.index(joint) for joint in state.joints]
    largest = np.abs(motion.torques[:, columns]).max(axis=0)
    # Errors below 1 N·m are always accepted.
    return np.abs(state.missing) > np.maximum(FEASIBLE * largest, 1.0)


def muscle_moments(muscles: MuscleModel, motion: Motion) -> tuple[Float, Float]:
    """Moments per activation (T, J, M), and passive moments (T, J), of a model's muscles [N·m of the model].

    For J joints of `muscles.joints` and M muscles; multiplied by `strength` they are those of the human.
    """
    found = _actuation(muscles, motion)
    return found.active, found.passive


def _actuation(muscles: MuscleModel, motion: Motion) -> _Actuation:
    """Moments and forces at crossings of a model's muscles over a clip."""
    model, data = muscles.model, mujoco.MjData(muscles.model)
    angles = motion.joints[:, muscles.columns]
    rates = derivative(np.unwrap(angles, axis=0), motion.fps)
    frames, count, slides = len(motion), model.nu, muscles.slides.ravel()
    arms, crossing = np.empty((frames, count, len(muscles.joints))), np.empty((frames, count, len(slides)))
    length, active, passive = (np.zeros((frames, count)) for _ in range(3))
    dense = np.zeros((count, model.nv))
    for frame in range(frames):
        qpos, slopes = muscles.pose(angles[frame])
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        mujoco.mj_transmission(model, data)
        mujoco.mju_sparse2dense(
            dense, data.actuator_moment.ravel(), data.moment_rownnz, data.moment_rowadr, data.moment_colind
        )
        arms[frame], crossing[frame], length[frame] = dense @ slopes, dense[:, slides], data.actuator_length
        if muscles.hill is None:
            data.actuator_velocity[:] = arms[frame] @ rates[frame]
            data.act[:] = 0.0
            mujoco.mj_fwdActuation(model, data)
            passive[frame] = -data.actuator_force
            data.act[:] = 1.0
            mujoco.mj_fwdActuation(model, data)
            active[frame] = -data.actuator_force - passive[frame]
    if muscles.hill is not None:
        active = muscles.hill.tension(length, np.einsum("tmj,tj->tm", arms, rates))
    # Tension shortens the path.
    return _Actuation(
        active=-np.swapaxes(arms * active[..., None], 1, 2),
        passive=-np.einsum("tmj,tm->tj", arms, passive),
        pull_active=-np.swapaxes(crossing * active[..., None], 1, 2),
        pull_passive=-np.einsum("tmc,tm->tc", crossing, passive),
    )


def _solve(muscles: MuscleModel, actuation: _Actuation, wanted: Float, fps: float) -> tuple[Float, Float]:
    """Activations (T, M), and the missing part of the required moments (T, J) [N·m of the model]."""
    limits = activation_limits(1.0 / fps, *muscles.time_constants)
    frames, count, joints = len(wanted), muscles.model.nu, len(muscles.joints)
    activations, missing = np.empty((frames, count)), np.empty(wanted.shape)
    lower, upper = np.zeros(count), np.ones(count)
    # A cost of squared compression is an equation with target 0 and a weight of its own.
    rows = [UP + 3 * at for at, name in enumerate(muscles.crossings) if name.partition("_")[0] in RELIEVED]
    weight = np.sqrt(COMPRESSION_COST / ERROR_COST) / (MODEL_MASS * GRAVITY)
    matrices = np.concatenate([actuation.active, weight * actuation.pull_active[:, rows]], axis=1)
    targets = np.concatenate([wanted - actuation.passive, np.zeros((frames, len(rows)))], axis=1)
    cost = Cost(ERROR_COST, SUSTAINED, STEEPNESS if muscles.hill is not None else 0.0)
    multipliers = np.zeros(joints + len(rows))
    for frame, (matrix, target) in enumerate(zip(matrices, targets, strict=True)):
        found, multipliers = box_least_norm(matrix, target, lower, upper, multipliers, cost)
        activations[frame], missing[frame] = found, (target - matrix @ found)[:joints]
        lower, upper = limits.bounds(found)
    return activations, missing
