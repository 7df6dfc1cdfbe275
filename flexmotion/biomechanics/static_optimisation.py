"""Static optimisation: the muscle activations that produce the joint torques with the least effort.

For every frame    min Σ a²    subject to    torque = R (gain a + bias),    fall(a⁻) <= a <= rise(a⁻)

with moment arms R, gain and bias of MuJoCo's muscles at this length and speed, and the activation a⁻ of the frame
before. Torque that the muscles cannot produce is penalised and reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.activation import activation_limits
from flexmotion.biomechanics.box_least_norm import box_least_norm
from flexmotion.biomechanics.differentiation import derivative
from flexmotion.biomechanics.muscle_geometry import (
    MODEL_HEIGHT,
    MODEL_MASS,
    MuscleModel,
    muscle_models,
)
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS

Float = NDArray[np.float64]

FEASIBLE = 0.02
"""Greatest error of the torque at a joint in a feasible frame, relative to the joint's greatest torque in the clip."""


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


def strength(motion: Motion) -> float:
    """Muscle torques of a human relative to those of the models: in proportion to mass and height."""
    return motion.body.mass * motion.body.height / (MODEL_MASS * MODEL_HEIGHT)


def static_optimisation(motion: Motion) -> MuscleState:
    """Muscle activations for the torques of a motion.

    Raises:
        ConfigError: `myo-sim` is not installed.
        ValueError: the motion has no torques.
    """
    if motion.torques is None:
        raise ValueError("static optimisation needs torques: run `dynamics` first")
    scale = strength(motion)
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
    model, data = muscles.model, mujoco.MjData(muscles.model)
    angles = motion.joints[:, muscles.columns]
    rates = derivative(np.unwrap(angles, axis=0), motion.fps)
    frames, count, joints = len(motion), model.nu, len(muscles.joints)
    slides = muscles.slides.ravel()
    active, passive = np.empty((frames, joints, count)), np.empty((frames, joints))
    pull_active, pull_passive = np.empty((frames, len(slides), count)), np.empty((frames, len(slides)))
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
        arms = dense @ slopes
        data.actuator_velocity[:] = arms @ rates[frame]
        data.act[:] = 0.0
        mujoco.mj_fwdActuation(model, data)
        bias = data.actuator_force.copy()
        data.act[:] = 1.0
        mujoco.mj_fwdActuation(model, data)
        gain = data.actuator_force - bias
        active[frame], passive[frame] = arms.T * gain, arms.T @ bias
        crossing = dense[:, slides].T
        pull_active[frame], pull_passive[frame] = crossing * gain, crossing @ bias
    return _Actuation(active, passive, pull_active, pull_passive)


def _solve(muscles: MuscleModel, actuation: _Actuation, wanted: Float, fps: float) -> tuple[Float, Float]:
    """Activations (T, M), and the missing part of the required moments (T, J) [N·m of the model]."""
    rise, fall = muscles.model.actuator_dynprm[0, :2]
    limits = activation_limits(1.0 / fps, float(rise), float(fall))
    frames, count = len(wanted), muscles.model.nu
    activations, missing = np.empty((frames, count)), np.empty(wanted.shape)
    lower, upper = np.zeros(count), np.ones(count)
    price = np.zeros(len(muscles.joints))
    for frame in range(frames):
        target = wanted[frame] - actuation.passive[frame]
        activations[frame], price = box_least_norm(actuation.active[frame], target, lower, upper, price)
        missing[frame] = target - actuation.active[frame] @ activations[frame]
        lower, upper = limits.bounds(activations[frame])
    return activations, missing
