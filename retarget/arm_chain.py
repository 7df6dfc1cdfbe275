"""`ArmChain`: both arms of a robot as chains of hinges, with their kinematics for many poses at once.

Forward kinematics are the product of exponentials (Brockett 1984; Lynch and Park, Modern Robotics, 4.1): axes and
anchors of the joints in the model's reference pose say all that is needed, for any number and order of joints. In numpy
over all poses at once, since a call into MuJoCo per pose costs more than the arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot
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

    Vectors have their coordinates last, and lie in memory with their coordinates first (see `coordinates_first`).

    Attributes:
        upper, fore: unit vectors from shoulder to elbow and from elbow to hand, (..., 2, 3). Those of an arm without
            elbow are both from shoulder to hand.
        shoulder, elbow, hand: positions, (..., 2, 3) [m].
        upper_jacobian, fore_jacobian: derivatives of the unit vectors by the joints of their arm, (..., 2, m, 3)
            [1/rad]; computed when they are first asked for.
    """

    upper: Float
    fore: Float
    shoulder: Float
    elbow: Float
    hand: Float
    _segments: _Segments

    @property
    def upper_jacobian(self) -> Float:
        """See the class."""
        return _by_joint(self._jacobians[:, :, 0])

    @property
    def fore_jacobian(self) -> Float:
        """See the class."""
        return _by_joint(self._jacobians[:, :, -1])

    @cached_property
    def hand_jacobian(self) -> Float:
        """Derivatives of the hands by the joints of their arm, (..., 2, m, 3) [m/rad]; see the class."""
        return _by_joint(self._segments.hand_jacobian())

    @cached_property
    def _jacobians(self) -> Float:
        return self._segments.jacobians()


class _Segments:
    """The segments of both arms, coordinates first: upper arm and forearm, or the whole arm where no joint divides it.

    Args:
        points: shoulder, elbow if there is one, and hand, (3, G + 1, ..., 2) [m].
        axes, anchors: of all joints, (3, m, ..., 2).
        joints: those at the points before the hand, G.

    Attributes:
        unit: vectors along the segments, (3, G, ..., 2).
    """

    def __init__(self, points: Float, axes: Float, anchors: Float, joints: tuple[int, ...]) -> None:
        self._points, self._axes, self._anchors, self._joints = points, axes, anchors, joints
        self._along = points[:, 1:] - points[:, :-1]
        self._length = np.sqrt((self._along * self._along).sum(axis=0))
        self.unit: Float = self._along / self._length

    def hand_jacobian(self) -> Float:
        """Derivatives of the hands, which all joints move, (3, m, ..., 2) [m/rad]."""
        return _cross(self._axes, self._points[:, -1:] - self._anchors)

    def jacobians(self) -> Float:
        """Derivatives of the unit vectors by the joints, (3, m, G, ..., 2) [1/rad]."""
        moved = self._points[:, None, 1:] - self._anchors[:, :, None]
        for segment, joint in enumerate(self._joints):
            # Joints before the first point of a segment turn both of its points.
            moved[:, : joint + 1, segment] = self._along[:, None, segment]
        out = _cross(self._axes[:, :, None], moved)
        for segment, joint in enumerate(self._joints[1:]):
            out[:, joint:, segment] = 0.0
        unit = self.unit[:, None]
        out -= (out * unit).sum(axis=0) * unit
        out /= self._length
        return out


def _by_joint(derivatives: Float) -> Float:
    """Derivatives with their coordinates first, (3, m, ..., 2), as (..., 2, m, 3): a view."""
    return derivatives.transpose(*range(2, derivatives.ndim), 1, 0)


