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
        """Of a motion, by forward kinematics.

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
        six_columns = own[:, : PELVIS_SIZE + 6 * len(BALLS)].reshape(frames, -1, 6)
        balls, hinges = matrix(six_columns), own[:, -len(HINGES) :]
        rotation = np.empty((frames, len(tree.parent), 3, 3))
        # At first each segment's turn in its parent; what neither a ball nor a hinge moves is as it is built.
        rotation[:] = tree.turn
        rotation[:, tree.balls] = balls
        rotation[:, tree.hinges] = tree.bent(hinges)
        rotation[:, PELVIS] = yaw_matrix(yaw) @ balls[:, 0]
        for level, above in tree.levels:
            rotation[:, level] = rotation[:, above] @ rotation[:, level]
        steps = np.einsum("tsij,sj->tsi", rotation[:, tree.parent], tree.offset)
        steps[:, PELVIS] = np.concatenate([place, root[:, 3:4]], axis=1) * body.leg
        return cls._from(body, tree.carrying @ steps, rotation, hinges)

    @classmethod
    def _from(cls, body: Body, position: Float, rotation: Float, hinges: Float) -> WindowPose:
        points = body_points(body, position, rotation)
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

    @property
    def path(self) -> Float:
        """Place of the pelvis ahead and left, its height [leg], and heading [rad], (W, 4)."""
        return np.column_stack([self.position[:, PELVIS] / self.body.leg, self.yaw])

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
        found[:, layout.blocks[PATH]] = self.path
        found[:, layout.blocks[PLACES]] = self.points.reshape(frames, -1) / leg
        if rotations:
            tree = _tree(self.body)
            balls = self.rotation[:, tree.parent[tree.balls]].swapaxes(-1, -2) @ self.rotation[:, tree.balls]
            balls[:, 0] = yaw_matrix(-self.yaw) @ self.rotation[:, PELVIS]
            found[:, layout.blocks[ROTATIONS]] = np.concatenate([six(balls).reshape(frames, -1), self.hinges], axis=1)
        return found


def motion_values(motion: Motion, anchor: Anchor, layout: ConstraintLayout, pose: WindowPose | None = None) -> Float:
    """Values of all columns of a `ConstraintLayout` in a window, (W, C); of forces that it lacks zeros.

    Args:
        motion: the window, in the world.
        anchor: the frame before it.
        layout: of the columns.
        pose: of the motion, where it is known.
    """
    found = (WindowPose.of(motion, anchor) if pose is None else pose).values(layout)
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
class _Tree:
    """The B segments of the model.

    Attributes:
        parent: of each segment, (B,).
        offset, turn: of each segment in its parent, as the model is built, (B, 3) [m] and (B, 3, 3).
        carrying: whether a segment (second axis) carries another one or is it, 1 or 0, (B, B); the world carries none.
        levels: segments beyond the pelvis whose parents are of the level before, the first one's the pelvis; and those
            parents.
        balls: segments that the pelvis' own rotation and `joint_groups.BALLS` move, (7,).
        hinges: segments that `joint_groups.HINGES` move, (8,).
        spins: cross products with the unit vectors of those hinges, whose signs count, (8, 3, 3).
    """

    parent: NDArray[np.intp]
    offset: Float
    turn: Float
    carrying: Float
    levels: tuple[tuple[NDArray[np.intp], NDArray[np.intp]], ...]
    balls: NDArray[np.intp]
    hinges: NDArray[np.intp]
    spins: Float

    def bent(self, angles: Float) -> Float:
        """Rotations of the hinges by the formula of Rodrigues, (W, 8) [rad] -> (W, 8, 3, 3)."""
        turns = np.einsum("tk,kij->tkij", np.sin(angles), self.spins)
        found: Float = np.eye(3) + turns + np.einsum("tk,kij->tkij", 1.0 - np.cos(angles), self.spins @ self.spins)
        return found


@lru_cache(maxsize=8)
def _tree(body: Body) -> _Tree:
    """The segments of a human."""
    model = human_model(body).model
    parent = np.array(model.body_parentid, np.intp)
    turn = np.empty((model.nbody, 9))
    for number in range(model.nbody):
        mujoco.mju_quat2Mat(turn[number], model.body_quat[number])
    carrying = np.zeros((model.nbody, model.nbody))
    for number in range(PELVIS, model.nbody):
        carrying[number] = carrying[parent[number]]
        carrying[number, number] = 1.0
    depth = carrying.sum(axis=1)
    levels = [np.flatnonzero(depth == level) for level in range(2, int(depth.max()) + 1)]
    moved = {name: int(model.jnt_bodyid[model.joint(name).id]) for name in (*(ball[0] for ball in BALLS), *HINGES)}
    axes = np.array([np.abs(AXES[hinge[:-2]]) * sign(hinge) for hinge in HINGES])
    return _Tree(
        parent=parent,
        offset=np.array(model.body_pos),
        turn=turn.reshape(-1, 3, 3),
        carrying=carrying,
        levels=tuple((level, parent[level]) for level in levels),
        balls=np.array([PELVIS, *(moved[ball[0]] for ball in BALLS)]),
        hinges=np.array([moved[hinge] for hinge in HINGES]),
        spins=np.cross(axes[:, None], np.eye(3)).swapaxes(-1, -2),
    )


@lru_cache(maxsize=8)
def point_owners(body: Body) -> tuple[int, ...]:
    """Segment to which each of `layout.POINTS` is fixed, as index of the model's bodies."""
    index = human_model(body).body_index
    owners = {**SIDED_BODIES, "heel": "calcaneus", "toe": "toes"}
    return tuple(index[f"{owners.get(name[:-2], name[:-2])}_{name[-1]}"] for name in POINTS)


def body_points(body: Body, position: Float, rotation: Float) -> Float:
    """`layout.POINTS` of segments at their places, (T, B, 3) [m] and (T, B, 3, 3) -> (T, 16, 3) [m]."""
    owners, within = np.array(point_owners(body)), _points(body)
    points, apart = position[:, owners], np.flatnonzero(within.any(axis=1))  # the others are at their segments' origins
    points[:, apart] += np.einsum("tpij,pj->tpi", rotation[:, owners[apart]], within[apart])
    return points


@lru_cache(maxsize=8)
def _points(body: Body) -> Float:
    """Each of `layout.POINTS` in its segment, (16, 3) [m]."""
    human = human_model(body)
    found = np.zeros((len(POINTS), 3))
    for row, name in enumerate(POINTS):
        if name in human.site_index:
            found[row] = human.model.site_pos[human.site_index[name]]
    return found
