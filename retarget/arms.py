"""Arms and head: the human's hands, elbows and gaze mapped to the robot's joints.

Each arm is solved by damped least squares on the position of its hand and, with less weight, of its elbow, in the torso
frame, starting from the frame before. So it does not flip and needs no particular joint order. Where the solution is
stuck at joint limits far from the target, the nearest of a set of sampled poses is the new start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.stats import qmc

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot
from flexmotion.human.kinematics import HumanKinematics
from flexmotion.retarget.legs import SIDE_NAMES
from flexmotion.spatial.rotations import zyx_yaw_pitch

Float = NDArray[np.float64]

_FIRST_ITERATIONS, _ITERATIONS = 10, 1
"""Most iterations for the first frame, and for each further frame, which starts from the one before."""
_ARRIVED = 0.005
"""The iterations end when no joint moves further than this [rad]."""
_DAMPING = 0.12
"""Damping over arm length; keeps joint steps bounded where the arm is straight."""
_ELBOW_WEIGHT = 0.25
_LARGEST_STEP = 0.35
"""Longest step of a joint [rad]."""
_SAMPLES = 4096
"""Number of sampled poses of an arm, as starts where the last pose does not lead to the target."""
_NEIGHBOURS = 16
"""Number of samples nearest to the target that are compared by the distance that the joints must move."""
_RESTART_ERROR, _RESTART_FRAMES = 0.12, 4
"""Error over arm length above which another start is searched, every so many frames; it must halve the error."""
_TRAVEL_WEIGHT = 0.02
"""Cost of a squared radian of joint movement to a new start, in squared error over squared arm length."""

_AT_ORIGIN = (0, 0, 0, 1, 0, 0, 0)
_SIDES = np.array([[0], [1]])


@dataclass(frozen=True)
class ArmTargets:
    """Targets of the robot's hands and elbows in its torso frame, and which of them it can reach.

    Attributes:
        hand, elbow: (F, 2, 3) [m], left then right.
        reachable: (F, 2) bool.
    """

    hand: Float
    elbow: Float
    reachable: NDArray[np.bool_]


class UpperBody:
    """Solves arms and head of one robot; has MuJoCo data of its own, with the torso at the origin.

    Raises:
        RetargetError: the robot file has no hands, or arms of different numbers of joints.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, robot.model
        self.data = mujoco.MjData(robot.model)
        self.torso = robot.torso_id
        arms = [list(robot.chain(f"{side}_arm").values()) for side in SIDE_NAMES]
        hands = robot.config.hands
        if hands is None or len(arms[0]) != len(arms[1]):
            raise RetargetError(f"{robot.file}: field hands is required, and two arms with the same number of joints")
        self.arms = np.array(arms)
        """Columns of the arm joints in the robot's order, (2, m)."""
        self.head = robot.chain("head")
        self.joints = np.concatenate([*self.arms, np.array(sorted(self.head.values()), dtype=int)])
        """Columns of the robot's joints that this class sets."""
        # Views, looked up once: an attribute of MjData costs as much as the kinematics of this robot.
        self._qpos, self._xpos, self._xmat, self._xanchor = (
            getattr(self.data, name) for name in ("qpos", "xpos", "xmat", "xanchor")
        )
        self._joint_ids = np.array([[self._joint_id(i) for i in arm] for arm in arms])
        self._hand_bodies = np.array([robot.model.body(hand.body).id for hand in (hands.left, hands.right)])
        self._hand_offsets = np.array([hand.point for hand in (hands.left, hands.right)])
        self._elbow_bodies = self.model.jnt_bodyid[self._joint_ids[:, -1]]
        self._dofs = self.model.jnt_dofadr[self._joint_ids]
        self._jacobians = np.zeros((2, 2, 3, self.model.nv))
        self._error = np.zeros((2, 6))
        self._lower, self._upper = robot.lower[self.arms], robot.upper[self.arms]
        self._head_signs = self._signs()
        self.lengths = self._measure()
        self._reach_squared = self.lengths.sum(axis=1) ** 2
        self._samples, self._trees = self._sample()
        self._damping = (_DAMPING * self.lengths.sum(axis=1)[:, None, None]) ** 2 * np.eye(len(arms[0]))

    def _joint_id(self, index: int) -> int:
        return int(self.model.joint(self.robot.joint_names[index]).id)

    def _signs(self) -> dict[str, float]:
        """Sign of each head joint against turning left (pan) and looking down (tilt)."""
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_kinematics(self.model, self.data)
        axis = {"pan": 2, "tilt": 1}
        return {role: float(np.sign(self.data.xaxis[self._joint_id(i)][axis[role]])) for role, i in self.head.items()}

    def _measure(self) -> Float:
        """Upper arm and forearm lengths a side, (2, 2) [m]."""
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_kinematics(self.model, self.data)
        shoulder, elbow = self.data.xanchor[self._joint_ids[:, -2]], self.data.xanchor[self._joint_ids[:, -1]]
        segments = np.stack([elbow - shoulder, self._hand_points() - elbow], axis=1)
        return np.linalg.norm(segments, axis=2)

    def _sample(self) -> tuple[list[Float], list[KDTree]]:
        """Poses of each arm spread over its limits, (_SAMPLES, m) [rad], and trees of hand and elbow positions."""
        q = np.zeros(self.robot.n)
        spread = qmc.Halton(self.arms.shape[1], scramble=False).random(_SAMPLES)
        poses = [lower + spread * (upper - lower) for lower, upper in zip(self._lower, self._upper, strict=True)]
        points = np.empty((2, _SAMPLES, 6))
        for k in range(_SAMPLES):
            for side in (0, 1):
                q[self.arms[side]] = poses[side][k]
            self._place(q)
            points[:, k, :3] = self._hand_points()
            points[:, k, 3:] = _ELBOW_WEIGHT * self.data.xanchor[self._joint_ids[:, -1]]
        points /= self.lengths.sum(axis=1)[:, None, None]
        return poses, [KDTree(side) for side in points]

    def _hand_points(self) -> Float:
        """Both hands in the world, (2, 3) [m]."""
        rotation = self._xmat[self._hand_bodies].reshape(2, 3, 3)
        return self._xpos[self._hand_bodies] + (rotation @ self._hand_offsets[:, :, None])[:, :, 0]

    def _place(self, q: Float) -> None:
        self._qpos[:7] = _AT_ORIGIN
        self._qpos[self.robot.qpos_address] = q
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
        shoulder = self.data.xanchor[self._joint_ids[:, -2]] - self.data.xpos[self.torso]
        elbow = shoulder + upper
        hand = elbow + fore
        reach = np.linalg.norm(hand - shoulder, axis=-1)
        return ArmTargets(hand, elbow, reach < 0.98 * self.lengths.sum(axis=1))

    def solve(
        self, human: HumanKinematics, start: Float, first: int = 0, checkpoint: Callable[[], None] | None = None
    ) -> tuple[Float, ArmTargets]:
        """Joint angles frame by frame, each from the one before.

        Args:
            start: all joints before the first frame, (n,) [rad]; the legs do not matter.
            first: index of the first frame in its source, so that windows that overlap search for a start at the same
                frames.
            checkpoint: called before each frame; what it raises ends the work.

        Returns:
            Angles of `self.joints`, (F, len(self.joints)) [rad], inside their limits, and the targets.
        """
        robot = self.robot
        targets = self.targets(human)
        q = start.copy()
        gaze = self._gaze(human)
        out = np.empty((len(targets.hand), len(self.joints)))
        for frame in range(len(out)):
            if checkpoint is not None:
                checkpoint()
            hand, elbow = targets.hand[frame], targets.elbow[frame]
            error = self._descend(q, hand, elbow, _ITERATIONS if frame else _FIRST_ITERATIONS)
            if (first + frame) % _RESTART_FRAMES == 0 and (error > _RESTART_ERROR**2).any():
                self._restart(q, hand, elbow, error)
            for role, index in self.head.items():
                q[index] = min(max(gaze[role][frame], robot.lower[index]), robot.upper[index])
            out[frame] = q[self.joints]
        return out, targets

    def _descend(self, q: Float, hand: Float, elbow: Float, iterations: int) -> Float:
        """Move the arms of `q` towards hands and elbows (2, 3), in place; returns the last error but one."""
        error = np.zeros(2)
        for _ in range(iterations):
            self._place(q)
            step, error = self._step(hand, elbow)
            before = q[self.arms]
            q[self.arms] = np.minimum(np.maximum(before + step, self._lower), self._upper)
            if np.abs(q[self.arms] - before).max() < _ARRIVED:
                break
        return error

    def _restart(self, q: Float, hand: Float, elbow: Float, error: Float) -> None:
        """Restart arms with a large error (2,) from a sampled pose, where one is much nearer to the target."""
        for side in np.flatnonzero(error > _RESTART_ERROR**2):
            wanted = np.concatenate([hand[side], _ELBOW_WEIGHT * elbow[side]]) / self.lengths[side].sum()
            nearest, found = self._trees[side].query(wanted, k=_NEIGHBOURS)
            distances = np.asarray(nearest)
            poses = self._samples[side][found]
            travel = np.sum((poses - q[self.arms[side]]) ** 2, axis=1)
            best = int(np.argmin(distances**2 + _TRAVEL_WEIGHT * travel))
            if distances[best] ** 2 < 0.5 * error[side]:
                q[self.arms[side]] = poses[best]

    def _step(self, hand: Float, elbow: Float) -> tuple[Float, Float]:
        """One damped least-squares step of both arms towards hands and elbows (2, 3).

        Returns:
            The step (2, m) [rad], and the squared error before it over the squared arm length, (2,).
        """
        data, error = self.data, self._error
        tip, joint, origin = self._hand_points(), self._xanchor[self._joint_ids[:, -1]], self._xpos[self.torso]
        mujoco.mj_comPos(self.model, data)
        for side in (0, 1):
            mujoco.mj_jac(self.model, data, self._jacobians[side, 0], None, tip[side], self._hand_bodies[side])
            mujoco.mj_jac(self.model, data, self._jacobians[side, 1], None, joint[side], self._elbow_bodies[side])
        # Of each arm: hand, then elbow, by its own joints, (2, m, 6).
        jacobian = self._jacobians.reshape(2, 6, -1)[_SIDES, :, self._dofs]
        jacobian[:, :, 3:] *= _ELBOW_WEIGHT
        np.subtract(hand, tip - origin, out=error[:, :3])
        np.subtract(elbow, joint - origin, out=error[:, 3:])
        error[:, 3:] *= _ELBOW_WEIGHT
        normal = jacobian @ jacobian.swapaxes(1, 2) + self._damping
        step = np.linalg.solve(normal, jacobian @ error[:, :, None])[:, :, 0]
        relative = np.sum(error**2, axis=1) / self._reach_squared
        return np.minimum(np.maximum(step, -_LARGEST_STEP), _LARGEST_STEP), relative

    def hand_positions(self, q: Float) -> Float:
        """Both hands in the torso frame for joint angles (n,), (2, 3) [m]."""
        self._place(q)
        return self._hand_points() - self.data.xpos[self.torso]

    def arm_points(self, q: Float) -> tuple[Float, Float, Float]:
        """Shoulders, elbows and hands in the torso frame for joint angles (n,), (2, 3) each [m]; left, right."""
        hands = self.hand_positions(q)
        anchors = self._xanchor[self._joint_ids[:, -2:]] - self.data.xpos[self.torso]
        return anchors[:, 0].copy(), anchors[:, 1].copy(), hands

    def _gaze(self, human: HumanKinematics) -> dict[str, Float]:
        relative = np.swapaxes(human.torso_rotation, 1, 2) @ human.head_rotation
        yaw, pitch = zyx_yaw_pitch(relative)
        angles = {"pan": yaw, "tilt": pitch}
        return {role: sign * angles[role] for role, sign in self._head_signs.items()}