class ArmChain:
    """Both arms of one robot; joints that are in neither stay as in the stand pose.

    Attributes:
        joints: columns of the arm joints in the robot's order, from torso to hand, (2, m).
        lower, upper: limits, (2, m) [rad].
        has_elbow: whether a joint divides the arm into upper arm and forearm.
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
        self._zero = model.qpos0[robot.qpos_address[self.joints]]
        self.lower, self.upper = robot.lower[self.joints], robot.upper[self.joints]
        cross = _cross_matrices(self._axes)
        self._cross, self._cross_squared = _for_poses(cross), _for_poses(cross @ cross)
        self._elbow, self._shoulder = self._divide()
        self.has_elbow = self._elbow is not None
        self.fore_joint = self._shoulder if self._elbow is None else self._elbow
        # Any point of its axis is an anchor of a joint: take those nearest to the segments, for the links' directions.
        end = self._tips
        for joint in (self._shoulder,) if self._elbow is None else (self._elbow, self._shoulder):
            self._anchors[:, joint] = end = self._nearest(joint, end)
        # Anchors and ends of axes of the joints in turn, and the hand, (2, 2 m + 1, 3).
        pairs = np.stack([self._anchors, self._anchors + self._axes], axis=2).reshape(2, -1, 3)
        self._at_zero = _for_poses(np.concatenate([pairs, self._tips[:, None]], axis=1))
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
        batch, count = q.shape[:-2], q.shape[-1]
        angle = np.ascontiguousarray((q - self._zero).reshape(-1, 2, count).transpose())
        # Rodrigues' formula without the identity, sin K + (1 - cos) K²: (column, row, joint, side, pose).
        turns = np.sin(angle) * self._cross
        turns += (1.0 - np.cos(angle)) * self._cross_squared
        # Each joint turns what comes after it: anchors and ends of axes of later joints, and the hand.
        points = np.empty((3, 2 * count + 1, *angle.shape[1:]))
        points[...] = self._at_zero
        for k in range(count - 1, -1, -1):
            moved = points[:, 2 * k + 2 :]
            moved += np.einsum("crsn,cpsn->rpsn", turns[:, :, k], moved - points[:, 2 * k, None])
        # The last axes in memory are side, pose; the axes that are returned are (3, 2m + 1, ..., 2).
        points = np.moveaxis(points.reshape(3, 2 * count + 1, 2, *batch), 2, -1)
        anchors, hand = points[:, :-1:2], points[:, -1]
        axes = points[:, 1::2] - anchors
        joints = (self._shoulder,) if self._elbow is None else (self._shoulder, self._elbow)
        ends = np.stack([*(anchors[:, joint] for joint in joints), hand], axis=1)
        segments = _Segments(ends, axes, anchors, joints)
        return ArmPoses(
            upper=coordinates_last(segments.unit[:, 0]),
            fore=coordinates_last(segments.unit[:, -1]),
            shoulder=coordinates_last(ends[:, 0]),
            elbow=coordinates_last(ends[:, 1]),
            hand=coordinates_last(hand),
            _segments=segments,
        )


def coordinates_first(array: Float) -> Float:
    """A view with the last axis first, (..., n) -> (n, ...): numpy is fastest along a long last axis."""
    return array.transpose(-1, *range(array.ndim - 1))


def coordinates_last(array: Float) -> Float:
    """A view with the first axis last, (n, ...) -> (..., n)."""
    return array.transpose(*range(1, array.ndim), 0)


def _cross(a: Float, b: Float) -> Float:
    """Cross product of vectors with coordinates first; `numpy.cross` takes five times as long."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


def _for_poses(constants: Float) -> Float:
    """Constants of both sides, (2, k, ..., 3), for any number of poses, coordinates first: (3, ..., k, 2, 1)."""
    return np.ascontiguousarray(constants.transpose())[..., None]


def _cross_matrices(axis: Float) -> Float:
    """Matrices K with K v = axis x v, (..., 3) -> (..., 3, 3)."""
    out = np.zeros((*axis.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -axis[..., 2], axis[..., 1], -axis[..., 0]
    return out - out.swapaxes(-1, -2)
