"""`WindowPose`: kinematics and forces of a window in its own frame, as constraints measure them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.features.constraint_layout import (
    CENTRES,
    FORCES,
    PATH,
    PLACES,
    ROTATIONS,
    TORQUE_LIMITS,
    TORQUES,
    ConstraintLayout,
)
from flexmotion.features.decode import Anchor
from flexmotion.features.heading_frame import turned, yaw_matrix
from flexmotion.features.joint_groups import HINGE_COLUMNS, ball_matrices, six
from flexmotion.features.layout import ACTIVATIONS, POINTS
from flexmotion.human.body import Body
from flexmotion.human.human_model import human_model, scratch
from flexmotion.human.kinematics import SIDED_BODIES
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.heading import continuous_matrix_heading

Float = NDArray[np.float64]


@dataclass(frozen=True)
class WindowPose:
    """Segments of a window of W frames in the frame of the window; B bodies of the model, the world first.

    Attributes:
        motion: the window, in the world.
        anchor: the frame before it.
        position, rotation: of the segments, (W, B, 3) [m] and (W, B, 3, 3).
        points: of `layout.POINTS`, (W, 16, 3) [m].
        yaw: heading, (W,) [rad].
    """

    motion: Motion
    anchor: Anchor
    position: Float
    rotation: Float
    points: Float
    yaw: Float

    @classmethod
    def of(cls, motion: Motion, anchor: Anchor) -> WindowPose:
        """By MuJoCo's forward kinematics.

        Args:
            motion: the window.
            anchor: the frame before it.
        """
        human = human_model(motion.body)
        model, data = human.model, scratch(motion.body)
        qpos, frames = human.qpos(motion), len(motion)
        bodies, sites = np.empty((frames, model.nbody, 3)), np.empty((frames, model.nsite, 3))
        matrices = np.empty((frames, model.nbody, 9))
        state, xpos, xmat, site_xpos = data.qpos, data.xpos, data.xmat, data.site_xpos
        for frame in range(frames):
            state[:] = qpos[frame]
            mujoco.mj_kinematics(model, data)
            bodies[frame], matrices[frame], sites[frame] = xpos, xmat, site_xpos
        turn = yaw_matrix(np.array(-anchor.yaw))
        origin = np.append(anchor.place, 0.0)
        rotation = turn @ matrices.reshape(frames, model.nbody, 3, 3)
        position, sites = (bodies - origin) @ turn.T, (sites - origin) @ turn.T
        owners, on_site = point_owners(motion.body), _sites(motion.body)
        points = np.stack(
            [position[:, owner] if site < 0 else sites[:, site] for owner, site in zip(owners, on_site, strict=True)],
            axis=1,
        )
        yaw = continuous_matrix_heading(rotation[:, human.body_index["pelvis"]])
        # Whole turns are counted from the window's own heading, which is 0.
        yaw = yaw - 2 * np.pi * np.round(yaw[0] / (2 * np.pi))
        return cls(motion, anchor, position, rotation, points, yaw)

    def values(self, layout: ConstraintLayout) -> Float:
        """Values of the columns of a `ConstraintLayout`, (W, C); forces that the motion lacks are zero."""
        motion, body = self.motion, self.motion.body
        leg, weight = body.leg, body.mass * GRAVITY
        found = np.zeros((len(motion), layout.size))
        pelvis = self.position[:, 1]
        found[:, layout.blocks[PATH]] = np.column_stack([pelvis / leg, self.yaw])
        tilt = yaw_matrix(-self.yaw) @ self.rotation[:, 1]
        balls = six(ball_matrices(motion.joints)).reshape(len(motion), -1)
        found[:, layout.blocks[ROTATIONS]] = np.concatenate([six(tilt), balls, motion.joints[:, HINGE_COLUMNS]], axis=1)
        found[:, layout.blocks[PLACES]] = self.points.reshape(len(motion), -1) / leg
        if motion.torques is not None:
            torques = motion.torques[:, -len(JOINTS) :] / (weight * leg)
            found[:, layout.blocks[TORQUES]] = found[:, layout.blocks[TORQUE_LIMITS]] = torques
        back = np.full(len(motion), -self.anchor.yaw)
        if motion.wrenches is not None:
            found[:, layout.blocks[FORCES]] = turned(motion.wrenches[..., :3], back).reshape(len(motion), -1) / weight
        if motion.pressure_centres is not None:
            centres = turned(motion.pressure_centres - np.append(self.anchor.place, 0.0), back)[..., :2]
            found[:, layout.blocks[CENTRES]] = centres.reshape(len(motion), -1) / leg
        if motion.activations is not None and layout.layout.muscles:
            found[:, layout.blocks[ACTIVATIONS]] = motion.activations
        return found


@lru_cache(maxsize=8)
def point_owners(body: Body) -> tuple[int, ...]:
    """Segment to which each of `layout.POINTS` is fixed, as index of the model's bodies."""
    index = human_model(body).body_index
    owners = {**SIDED_BODIES, "heel": "calcaneus", "toe": "toes"}
    return tuple(index[f"{owners.get(name[:-2], name[:-2])}_{name[-1]}"] for name in POINTS)


@lru_cache(maxsize=8)
def _sites(body: Body) -> tuple[int, ...]:
    """Site of each point; -1 where it is the origin of its segment."""
    index = human_model(body).site_index
    return tuple(index.get(name, -1) for name in POINTS)
