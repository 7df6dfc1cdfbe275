"""`BodyClearance`: keeps forearms and hands out of the robot's torso and thighs.

A cost on the depth of points of the forearm inside the boxes around collision shapes, grown by the thickness of the
forearm and a margin. The thighs are where they are in the stand pose, turned about the hips as the trunk leans forward.
The rest of the body is kept clear by the limits of single joints.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.retarget.arm_chain import ArmChain, ArmPoses, coordinates_first, coordinates_last
from flexmotion.retarget.legs import SIDE_NAMES

Float = NDArray[np.float64]

_SHARES = np.array([0.3, 0.65, 1.0])
"""Points along the forearm, as shares of its length from the elbow."""
_MARGIN = 0.08
"""Distance kept from the torso, over arm length: half of it is left to directions and to late joints."""
_WEIGHT = 40.0
"""Cost of a depth, in chords of directions over depths in arm lengths."""


class BodyClearance:
    """Depth of the forearms in torso and thighs of one robot.

    Args:
        robot: the robot file; what has no collision shape is not kept clear of.
        chain: its arms.
    """

    def __init__(self, robot: Robot, chain: ArmChain) -> None:
        model = robot.model
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        hands = robot.config.hands
        assert hands is not None  # ArmChain has checked it
        fore = np.flatnonzero(solid & (model.geom_bodyid == model.body(hands.left.body).id))
        thickness = float(model.geom_aabb[fore, 3:].min(axis=1).max()) if len(fore) else 0.0
        arm = chain.lengths.sum(axis=1)
        self._lengths, self._scale = chain.lengths, _WEIGHT / arm
        data = mujoco.MjData(model)
        data.qpos[:7], data.qpos[robot.qpos_address] = (0, 0, 0, 1, 0, 0, 0), robot.stand_pose
        mujoco.mj_kinematics(model, data)
        origin, torso = data.xpos[robot.torso_id], data.xmat[robot.torso_id].reshape(3, 3)
        hips = [model.joint(robot.joint_names[robot.chain(f"{side}_leg")["hip_pitch"]]).id for side in SIDE_NAMES]
        self._hips = torso.T @ (data.xanchor[hips].mean(axis=0) - origin)
        self._elbow = chain.has_elbow
        self._boxes = []
        for body, leans in ((robot.torso_id, False), *((int(model.jnt_bodyid[hip]), True) for hip in hips)):
            for geom in np.flatnonzero(solid & (model.geom_bodyid == body)):
                turned = torso.T @ data.geom_xmat[geom].reshape(3, 3)
                centre = torso.T @ (data.geom_xpos[geom] - origin) + turned @ model.geom_aabb[geom, :3]
                self._boxes.append((turned, centre, model.geom_aabb[geom, 3:], leans))
        self._distance = thickness + _MARGIN * float(arm.mean())

    def residual(self, poses: ArmPoses, lean: Float) -> tuple[Float, Float]:
        """Weighted depths of the points, (..., 2, P), and their derivatives by the joints, (..., 2, m, P).

        The shoulder counts as at rest: it moves little, and the derivatives only guide the search.

        Args:
            poses: of the arms, (..., 2, 3); lean: pitch of the trunk forward, (...) [rad].
        """
        depth, away = self._deepest(poses, lean)
        slope = np.zeros((poses.upper_jacobian.shape[-2], *depth.shape))
        if depth.any():
            upper, fore = (
                array.transpose(-1, -2, *range(array.ndim - 2)) for array in (poses.upper_jacobian, poses.fore_jacobian)
            )
            shares = _SHARES.reshape(-1, *[1] * (depth.ndim - 1))
            slope -= self._lengths[:, 0] * np.einsum("xm...,xp...->mp...", upper, away)
            slope -= shares * self._lengths[:, 1] * np.einsum("xm...,xp...->mp...", fore, away)
        return coordinates_last(depth), slope.transpose(*range(2, slope.ndim), 0, 1)

    def depth(self, poses: ArmPoses, lean: Float) -> Float:
        """The depths of `residual` alone, (..., 2, P)."""
        return coordinates_last(self._deepest(poses, lean)[0])

    def _deepest(self, poses: ArmPoses, lean: Float) -> tuple[Float, Float]:
        """Weighted depths of the points, (P, ..., 2), and the ways out of the body that lessen them, (3, P, ..., 2)."""
        begin = coordinates_first(poses.elbow if self._elbow else poses.shoulder)
        shares = _SHARES.reshape(-1, *[1] * (begin.ndim - 1))
        # Coordinates first, (3, P, ..., 2), for as few and as long operations as possible.
        points = begin[:, None] + shares * (coordinates_first(poses.hand) - begin)[:, None]
        shape = points.shape[1:]
        points = points.reshape(3, -1)
        # Legs seen from a trunk that leans forward by a pitch: as the points turned by it about the hips.
        pitch = np.broadcast_to(lean[..., None], shape).reshape(-1)
        by_legs = _pitched(points - self._hips[:, None], pitch) + self._hips[:, None]
        depth, away = np.zeros(points.shape[1]), np.zeros(points.shape)
        for rotation, centre, half, leans in self._boxes:
            local = rotation.T @ ((by_legs if leans else points) - centre[:, None])
            beyond = np.abs(local) - half[:, None]
            farthest = beyond.max(axis=0)
            # Most points are far from the body: the rest is for those in the grown box.
            near = np.flatnonzero(farthest < self._distance)
            if not len(near):
                continue
            found, normal = self._depths(beyond[:, near], farthest[near])
            deeper = found > depth[near]
            near = near[deeper]
            depth[near] = found[deeper]
            normal = rotation @ (normal[:, deeper] * np.sign(local[:, near]))
            away[:, near] = _pitched(normal, -pitch[near]) if leans else normal
        return self._scale * depth.reshape(shape), self._scale * away.reshape(3, *shape)

    def _depths(self, beyond: Float, farthest: Float) -> tuple[Float, Float]:
        """Depths of points in a box that is grown by the distance, (N,) [m], and normals without their signs, (3, N).

        Args:
            beyond: distance of each point from the box's faces, (3, N) [m]; farthest: the greatest of each point, (N,).
        """
        outside = np.maximum(beyond, 0.0)
        distance = np.sqrt((outside * outside).sum(axis=0))
        inside = distance == 0.0
        normal = np.where(inside, (beyond == farthest).astype(float), outside / np.maximum(distance, 1e-9))
        return self._distance - np.where(inside, farthest, distance), normal


def _pitched(points: Float, angle: Float) -> Float:
    """Points (3, N), each turned about y by its angle (N,) [rad]."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = points
    return np.stack([cos * x + sin * z, y, cos * z - sin * x])
