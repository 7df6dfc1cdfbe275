"""`BodyClearance`: keeps forearms and hands out of the robot's torso and thighs.

A cost on the depth of points of the forearm inside the boxes around collision shapes, grown by the thickness of the
forearm and a margin. The thighs are where they are in the stand pose, turned about the hips as the trunk leans forward.
The rest of the body is kept clear by the limits of single joints.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import packed
from flexmotion.configs.robot import Robot
from flexmotion.retarget import arm_loops
from flexmotion.retarget.arm_chain import ArmChain, ArmPoses
from flexmotion.retarget.legs import SIDE_NAMES

Float = NDArray[np.float64]

_SHARES = (0.3, 0.65, 1.0)
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

    Attributes:
        body: the boxes as the compiled loops take them.
    """

    def __init__(self, robot: Robot, chain: ArmChain) -> None:
        model = robot.model
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        hands = robot.config.hands
        assert hands is not None  # ArmChain has checked it
        fore = np.flatnonzero(solid & (model.geom_bodyid == model.body(hands.left.body).id))
        thickness = float(model.geom_aabb[fore, 3:].min(axis=1).max()) if len(fore) else 0.0
        arm = chain.lengths.sum(axis=1)
        data = mujoco.MjData(model)
        data.qpos[:7], data.qpos[robot.qpos_address] = (0, 0, 0, 1, 0, 0, 0), robot.stand_pose
        mujoco.mj_kinematics(model, data)
        origin, torso = data.xpos[robot.torso_id], data.xmat[robot.torso_id].reshape(3, 3)
        hips = [model.joint(robot.joint_names[robot.chain(f"{side}_leg")["hip_pitch"]]).id for side in SIDE_NAMES]
        self._elbow = chain.has_elbow
        boxes = []
        for body, leans in ((robot.torso_id, False), *((int(model.jnt_bodyid[hip]), True) for hip in hips)):
            for geom in np.flatnonzero(solid & (model.geom_bodyid == body)):
                turned = torso.T @ data.geom_xmat[geom].reshape(3, 3)
                centre = torso.T @ (data.geom_xpos[geom] - origin) + turned @ model.geom_aabb[geom, :3]
                boxes.append((turned, centre, model.geom_aabb[geom, 3:], float(leans)))
        rotations, centres, halves, leaning = zip(*boxes, strict=True) if boxes else [()] * 4
        self.body = packed(
            arm_loops.Body,
            rotation=np.array(rotations, dtype=float).reshape(-1, 3, 3),
            centre=np.array(centres, dtype=float).reshape(-1, 3),
            half=np.array(halves, dtype=float).reshape(-1, 3),
            leans=np.array(leaning, dtype=float),
            hips=torso.T @ (data.xanchor[hips].mean(axis=0) - origin),
            distance=thickness + _MARGIN * float(arm.mean()),
            scale=_WEIGHT / arm,
            shares=np.array(_SHARES),
            lengths=chain.lengths,
        )

    def residual(self, poses: ArmPoses, lean: Float) -> tuple[Float, Float]:
        """Weighted depths of the points, (..., 2, P), and their derivatives by the joints, (..., 2, m, P).

        The shoulder counts as at rest: it moves little, and the derivatives only guide the search.

        Args:
            poses: of the arms, (..., 2, 3); lean: pitch of the trunk forward, (...) [rad].
        """
        batch, begin = poses.hand.shape[:-2], poses.elbow if self._elbow else poses.shoulder
        slopes = np.stack([poses.upper_jacobian, poses.fore_jacobian], axis=-3)
        depth, slope = arm_loops.depths(
            self.body,
            np.ascontiguousarray(begin.reshape(-1, 2, 3)),
            np.ascontiguousarray(poses.hand.reshape(-1, 2, 3)),
            slopes.reshape(-1, *slopes.shape[-4:]),
            np.ascontiguousarray(np.broadcast_to(lean, batch).reshape(-1)),
        )
        return depth.reshape(*batch, *depth.shape[1:]), slope.reshape(*batch, *slope.shape[1:])
