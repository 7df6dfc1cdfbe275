"""`WindowPose`: kinematics and forces of a window in its own frame, as constraints measure them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.segment_motion import hinge_index
from flexmotion.features.constraint_layout import (
    CENTRES,
    FORCES,
    PATH,
    PLACES,
    ROTATIONS,
    TORQUE_LIMITS,
    TORQUES,
    ConstraintLayout,
    window_path,
)
from flexmotion.features.decode import Anchor
from flexmotion.features.heading_frame import turned, yaw_matrix
from flexmotion.features.joint_groups import BALLS, HINGE_COLUMNS, HINGES, PELVIS_SIZE, matrix, sign, six
from flexmotion.features.layout import ACTIVATIONS, POINTS, Layout
from flexmotion.human.body import Body
from flexmotion.human.human_model import AXES, human_model
from flexmotion.human.kinematics import SIDED_BODIES, frame_arrays
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.heading import continuous_matrix_heading

Float = NDArray[np.float64]

PELVIS = 1
"""The pelvis among the bodies of a human's model."""

FEET = [POINTS.index(f"{end}_{side}") for side in SIDES for end in ("heel", "toe")]
"""Heel and toe of both feet among `layout.POINTS`."""


@dataclass(frozen=True)
class WindowPose:
    """Segments of a window of W frames in the frame of the window; B bodies of the model, the world first.

    Attributes:
        body: of the human.
        position, rotation: of the segments, (W, B, 3) [m] and (W, B, 3, 3).
        points: of `layout.POINTS`, (W, 16, 3) [m].
        hinges: angles of `joint_groups.HINGES`, (W, 8) [rad].
        yaw: heading, (W,) [rad].
        anchor, axis: of the joints of `skeleton.JOINTS`, (W, 26, 3) [m] and unit vectors; a sketch has none.
    """

    body: Body
    position: Float
    rotation: Float
    points: Float
    hinges: Float
    yaw: Float
    anchor: Float = field(default_factory=lambda: np.zeros((0, len(JOINTS), 3)))
    axis: Float = field(default_factory=lambda: np.zeros((0, len(JOINTS), 3)))

    @classmethod
    def of(cls, motion: Motion, anchor: Anchor) -> WindowPose:
        """Of a motion, by MuJoCo's forward kinematics.

        Args:
            motion: the window, in the world.
            anchor: the frame before it.
        """
        bodies, matrices, centres, axes = frame_arrays(motion, "xpos", "xmat", "xanchor", "xaxis")
        turn = yaw_matrix(np.array(-anchor.yaw))
        rotation = turn @ matrices.reshape(*bodies.shape, 3)
        found = cls._from(motion.body, anchor.local(bodies), rotation, motion.joints[:, HINGE_COLUMNS])
        joints = hinge_index(motion.body)
        return replace(found, anchor=anchor.local(centres[:, joints]), axis=axes[:, joints] @ turn.T)

    @classmethod
    def of_features(cls, features: NDArray[np.float32], layout: Layout, body: Body) -> WindowPose:
        """Of features as decoded, before feet are planted; all frames at once, which is faster than motion by motion.

        Args:
            features: of the window, not normalised, (W, layout.size).
            layout: of the features.
            body: of the human.
        """
        values = features.astype(np.float64)
        tree, frames = _tree(body), len(values)
        root, own = values[:, layout.blocks["root"]], values[:, layout.blocks["rotations"]]
        place, yaw = window_path(root, layout.fps, np)
        position, rotation = np.zeros((frames, len(tree), 3)), np.empty((frames, len(tree), 3, 3))
        rotation[:, 0] = np.eye(3)
        six_columns = own[:, : PELVIS_SIZE + 6 * len(BALLS)].reshape(frames, -1, 6)
        balls, hinges = matrix(six_columns), own[:, -len(HINGES) :]
        position[:, PELVIS] = np.concatenate([place, root[:, 3:4]], axis=1) * body.leg
        rotation[:, PELVIS] = yaw_matrix(yaw) @ balls[:, 0]
        for number, segment in enumerate(tree[PELVIS + 1 :], PELVIS + 1):
            above = rotation[:, segment.parent]
            position[:, number] = position[:, segment.parent] + above @ segment.offset
            if segment.ball is not None:
                rotation[:, number] = above @ balls[:, segment.ball]
            elif segment.hinge is not None:
                rotation[:, number] = above @ _about(segment.axis, hinges[:, segment.hinge])
            else:
                rotation[:, number] = above @ segment.turn
        return cls._from(body, position, rotation, hinges)

    @classmethod
    def _from(cls, body: Body, position: Float, rotation: Float, hinges: Float) -> WindowPose:
        owners = list(point_owners(body))
        points = position[:, owners] + (rotation[:, owners] @ _points(body)[..., None])[..., 0]
        yaw = continuous_matrix_heading(rotation[:, PELVIS])
        # Whole turns are counted from the window's own heading, which is 0.
        yaw = yaw - 2 * np.pi * np.round(yaw[0] / (2 * np.pi))
        return cls(body, position, rotation, points, hinges, yaw)

    @property
    def feet(self) -> Float:
        """Heel and toe of left and right foot, (W, 2, 2, 3) [m]."""
        return self.points[:, FEET].reshape(len(self.points), 2, 2, 3)

    @property
    def centres(self) -> Float:
        """Centres of mass of the segments, (W, B, 3) [m]."""
        within = human_model(self.body).model.body_ipos
        return self.position + np.einsum("tbij,bj->tbi", self.rotation, within)

    def moved(self, shift: Float) -> WindowPose:
        """The same, moved by (W, 3) [m]."""
        return replace(self, position=self.position + shift[:, None], points=self.points + shift[:, None])

    def values(self, layout: ConstraintLayout, rotations: bool = True) -> Float:
        """Values of the columns of a `ConstraintLayout` that kinematics tell, (W, C); the others are zero.

        Args:
            layout: of the columns.
            rotations: whether those of the block `rotations` are made, which take longest.
        """
        leg, frames = self.body.leg, len(self.yaw)
        found = np.zeros((frames, layout.size))
        found[:, layout.blocks[PATH]] = np.column_stack([self.position[:, PELVIS] / leg, self.yaw])
        found[:, layout.blocks[PLACES]] = self.points.reshape(frames, -1) / leg
        if rotations:
            tree = _tree(self.body)
            moved = [(one.ball, row) for row, one in enumerate(tree) if one.ball is not None]
            numbers = [row for _, row in sorted(moved)]
            parents = [tree[number].parent for number in numbers]
            balls = self.rotation[:, parents].swapaxes(-1, -2) @ self.rotation[:, numbers]
            balls[:, 0] = yaw_matrix(-self.yaw) @ self.rotation[:, PELVIS]
            found[:, layout.blocks[ROTATIONS]] = np.concatenate([six(balls).reshape(frames, -1), self.hinges], axis=1)
        return found


