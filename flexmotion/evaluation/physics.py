"""Metrics on the consistency of a motion's torques, forces, activations and joint contact with its kinematics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.dynamics import dynamics
from flexmotion.biomechanics.inverse_dynamics import joint_torques
from flexmotion.biomechanics.joint_contact import joint_contact_forces
from flexmotion.biomechanics.segment_motion import segment_motion
from flexmotion.biomechanics.static_optimisation import infeasible, static_optimisation
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import CONTACT_JOINTS, JOINTS
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

COMPRESSION = np.array([1.0 if joint == "lumbar" else -1.0 for joint in CONTACT_JOINTS])
"""Sign of a compressing force along the segment beyond each of `CONTACT_JOINTS`; the torso is above its joint."""

ROUNDING = 1e-3
"""Tolerance of the bounds of activations: rounding to half precision."""


def physics_metrics(motion: Motion, centres: Float) -> dict[str, float]:
    """Differences between a motion's dynamics and its kinematics.

    Keys: `contact_force`, mean distance of the forces from those recomputed from the kinematics [% of body weight];
    `actuation`, mean distance of the torques from inverse dynamics under the motion's own forces [N·m/kg];
    `euler_force`, `euler_moment`, generalised forces of the root [% of body weight, N·m/kg];
    `muscle_limit`, share of muscle-frames outside [0, 1] [%], absent without activations;
    `joint_tension`, share of joint contact forces that pull a joint apart [%], absent without such forces.

    All but the last two exclude `EDGE` frames at each end, where accelerations are extrapolated.

    Args:
        motion: with torques and wrenches, (T,).
        centres: reference points of the wrenches' moments, (T, 2, 3) [m].

    Raises:
        ValueError: the motion has no torques or wrenches, or too few frames.
    """
    if motion.torques is None or motion.wrenches is None:
        raise ValueError("physics metrics need torques and wrenches")
    if len(motion) <= 2 * EDGE:
        raise ValueError(f"physics metrics need more than {2 * EDGE} frames, got {len(motion)}")
    inner = slice(EDGE, -EDGE)
    body, weight = motion.body, motion.body.mass * GRAVITY
    needed = joint_torques(body, segment_motion(motion), motion.wrenches, centres)
    expected = dynamics(motion).motion.wrenches
    assert expected is not None
    missing = motion.torques[inner, -len(JOINTS) :] - needed[inner, -len(JOINTS) :]
    figures = {
        "contact_force": 100 * _mean((motion.wrenches - expected)[inner, :, :3]) / weight,
        "actuation": float(np.abs(missing).mean()) / body.mass,
        "euler_force": 100 * _mean(needed[inner, :3]) / weight,
        "euler_moment": _mean(needed[inner, 3:6]) / body.mass,
    }
    if motion.activations is not None:
        beyond = (motion.activations < -ROUNDING) | (motion.activations > 1 + ROUNDING)
        figures["muscle_limit"] = 100 * float(beyond.mean())
    if motion.joint_contact is not None:
        figures["joint_tension"] = 100 * float((motion.joint_contact[..., 2] * COMPRESSION < 0).mean())
    return figures


def beyond_muscles(motion: Motion) -> float:
    """Share of frames with a torque that muscles cannot produce with activations in [0, 1] [%].

    Raises:
        ConfigError: `myo-sim` is not installed.
        ValueError: the motion has no torques.
    """
    return 100 * float(infeasible(static_optimisation(motion), motion).any(axis=1).mean())


def joint_contact_error(motion: Motion) -> float:
    """Mean distance of joint contact forces from those that the motion's dynamics and muscles need [body weights].

    Excludes `EDGE` frames at each end.

    Raises:
        ConfigError: `myo-sim` is not installed.
        ValueError: the motion has no joint contact forces, or too few frames.
    """
    if motion.joint_contact is None:
        raise ValueError("the motion has no joint contact forces")
    if len(motion) <= 2 * EDGE:
        raise ValueError(f"physics metrics need more than {2 * EDGE} frames, got {len(motion)}")
    found = dynamics(motion)
    expected = joint_contact_forces(found, static_optimisation(found.motion))
    missing = (motion.joint_contact - expected)[EDGE:-EDGE]
    return _mean(missing) / (motion.body.mass * GRAVITY)


def _mean(vectors: Float) -> float:
    return float(np.linalg.norm(vectors, axis=-1).mean())
