"""`ArmChain`: both arms of a robot as chains of hinges, with their kinematics for many poses at once.

Forward kinematics are the product of exponentials (Brockett 1984; Lynch and Park, Modern Robotics, 4.1): axes and
anchors of the joints in the model's reference pose say all that is needed, for any number and order of joints. For all
poses in one compiled call (`arm_loops`), since a call into MuJoCo per pose costs more than the arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import packed
from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot
from flexmotion.retarget import arm_loops
from flexmotion.retarget.legs import SIDE_NAMES

Float = NDArray[np.float64]

_SHORTEST_SEGMENT = 0.2
"""A joint divides an arm into upper arm and forearm if both are longer than this share of the arm."""
_SHOULDER_SHARE = 0.6
"""The last joint before the elbow that is at least this share of the farthest one away from it is the shoulder."""
_ALONG = 0.7
"""Cosine between a joint's axis and a segment from which on the axis runs along it."""


@dataclass(frozen=True)
class ArmPoses:
    """Segments of both arms for a batch of poses, in the torso frame; sides left, right.

    Attributes:
        upper, fore: unit vectors from shoulder to elbow and from elbow to hand, (..., 2, 3). Those of an arm without
            elbow are both from shoulder to hand.
        shoulder, elbow, hand: positions, (..., 2, 3) [m].
        upper_jacobian, fore_jacobian: derivatives of the unit vectors by the joints of their arm, (..., 2, m, 3)
            [1/rad].
        hand_jacobian: derivatives of the hands, (..., 2, m, 3) [m/rad].
    """

    upper: Float
    fore: Float
    shoulder: Float
    elbow: Float
    hand: Float
    upper_jacobian: Float
    fore_jacobian: Float
    hand_jacobian: Float