def motion_values(motion: Motion, anchor: Anchor, layout: ConstraintLayout) -> Float:
    """Values of all columns of a `ConstraintLayout` in a window, (W, C); of forces that it lacks zeros.

    Args:
        motion: the window, in the world.
        anchor: the frame before it.
        layout: of the columns.
    """
    found = WindowPose.of(motion, anchor).values(layout)
    leg, weight = motion.body.leg, motion.body.mass * GRAVITY
    if motion.torques is not None:
        torques = motion.torques[:, -len(JOINTS) :] / (weight * leg)
        found[:, layout.blocks[TORQUES]] = found[:, layout.blocks[TORQUE_LIMITS]] = torques
    if motion.wrenches is not None:
        back = np.full(len(motion), -anchor.yaw)
        found[:, layout.blocks[FORCES]] = turned(motion.wrenches[..., :3], back).reshape(len(motion), -1) / weight
    if motion.pressure_centres is not None:
        centres = anchor.local(motion.pressure_centres)[..., :2]
        found[:, layout.blocks[CENTRES]] = centres.reshape(len(motion), -1) / leg
    if motion.activations is not None and layout.layout.muscles:
        found[:, layout.blocks[ACTIVATIONS]] = motion.activations
    return found


@dataclass(frozen=True)
class _Segment:
    """A segment of the model: its parent, place and turn in it, and number of the ball or hinge that moves it."""

    parent: int
    offset: Float
    turn: Float
    ball: int | None
    hinge: int | None
    axis: Float


@lru_cache(maxsize=8)
def _tree(body: Body) -> tuple[_Segment, ...]:
    """Segments in the order of the model, parents before children; the pelvis is moved by ball 0."""
    model = human_model(body).model
    balls = {int(model.jnt_bodyid[model.joint(ball[0]).id]): number + 1 for number, ball in enumerate(BALLS)}
    hinges = {int(model.jnt_bodyid[model.joint(name).id]): number for number, name in enumerate(HINGES)}
    found = []
    for number in range(model.nbody):
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.body_quat[number])
        hinge = hinges.get(number)
        axis = np.zeros(3) if hinge is None else np.abs(AXES[HINGES[hinge][:-2]]) * sign(HINGES[hinge])
        ball = 0 if number == PELVIS else balls.get(number)
        parent = int(model.body_parentid[number])
        found.append(_Segment(parent, model.body_pos[number].copy(), turn.reshape(3, 3), ball, hinge, axis))
    return tuple(found)


def _about(axis: Float, angle: Float) -> Float:
    """Rotations about a coordinate axis, whose sign counts, (W,) [rad] -> (W, 3, 3)."""
    found = np.zeros((len(angle), 3, 3))
    along = int(np.abs(axis).argmax())
    first, second = (along + 1) % 3, (along + 2) % 3
    cosine, sine = np.cos(angle), np.sin(angle) * axis[along]
    found[:, along, along] = 1.0
    found[:, first, first] = found[:, second, second] = cosine
    found[:, first, second], found[:, second, first] = -sine, sine
    return found


@lru_cache(maxsize=8)
def point_owners(body: Body) -> tuple[int, ...]:
    """Segment to which each of `layout.POINTS` is fixed, as index of the model's bodies."""
    index = human_model(body).body_index
    owners = {**SIDED_BODIES, "heel": "calcaneus", "toe": "toes"}
    return tuple(index[f"{owners.get(name[:-2], name[:-2])}_{name[-1]}"] for name in POINTS)


@lru_cache(maxsize=8)
def _points(body: Body) -> Float:
    """Each of `layout.POINTS` in its segment, (16, 3) [m]."""
    human = human_model(body)
    found = np.zeros((len(POINTS), 3))
    for row, name in enumerate(POINTS):
        if name in human.site_index:
            found[row] = human.model.site_pos[human.site_index[name]]
    return found
