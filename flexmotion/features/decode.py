"""`decode`: features to motion, starting from the last frame before them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.heading_frame import turned, yaw_matrix
from flexmotion.features.joint_groups import (
    BALL_COLUMNS,
    BALLS,
    HINGE_COLUMNS,
    PELVIS_SIZE,
    ball_angles,
    matrix,
)
from flexmotion.features.layout import ACTIVATIONS, JOINT_CONTACT, POINTS, Layout
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import CONTACT_JOINTS, DOF_COUNT, JOINTS, SIDES
from flexmotion.human.vectors import cross
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.heading import heading
from flexmotion.spatial.quaternions import continuous_quaternions
from flexmotion.spatial.rotations import matrix_quaternions

Float = NDArray[np.float64]

FIRM = 0.05
"""Least share of body weight on a foot that has a centre of pressure."""


@dataclass(frozen=True)
class Anchor:
    """The frame before the first decoded one.

    Attributes:
        place: of the pelvis on the floor, (2,) [m].
        yaw: heading of the pelvis [rad].
        joints: (26,) [rad]; selects between sets of angles of the same pose.
    """

    place: Float
    yaw: float
    joints: Float

    @classmethod
    def after(cls, motion: Motion) -> Anchor:
        """The last frame of a motion."""
        last = motion[len(motion) - 1 :]
        return cls(last.root_position[0, :2], float(heading(last.root_quaternion)[0]), last.joints[0])

    def local(self, places: Float) -> Float:
        """Places of the world, (..., 3) [m], in the frame of the window that follows."""
        found: Float = (places - np.append(self.place, 0.0)) @ yaw_matrix(np.array(self.yaw))
        return found

    @classmethod
    def origin(cls) -> Anchor:
        """At the world's origin, facing x, upright."""
        return cls(np.zeros(2), 0.0, np.zeros(len(JOINTS)))


def decode(features: NDArray, layout: Layout, body: Body, anchor: Anchor, source: str = "") -> Motion:
    """Motion of T frames from features that are not normalised, (T, layout.size).

    Root path, rotations, torques, wrenches, joint contact forces, contacts and activations come from their blocks.
    Generalised forces of the root are zero. Moments of the wrenches are about the centre of pressure of a foot that
    carries load, else about the point below the ankle.
    """
    values = np.asarray(features, np.float64)
    blocks, leg, frames = layout.blocks, body.leg, len(values)
    rotations = values[:, blocks["rotations"]]
    position, yaw = root_path(values, layout, body, anchor)
    below = position * [1.0, 1.0, 0.0]

    parts = matrix(rotations[:, : PELVIS_SIZE + 6 * len(BALLS)].reshape(frames, 1 + len(BALLS), 6))
    turn = yaw_matrix(yaw) @ parts[:, 0]
    joints = np.empty((frames, len(JOINTS)))
    joints[:, BALL_COLUMNS] = ball_angles(parts[:, 1:], anchor.joints[BALL_COLUMNS])
    joints[:, HINGE_COLUMNS] = rotations[:, PELVIS_SIZE + 6 * len(BALLS) :]

    weight = body.mass * GRAVITY
    force, moment, height = _ankle_wrenches(values, layout, yaw, weight, leg)
    levers = _levers(force, moment, height, weight)
    torques = np.zeros((frames, DOF_COUNT))
    torques[:, -len(JOINTS) :] = values[:, blocks["torques"]] * (weight * leg)
    return Motion(
        fps=layout.fps,
        root_position=position,
        root_quaternion=continuous_quaternions(matrix_quaternions(turn)),
        joints=joints,
        body=body,
        torques=torques,
        wrenches=np.concatenate([force, moment - cross(levers, force)], axis=-1),
        pressure_centres=turned(_ankles(values, layout), yaw) * leg + below[:, None] + levers,
        contacts=values[:, blocks["contacts"]] > 0.5,
        activations=values[:, blocks[ACTIVATIONS]].clip(0.0, 1.0) if layout.muscles else None,
        joint_contact=_joint_contact(values, layout, weight),
        source=source,
    )


def root_path(features: NDArray, layout: Layout, body: Body, anchor: Anchor) -> tuple[Float, Float]:
    """Positions of the root, (T, 3) [m], and headings, (T,) [rad], from features that are not normalised."""
    root = np.asarray(features[:, layout.blocks["root"]], np.float64)
    yaw = anchor.yaw + np.cumsum(root[:, 2]) / layout.fps
    before = np.concatenate([[anchor.yaw], yaw[:-1]])
    flat = np.concatenate([root[:, :2], np.zeros((len(root), 1))], axis=1)
    travel = turned(flat, before)[:, :2] * body.leg / layout.fps
    return np.concatenate([anchor.place + np.cumsum(travel, axis=0), root[:, 3:4] * body.leg], axis=1), yaw


def _joint_contact(values: Float, layout: Layout, weight: float) -> Float | None:
    """Contact forces, (T, 7, 3) [N]; None where the layout has none."""
    if not layout.joint_contact:
        return None
    return values[:, layout.blocks[JOINT_CONTACT]].reshape(len(values), len(CONTACT_JOINTS), 3) * weight


def _ankle_wrenches(values: Float, layout: Layout, yaw: Float, weight: float, leg: float) -> tuple[Float, Float, Float]:
    """Forces and moments about the ankles, world axes, (T, 2, 3) each, and heights of the ankles, (T, 2)."""
    parts = values[:, layout.blocks["wrenches"]].reshape(len(values), 2, 2, 3)
    force, moment = turned(parts[:, :, 0], yaw) * weight, turned(parts[:, :, 1], yaw) * (weight * leg)
    return force, moment, _ankles(values, layout)[..., 2] * leg


def _ankles(values: Float, layout: Layout) -> Float:
    """Ankle positions in the heading frame, (T, 2, 3) [leg]."""
    places = values[:, layout.blocks["positions"]].reshape(len(values), len(POINTS), 3)
    return places[:, [POINTS.index(f"ankle_{side}") for side in SIDES]]


def _levers(force: Float, moment: Float, height: Float, weight: float) -> Float:
    """Centres of pressure relative to the ankles: floor points about which the moment has no horizontal part."""
    firm = force[..., 2] > FIRM * weight
    load = np.where(firm, force[..., 2], 1.0)
    x = np.where(firm, (-moment[..., 1] - height * force[..., 0]) / load, 0.0)
    y = np.where(firm, (moment[..., 0] - height * force[..., 1]) / load, 0.0)
    return np.stack([x, y, -height], axis=-1)
