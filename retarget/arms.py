"""Arms and head: the human's hands, elbows and gaze carried over to whatever joints the robot has there.

Each arm is solved by damped least squares on the position of its hand and, more weakly, of its elbow, in the torso
frame, from where it was a frame before; so it neither flips nor needs a particular joint order. (mink was measured
at about ten times the time a frame, for two chains of three joints that no constraint couples.)
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from configs.robot import Robot
from flexmotion.kinematics import HumanKinematics
from flexmotion.skeleton import SIDES
from retarget.legs import SIDE_NAMES

Float = NDArray[np.float64]

_ITERATIONS = 3
_DAMPING = 0.015
"""Added to the normal equations [m²]; keeps joint steps bounded where the arm is stretched."""
_ELBOW_WEIGHT = 0.25


@dataclass(frozen=True)
class ArmTargets:
    """Where the robot's hands and elbows belong, in its torso frame, and which of them it can reach.

    Attributes:
        hand, elbow: (F, 2, 3) [m], left then right.
        reachable: (F, 2) bool.
    """

    hand: Float
    elbow: Float
    reachable: NDArray[np.bool_]


class UpperBody:
    """Solves arms and head for one robot; holds its own MuJoCo data with the torso at the origin."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, robot.model
        self.data = mujoco.MjData(robot.model)
        self.torso = robot.torso_id
        self.arms = [np.array(list(robot.chain(f"{side}_arm").values())) for side in SIDE_NAMES]
        self.head = robot.chain("head")
        self.joints = np.concatenate([*self.arms, np.array(sorted(self.head.values()), dtype=int)])
        """Columns of the robot's joints that this class sets."""
        self._joint_ids = [np.array([self._joint_id(i) for i in arm]) for arm in self.arms]
        hands = robot.config.hands
        self._hands = [(robot.model.body(hand.body).id, np.asarray(hand.point)) for hand in (hands.left, hands.right)]
        self._head_signs = self._signs()
        self.lengths = self._measure()

    def _joint_id(self, index: int) -> int:
        return int(self.model.joint(self.robot.joint_names[index]).id)

    def _signs(self) -> dict[str, float]:
        """Sign of each head joint against turning left (pan) and looking down (tilt)."""
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_kinematics(self.model, self.data)
        axis = {"pan": 2, "tilt": 1}
        return {
            role: float(np.sign(self.data.xaxis[self._joint_id(i)][axis[role]]))
            for role, i in self.head.items()
        }

    def _measure(self) -> Float:
        """Upper arm and forearm lengths a side, (2, 2) [m]."""
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_kinematics(self.model, self.data)
        lengths = []
        for ids, (body, point) in zip(self._joint_ids, self._hands, strict=True):
            shoulder, elbow = self.data.xanchor[ids[-2]], self.data.xanchor[ids[-1]]
            lengths.append([np.linalg.norm(elbow - shoulder), np.linalg.norm(self._point(body, point) - elbow)])
        return np.array(lengths)

    def _point(self, body: int, point: Float) -> Float:
        return self.data.xpos[body] + self.data.xmat[body].reshape(3, 3) @ point

    def _place(self, q: Float) -> None:
        self.data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
        self.data.qpos[self.robot.qpos_address] = q
        mujoco.mj_kinematics(self.model, self.data)

    def targets(self, human: HumanKinematics) -> ArmTargets:
        """Human hands and elbows relative to the shoulders, scaled to the robot's arm segments."""
        torso = human.torso_rotation[:, None].swapaxes(-1, -2)
        upper = (torso @ (human.elbow - human.shoulder)[..., None])[..., 0]
        fore = (torso @ (human.hand - human.elbow)[..., None])[..., 0]
        upper *= (self.lengths[:, 0] / np.linalg.norm(upper, axis=-1).mean(axis=0))[None, :, None]
        fore *= (self.lengths[:, 1] / np.linalg.norm(fore, axis=-1).mean(axis=0))[None, :, None]
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_kinematics(self.model, self.data)
        shoulder = np.stack([self.data.xanchor[ids[-2]] for ids in self._joint_ids]) - self.data.xpos[self.torso]
        elbow = shoulder + upper
        hand = elbow + fore
        reach = np.linalg.norm(hand - shoulder, axis=-1)
        return ArmTargets(hand, elbow, reach < 0.98 * self.lengths.sum(axis=1))

    def solve(self, human: HumanKinematics, start: Float) -> tuple[Float, ArmTargets]:
        """Joint angles frame by frame.

        Args:
            start: all joints where the motion joins, (n,) [rad]; its legs are kept.

        Returns:
            Angles of `self.joints`, (F, len(self.joints)) [rad], inside their limits, and the targets.
        """
        robot = self.robot
        targets = self.targets(human)
        q = start.copy()
        gaze = self._gaze(human)
        out = np.empty((len(targets.hand), len(self.joints)))
        for frame in range(len(out)):
            for _ in range(_ITERATIONS):
                self._place(q)
                origin = self.data.xpos[self.torso]
                for side in range(len(SIDES)):
                    q[self.arms[side]] += self._step(side, targets.hand[frame, side], targets.elbow[frame, side], origin)
            for role, index in self.head.items():
                q[index] = gaze[role][frame]
            np.clip(q, robot.lower, robot.upper, out=q)
            out[frame] = q[self.joints]
        return out, targets

    def _step(self, side: int, hand: Float, elbow: Float, origin: Float) -> Float:
        ids = self._joint_ids[side]
        axes, anchors = self.data.xaxis[ids], self.data.xanchor[ids]
        tip, joint = self._point(*self._hands[side]), anchors[-1]
        jacobian = np.concatenate([np.cross(axes, tip - anchors).T, _ELBOW_WEIGHT * np.cross(axes, joint - anchors).T])
        error = np.concatenate([hand - (tip - origin), _ELBOW_WEIGHT * (elbow - (joint - origin))])
        length = self.lengths[side].sum()
        normal = jacobian.T @ jacobian + (_DAMPING * length) ** 2 * np.eye(len(ids))
        return np.clip(np.linalg.solve(normal, jacobian.T @ error), -0.35, 0.35)

    def hand_positions(self, q: Float) -> Float:
        """Both hands in the torso frame for joint angles (n,), (2, 3) [m]."""
        self._place(q)
        return np.stack([self._point(*hand) for hand in self._hands]) - self.data.xpos[self.torso]

    def _gaze(self, human: HumanKinematics) -> dict[str, Float]:
        relative = np.swapaxes(human.torso_rotation, 1, 2) @ human.head_rotation
        yaw, pitch, _ = Rotation.from_matrix(relative).as_euler("ZYX").T
        angles = {"pan": yaw, "tilt": pitch}
        return {role: sign * angles[role] for role, sign in self._head_signs.items()}
