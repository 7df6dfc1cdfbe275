"""Fit to joint centres without orientations by damped least squares, all frames at once.

The closed-form fit reaches ankles and wrists exactly, so a nearly straight limb bends wrongly where measured bones
change length (knees glide). Here every point may deviate a little: for each frame

    min  Σ weight |model point - file point|² + damping |pose - closed-form pose|²    within the joints' limits

by Gauss-Newton steps. The second term determines what the points do not (the roll of a straight arm), as smoothly as
the closed-form fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.biomechanics.segment_motion import SegmentMotion, carried, segment_motion
from flexmotion.human.human_model import human_model
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT
from flexmotion.human.vectors import in_frame
from flexmotion.importers.landmarks import Landmarks
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

SEGMENTS = {
    "hip": "femur",
    "knee": "tibia",
    "ankle": "talus",
    "toe": "calcaneus",
    "shoulder": "humerus",
    "elbow": "ulna",
    "wrist": "hand",
    "lumbar": "torso",
    "neck": "head",
    "head": "head",
}
"""Segment of each point; most points are its origin."""

INSIDE = ("toe", "head")
"""Points with an unknown position in their segment: the median of the closed-form fit is used."""

WEIGHTS = {"shoulder": 0.3, "head": 0.3}
"""Weights other than 1: shoulders glide on the torso, and heads nod about several joints."""

DAMPING = 1e-3
"""Squared weight of a radian or metre of the pose relative to a metre of a point."""

STEPS = 3


def refine(motion: Motion, found: Landmarks) -> Motion:
    """A motion of the closed-form fit (`fit`), refined towards the points of its file."""
    human = human_model(motion.body)
    names = [name for name in found.points if _base(name) in SEGMENTS]
    segments = segment_motion(motion)
    index = [human.body_index[_segment(name)] for name in names]
    offsets = np.stack([_offset(name, found, segments, i) for name, i in zip(names, index, strict=True)])
    target = np.stack([found.points[name] for name in names], axis=1)
    weight = np.array([WEIGHTS.get(_base(name), 1.0) for name in names])
    limits = joint_limits()
    lower, upper = limits.T
    moved = np.zeros((len(motion), DOF_COUNT))
    for _ in range(STEPS):
        points = segments.position[:, index] + np.einsum("tpij,pj->tpi", segments.rotation[:, index], offsets)
        jacobian = _jacobian(motion, segments, points, index)
        weighted = jacobian * weight[:, None, None]
        error = target - points
        normal = np.einsum("tpin,tpim->tnm", weighted, jacobian)
        normal[:, np.arange(DOF_COUNT), np.arange(DOF_COUNT)] += DAMPING
        slope = np.einsum("tpin,tpi->tn", weighted, error) - DAMPING * moved
        step = np.linalg.solve(normal, slope[..., None])[..., 0]
        joints = np.clip(motion.joints + step[:, 6:], lower, upper)
        step[:, 6:] = joints - motion.joints
        moved += step
        motion = _moved(motion, step)
        segments = segment_motion(motion)
    return motion


def _base(name: str) -> str:
    return name.removesuffix("_l").removesuffix("_r")


def _segment(name: str) -> str:
    base = _base(name)
    return SEGMENTS[base] + name[len(base) :]


def _offset(name: str, found: Landmarks, segments: SegmentMotion, index: int) -> Float:
    if _base(name) not in INSIDE:
        return np.zeros(3)
    local = in_frame(segments.rotation[:, index], found.points[name] - segments.position[:, index])
    middle: Float = np.median(local, axis=0)
    return middle


def _jacobian(motion: Motion, segments: SegmentMotion, points: Float, index: list[int]) -> Float:
    """Derivative of points by root translation, root rotation about the pelvis' axes and joints, (T, P, 3, 32)."""
    frames, count = points.shape[:2]
    pelvis = human_model(motion.body).body_index["pelvis"]
    jacobian = np.empty((frames, count, 3, DOF_COUNT))
    jacobian[..., :3] = np.eye(3)
    arm = points - segments.position[:, pelvis, None]
    for axis in range(3):
        jacobian[..., 3 + axis] = np.cross(segments.rotation[:, pelvis, None, :, axis], arm)
    arms = points[:, :, None] - segments.anchor[:, None]
    turned = np.cross(segments.axis[:, None], arms) * carried(motion.body)[:, index].T[None, :, :, None]
    jacobian[..., 6:] = turned.swapaxes(-1, -2)
    return jacobian


def _moved(motion: Motion, step: Float) -> Motion:
    turned = Rotation.from_quat(motion.root_quaternion, scalar_first=True) * Rotation.from_rotvec(step[:, 3:6])
    return replace(
        motion,
        root_position=motion.root_position + step[:, :3],
        root_quaternion=continuous_quaternions(turned.as_quat(scalar_first=True)),
        joints=motion.joints + step[:, 6:],
    )
