"""`encode`: motion to features; causal, the features of a frame depend on it and the two frames before."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import SamplingError
from flexmotion.features.feature_columns import columns_of
from flexmotion.features.feature_loops import Scale, encoded
from flexmotion.features.heading_frame import turned
from flexmotion.features.layout import ACTIVATIONS, JOINT_CONTACT, POINTS, Layout
from flexmotion.human.body import Body
from flexmotion.human.human_model import human_model
from flexmotion.human.kinematics import SIDED_BODIES, HumanKinematics, frame_arrays
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.human.vectors import cross
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.heading import continuous_matrix_heading

Float = NDArray[np.float64]

LEAD = 2
"""Frames before a frame that its features depend on."""

_ANKLES = [POINTS.index(f"ankle_{side}") for side in SIDES]


def encode(motion: Motion, layout: Layout, centres: Float | None = None) -> NDArray[np.float32]:
    """Features of every frame, (T, layout.size), in the units of `Layout`, not normalised.

    Velocities and accelerations are backward differences; motion before the first frame is taken as even. Torques,
    wrenches, joint contact forces, contacts and activations that the motion lacks are zero.

    Args:
        motion: at the layout's frame rate.
        layout: of the features.
        centres: reference points of the moments of `motion.wrenches`, (T, 2, 3) [m]; None for the points below the
            ankles.

    Raises:
        SamplingError: frame rate or number of muscles differ from the layout.
    """
    if abs(motion.fps - layout.fps) > 1e-3 * layout.fps:
        raise SamplingError(f"motion has {motion.fps:g} fps, the layout {layout.fps:g}")
    if motion.activations is not None and layout.muscles not in (0, motion.activations.shape[1]):
        raise SamplingError(f"motion has {motion.activations.shape[1]} muscles, the layout {layout.muscles}")
    features = np.zeros((len(motion), layout.size), np.float32)
    if not len(motion):
        return features
    leg, blocks = motion.body.leg, layout.blocks
    bodies, matrices, sites = frame_arrays(motion, "xpos", "xmat", "site_xpos")
    weight = motion.body.mass * GRAVITY
    points, yaw = encoded(
        bodies,
        sites,
        matrices.reshape(*bodies.shape, 3),
        np.ascontiguousarray(motion.root_position, np.float64),
        np.ascontiguousarray(motion.joints, np.float64),
        *_places(motion.body),
        columns_of(layout),
        # Differences are over the steps of the motion.
        Scale(float(motion.fps), leg, weight, 0.0),
        features,
    )
    if motion.torques is not None:
        features[:, blocks["torques"]] = motion.torques[:, -len(JOINTS) :] / (weight * leg)
    if motion.wrenches is not None:
        features[:, blocks["wrenches"]] = _ankle_wrenches(
            motion.wrenches, centres, points[:, _ANKLES], yaw, weight, leg
        )
    if motion.joint_contact is not None and layout.joint_contact:
        features[:, blocks[JOINT_CONTACT]] = _flat(motion.joint_contact) / weight
    if motion.contacts is not None:
        features[:, blocks["contacts"]] = motion.contacts
    if motion.activations is not None and layout.muscles:
        features[:, blocks[ACTIVATIONS]] = motion.activations
    return features


def encode_loads(loads: Float, motion: Motion) -> NDArray[np.float16]:
    """External forces (T, B, 3) [N], world axes, in the heading frame of their own frame [body weights]."""
    yaw = continuous_matrix_heading(Rotation.from_quat(motion.root_quaternion, scalar_first=True).as_matrix())
    return (turned(loads, -yaw) / (motion.body.mass * GRAVITY)).astype(np.float16)


@lru_cache(maxsize=8)
def _places(body: Body) -> tuple[NDArray[np.int64], int]:
    """Where each of `layout.POINTS` is among the bodies of the model, and the sites after them; and the pelvis."""
    human, found = human_model(body), []
    for name in POINTS:
        point, side = name.rsplit("_", 1)
        if point in SIDED_BODIES:
            found.append(human.body_index[f"{SIDED_BODIES[point]}_{side}"])
        else:
            found.append(human.model.nbody + human.site_index[name])
    return np.array(found, np.int64), human.body_index["pelvis"]


def body_points(human: HumanKinematics) -> Float:
    """The points of `layout.POINTS` in the world, (T, 16, 3) [m]."""
    sides = {"l": 0, "r": 1}
    parts = (name.rsplit("_", 1) for name in POINTS)
    return np.stack([getattr(human, point)[:, sides[side]] for point, side in parts], axis=1)


def _ankle_wrenches(
    wrenches: Float, centres: Float | None, ankles: Float, yaw: Float, weight: float, leg: float
) -> Float:
    """Wrenches with moments about the ankles, where they fade as a foot lifts; about centres of pressure they jump."""
    force, moment = wrenches[..., :3], wrenches[..., 3:]
    if centres is None:
        centres = ankles * [1.0, 1.0, 0.0]
    moment = moment + cross(centres - ankles, force)
    both = np.stack([turned(force, -yaw) / weight, turned(moment, -yaw) / (weight * leg)], axis=2)
    return both.reshape(len(both), -1)


def _flat(vectors: Float) -> Float:
    return vectors.reshape(len(vectors), -1)
