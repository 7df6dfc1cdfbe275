"""`torque_change`, `force_change`: how torques and ground forces of a balanced window change with its latent.

A joint's torque is what the masses beyond it need, less what the ground gives them (`biomechanics.inverse_dynamics`).
For a leg that stands it is also what all other masses need, less what the ground gives to the other foot, whose force
is smaller. Both are differentiated, each part of the body as one mass at its centre c, of share μ of the body, in units
of body weight and leg length,

    τ = axis · ((c - p) x f - (o - p) x g),    f = μ (c̈ / gravity + z)

for the joint's place p, the ground's force g at o and the axis as they are, weighted by the leg's share of the load.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.segment_motion import carried
from flexmotion.features.heading_frame import yaw_matrix
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.sampling.window_change import WindowChange
from flexmotion.sampling.window_pose import WindowPose
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

BALANCED = 0.5
"""Share of the level acceleration of the root that balance takes away again. Limits of a knee over 14 held-out clips
were kept in 97.1 % of the frames with it, 96.0 with none of it, 93.8 with all (without correction 86.4)."""


def torque_change(change: WindowChange, pose: WindowPose, motion: Motion, yaw: float, joint: int) -> Float32:
    """Derivatives of a joint's torque, (W, L) [weight x leg].

    Args:
        change: of the window's motion.
        pose: of the window as it is handed on.
        motion: the same, with its ground forces.
        yaw: heading of the frame of the window in the world [rad].
        joint: number in `skeleton.JOINTS`.
    """
    body = pose.body
    model = human_model(body).model
    beyond = carried(body)[joint] > 0
    feet = [bool(beyond[human_model(body).body_index[f"calcaneus_{side}"]]) for side in SIDES]
    place, axis = pose.anchor[:, joint], pose.axis[:, joint]
    moved = change.at_segment(int(model.jnt_bodyid[model.joint(JOINTS[joint]).id]), place)
    if not any(feet):
        return _needed(change, pose, beyond, place, axis, moved, np.zeros((len(place), 3)))
    assert motion.wrenches is not None
    forces = motion.wrenches[..., :3] / (body.mass * GRAVITY)
    own = feet.index(True)
    load = np.maximum(forces[..., 2], 0.0)
    share = (load[:, own] / np.maximum(load.sum(axis=1), 1e-6))[:, None].astype(np.float32)
    ground = forces @ yaw_matrix(np.array(yaw))
    direct = _needed(change, pose, beyond, place, axis, moved, ground[:, own])
    others = np.arange(model.nbody) > 0
    around = _needed(change, pose, others & ~beyond, place, axis, moved, ground[:, 1 - own])
    found: Float32 = (1.0 - share) * direct - share * around
    return found


def force_change(change: WindowChange, pose: WindowPose, motion: Motion) -> Float32:
    """Derivatives of the ground forces on left and right foot, (W, 2, 3, L) [weight].

    What the motion needs as a whole, by its centre of mass, shared between the feet by their load.

    Args:
        change, pose, motion: see `torque_change`.
    """
    assert motion.wrenches is not None
    centre = change.centre(np.arange(human_model(pose.body).model.nbody) > 0)
    centre[:, :2] -= BALANCED * change.path[:, :2]
    whole = change.fps**2 * pose.body.leg / GRAVITY * _curvature(centre)
    load = np.maximum(motion.wrenches[..., 2], 0.0)
    share = (load / np.maximum(load.sum(axis=1, keepdims=True), 1e-6)).astype(np.float32)
    found: Float32 = (share[:, :, None, None] * whole[:, None]).astype(np.float32)
    return found


def _needed(
    change: WindowChange,
    pose: WindowPose,
    segments: NDArray[np.bool_],
    place: Float,
    axis: Float,
    moved: Float32,
    ground: Float,
) -> Float32:
    """Derivatives of the moment about a joint that some segments need, less that of a ground force, (W, L)."""
    body = pose.body
    mass = human_model(body).model.body_mass * segments
    share, leg = mass.sum() / human_model(body).model.body_mass.sum(), body.leg
    centre = np.einsum("b,tbi->ti", mass / mass.sum(), pose.centres) / leg
    rate = change.fps**2 * leg / GRAVITY
    force = share * (rate * _curvature(centre, begun=False) + [0.0, 0.0, 1.0])
    lever = centre - place / leg
    shifted = change.centre(segments)
    # axis · (a x b) with one of both fixed is linear in the other.
    by_shift, by_force = np.cross(force, axis), np.cross(axis, lever)
    by_place = np.cross(ground - force, axis)
    accelerated = shifted.copy()
    accelerated[:, :2] -= BALANCED * change.path[:, :2]
    by_acceleration = share * rate * _along(by_force, _curvature(accelerated))
    return _along(by_shift, shifted) + by_acceleration + _along(by_place, moved)


def _along(weights: Float, vectors: Float32) -> Float32:
    found: Float32 = (weights[:, None].astype(np.float32) @ vectors)[:, 0]
    return found


def _curvature(signal: NDArray, begun: bool = True) -> NDArray:
    """Second differences over frames; `begun`: zero before the first frame, else even there, (W, ...)."""
    ahead = np.zeros_like(signal[:2]) if begun else signal[:1] + np.arange(-2, 0)[:, None] * (signal[1] - signal[0])
    whole = np.concatenate([ahead[1:], signal, 2 * signal[-1:] - signal[-2:-1]])
    found: NDArray = np.diff(whole, n=2, axis=0)
    return found
