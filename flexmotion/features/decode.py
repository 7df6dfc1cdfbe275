"""`decode`: features to motion, starting from the last frame before them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.features import feature_loops
from flexmotion.features.feature_columns import columns_of
from flexmotion.features.feature_loops import Scale, Start
from flexmotion.features.heading_frame import yaw_matrix
from flexmotion.features.joint_groups import BALL_COLUMNS
from flexmotion.features.layout import ACTIVATIONS, JOINT_CONTACT, Layout
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import CONTACT_JOINTS, DOF_COUNT, JOINTS
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.heading import heading

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
    values = np.ascontiguousarray(features, np.float64)
    blocks, weight, frames = layout.blocks, body.mass * GRAVITY, len(values)
    position, quaternion, joints, wrenches, centres = feature_loops.decoded(
        values, columns_of(layout), _start(anchor), Scale(float(layout.fps), body.leg, weight, FIRM)
    )
    torques = np.zeros((frames, DOF_COUNT))
    torques[:, -len(JOINTS) :] = values[:, blocks["torques"]] * (weight * body.leg)
    return Motion(
        fps=layout.fps,
        root_position=position,
        root_quaternion=quaternion,
        joints=joints,
        body=body,
        torques=torques,
        wrenches=wrenches,
        pressure_centres=centres,
        contacts=values[:, blocks["contacts"]] > 0.5,
        activations=np.minimum(np.maximum(values[:, blocks[ACTIVATIONS]], 0.0), 1.0) if layout.muscles else None,
        joint_contact=_joint_contact(values, layout, weight),
        source=source,
    )


def root_path(features: NDArray, layout: Layout, body: Body, anchor: Anchor) -> tuple[Float, Float]:
    """Positions of the root, (T, 3) [m], and headings, (T,) [rad], from features that are not normalised."""
    root = np.ascontiguousarray(features[:, layout.blocks["root"]], np.float64)
    return feature_loops.root_path(root, _start(anchor), Scale(float(layout.fps), body.leg, body.mass * GRAVITY, FIRM))


def _start(anchor: Anchor) -> Start:
    place = np.ascontiguousarray(anchor.place, np.float64)
    return Start(place, float(anchor.yaw), np.asarray(anchor.joints, np.float64)[BALL_COLUMNS])


def _joint_contact(values: Float, layout: Layout, weight: float) -> Float | None:
    """Contact forces, (T, 7, 3) [N]; None where the layout has none."""
    if not layout.joint_contact:
        return None
    return values[:, layout.blocks[JOINT_CONTACT]].reshape(len(values), len(CONTACT_JOINTS), 3) * weight
