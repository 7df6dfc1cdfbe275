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
from flexmotion.retarget.arm_chain import ArmChain, ArmPoses
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
        self._lengths, self._scale = chain.lengths, _WEIGHT / arm[:, None]
        data = mujoco.MjData(model)
        data.qpos[:7], data.qpos[robot.qpos_address] = (0, 0, 0, 1, 0, 0, 0), robot.stand_pose
        mujoco.mj_kinematics(model, data)
        origin, torso = data.xpos[robot.torso_id], data.xmat[robot.torso_id].reshape(3, 3)
        hips = [model.joint(robot.joint_names[robot.chain(f"{side}_leg")["hip_pitch"]]).id for side in SIDE_NAMES]
        self._hips = torso.T @ (data.xanchor[hips].mean(axis=0) - origin)
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
        begin = poses.elbow if poses.elbow is not poses.hand else poses.shoulder
        points = begin[..., None, :] + _SHARES[:, None] * (poses.hand - begin)[..., None, :]
        depth, away = np.zeros(points.shape[:-1]), np.zeros(points.shape)
        # Legs seen from a trunk that leans forward by a pitch: as the points turned by it about the hips.
        to_legs = _pitch(lean)[..., None, :, :]
        by_legs = (points - self._hips) @ to_legs.swapaxes(-1, -2) + self._hips
        for rotation, centre, half, leans in self._boxes:
            local = ((by_legs if leans else points) - centre) @ rotation
            beyond = np.abs(local) - half
            outside = np.maximum(beyond, 0.0)
            distance = np.linalg.norm(outside, axis=-1)
            inside = distance == 0.0
            nearest = (beyond == beyond.max(axis=-1, keepdims=True)).astype(float)
            normal = np.where(inside[..., None], nearest, outside / np.maximum(distance, 1e-9)[..., None])
            found = self._distance - np.where(inside, beyond.max(axis=-1), distance)
            deeper = found > depth
            depth = np.where(deeper, found, depth)
            normal = (normal * np.sign(local)) @ rotation.T
            away = np.where(deeper[..., None], normal @ to_legs if leans else normal, away)
        upper, fore = self._lengths[:, :1, None], self._lengths[:, 1:, None]
        along = (fore * poses.fore_jacobian)[..., None, :]
        moved = (upper * poses.upper_jacobian)[..., None, :] + _SHARES[:, None] * along
        slope = -np.sum(moved * away[..., None, :, :], axis=-1)
        return self._scale * depth, self._scale[..., None] * slope


def _pitch(angle: Float) -> Float:
    """Rotations about y, (...) [rad] -> (..., 3, 3)."""
    out = np.zeros((*angle.shape, 3, 3))
    out[..., 0, 0] = out[..., 2, 2] = np.cos(angle)
    out[..., 0, 2] = np.sin(angle)
    out[..., 2, 0] = -out[..., 0, 2]
    out[..., 1, 1] = 1.0
    return out