class ArmChain:
    """Both arms of one robot; joints that are in neither stay as in the stand pose.

    Attributes:
        joints: columns of the arm joints in the robot's order, from torso to hand, (2, m).
        lower, upper: limits, (2, m) [rad].
        has_elbow: whether a joint divides the arm into upper arm and forearm.
        arms: the chains as the compiled loops take them.
        fore_joint: place in the chain of the joint that moves the forearm: elbow, or shoulder without one.
        lengths: of upper arm and forearm a side, (2, 2) [m]; without elbow half of the arm each.

    Raises:
        RetargetError: the robot file has no hands, arms of different numbers of joints, or an arm joint that does not
            move its hand.
    """

    def __init__(self, robot: Robot) -> None:
        chains = {f"{side}_arm": robot.chain(f"{side}_arm") for side in SIDE_NAMES}
        arms, hands = [list(chain.values()) for chain in chains.values()], robot.config.hands
        if hands is None:
            raise RetargetError(f"{robot.file}: field hands: missing, expected body and point of left and right hand")
        if len(arms[0]) != len(arms[1]):
            left, right = (f"({', '.join(chain)})" for chain in chains.values())
            raise RetargetError(
                f"{robot.file}: field mapping: left_arm has {len(arms[0])} joints {left}, right_arm {len(arms[1])} "
                f"{right}, expected as many in both"
            )
        model, data = robot.model, mujoco.MjData(robot.model)
        data.qpos[robot.qpos_address] = robot.stand_pose
        flat = np.concatenate(arms)
        # Arm joints at their reference, where xaxis and xanchor are the constants of the product of exponentials.
        data.qpos[robot.qpos_address[flat]] = model.qpos0[robot.qpos_address[flat]]
        data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
        mujoco.mj_kinematics(model, data)
        origin, turned = data.xpos[robot.torso_id].copy(), data.xmat[robot.torso_id].reshape(3, 3).copy()
        bodies = [robot.model.body(hand.body).id for hand in (hands.left, hands.right)]
        self.joints = np.array([self._in_order(robot, arm, body) for arm, body in zip(arms, bodies, strict=True)])
        ids = np.array([[model.joint(robot.joint_names[i]).id for i in arm] for arm in self.joints])
        tips = np.array(
            [
                data.xpos[body] + data.xmat[body].reshape(3, 3) @ np.asarray(hand.point)
                for body, hand in zip(bodies, (hands.left, hands.right), strict=True)
            ]
        )
        self._axes = data.xaxis[ids] @ turned
        self._anchors = (data.xanchor[ids] - origin) @ turned
        self._tips = (tips - origin) @ turned
        self.lower, self.upper = robot.lower[self.joints], robot.upper[self.joints]
        self._elbow, self._shoulder = self._divide()
        self.has_elbow = self._elbow is not None
        self.fore_joint = self._shoulder if self._elbow is None else self._elbow
        # Any point of its axis is an anchor of a joint: take those nearest to the segments, for the links' directions.
        end = self._tips
        for joint in (self._shoulder,) if self._elbow is None else (self._elbow, self._shoulder):
            self._anchors[:, joint] = end = self._nearest(joint, end)
        self.arms = packed(
            arm_loops.Arms,
            axes=self._axes,
            anchors=self._anchors,
            tips=self._tips,
            zero=model.qpos0[robot.qpos_address[self.joints]],
            shoulder=self._shoulder,
            elbow=-1 if self._elbow is None else self._elbow,
        )
        stand = self.poses(robot.stand_pose[self.joints])
        elbow = stand.elbow if self.has_elbow else 0.5 * (stand.shoulder + stand.hand)
        self.lengths = np.stack(
            [np.linalg.norm(elbow - stand.shoulder, axis=-1), np.linalg.norm(stand.hand - elbow, axis=-1)], axis=1
        )

    @staticmethod
    def _in_order(robot: Robot, arm: list[int], hand: int) -> list[int]:
        """The joints of an arm from torso to hand."""
        model, path = robot.model, []
        while hand > 0:
            path.append(hand)
            hand = int(model.body_parentid[hand])
        depth = {}
        for joint in arm:
            name = robot.joint_names[joint]
            body = int(model.joint(name).bodyid[0])
            if body not in path:
                raise RetargetError(f"{robot.file}: joint {name!r} of the mapping's arms does not move its hand")
            depth[joint] = (-path.index(body), int(model.joint(name).id))
        return sorted(arm, key=depth.__getitem__)

    def _divide(self) -> tuple[int | None, int]:
        """Places of elbow (None: no joint divides the arm) and shoulder in the chain, by the lengths between joints."""
        anchors, tip = self._anchors[0], self._tips[0]
        before = np.linalg.norm(anchors - anchors[0], axis=1)
        after = np.linalg.norm(anchors - tip, axis=1)
        shorter = np.minimum(before, after)
        elbow = int(np.argmax(shorter))
        if shorter[elbow] < _SHORTEST_SEGMENT * (before[elbow] + after[elbow]):
            return None, int(np.flatnonzero(after >= _SHOULDER_SHARE * after.max())[-1])
        away = np.linalg.norm(anchors[:elbow] - anchors[elbow], axis=1)
        return elbow, int(np.flatnonzero(away >= _SHOULDER_SHARE * away.max())[-1])

    def _nearest(self, joint: int, point: Float) -> Float:
        """Points of the axes of both sides' joint nearest to points (2, 3) [m].

        Where the axis runs along the segment (a joint that turns the upper arm about itself) they stay at the anchor.
        """
        anchor, axis = self._anchors[:, joint], self._axes[:, joint]
        away = point - anchor
        along = np.sum(away * axis, axis=1, keepdims=True)
        if (np.abs(along) > _ALONG * np.linalg.norm(away, axis=1, keepdims=True)).any():
            return anchor
        return anchor + along * axis

    def poses(self, q: Float) -> ArmPoses:
        """Segments of the arms at joint angles (..., 2, m) [rad]."""
        found = arm_loops.poses(self.arms, np.ascontiguousarray(q.reshape(-1, *q.shape[-2:])))
        points, units, slopes, hands = (array.reshape(*q.shape[:-2], *array.shape[1:]) for array in found)
        return ArmPoses(
            upper=units[..., 0, :],
            fore=units[..., 1, :],
            shoulder=points[..., 0, :],
            elbow=points[..., 1, :],
            hand=points[..., 2, :],
            upper_jacobian=slopes[..., 0, :, :],
            fore_jacobian=slopes[..., 1, :, :],
            hand_jacobian=hands,
        )
