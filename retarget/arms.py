"""Arms and head: the human's upper arms, forearms and gaze mapped to the robot's joints.

Arms follow directions of segments in the torso frame. `ArmBranches` decides over the whole window in which
configuration, `ArmPath` refines the joint angles; both start from where the last plan has brought the arms, so that
plans agree where they join.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.human.kinematics import HumanKinematics
from flexmotion.retarget.arm_branches import ArmBranches
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.retarget.arm_clearance import BodyClearance
from flexmotion.retarget.arm_cost import ArmCost, ArmTargets
from flexmotion.retarget.arm_path import ArmPath
from flexmotion.spatial.rotations import zyx_yaw_pitch

Float = NDArray[np.float64]

SPEED_SHARE = 0.8
"""Share of a servo's no-load speed that arms and head use."""
_STRAIGHT = 0.98
"""Share of the arm's length from which on a hand counts as out of reach."""


class UpperBody:
    """Solves arms and head of one robot.

    Attributes:
        joints: columns of the robot's joints that this class sets, arms before head, (U,).
        arms: columns of the arm joints, (2, m).
        head: role (`pan`, `tilt`) -> column.
        lengths: of upper arm and forearm a side, (2, 2) [m].

    Raises:
        RetargetError: the robot file has no hands, or arms that cannot be solved (see `ArmChain`).
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.chain = ArmChain(robot)
        self.arms, self.lengths = self.chain.joints, self.chain.lengths
        self.head = robot.chain("head") if robot.mapping.head is not None else {}
        self.joints = np.concatenate([*self.arms, np.array(sorted(self.head.values()), dtype=int)])
        self._head_signs = self._signs()
        speed = SPEED_SHARE * robot.no_load_speed[self.arms]
        cost = ArmCost(self.chain, BodyClearance(robot, self.chain), robot.stand_pose[self.arms])
        self._branches, self._path = ArmBranches(self.chain, cost, speed), ArmPath(self.chain, cost, speed)

    def _signs(self) -> dict[str, float]:
        """Sign of each head joint against turning left (pan) and looking down (tilt)."""
        model, data = self.robot.model, mujoco.MjData(self.robot.model)
        mujoco.mj_kinematics(model, data)
        axis = {"pan": 2, "tilt": 1}
        names = {role: self.robot.joint_names[index] for role, index in self.head.items()}
        return {role: float(np.sign(data.xaxis[model.joint(name).id][axis[role]])) for role, name in names.items()}

    def solve(
        self,
        human: HumanKinematics,
        start: Float,
        fps: float,
        before: Float | None = None,
        checkpoint: Callable[[], None] = lambda: None,
    ) -> tuple[Float, ArmTargets]:
        """Joint angles of each frame.

        Args:
            human: the frames of the window.
            start: angles of `self.joints` where the window begins, (U,) [rad].
            fps: frames a second.
            before: angles at the two frames before the first, oldest first, (2, U) [rad], which the arms continue;
                None: they begin anywhere.
            checkpoint: called between the parts of the work; what it raises ends it.

        Returns:
            Angles of `self.joints`, (F, U) [rad], inside their limits, and what the arms followed.
        """
        targets = self.targets(human)
        chosen = self._branches.choose(targets, self._of_arms(start), fps)
        checkpoint()
        known = None if before is None else self._of_arms(before)
        arms = self._path.refine(targets, chosen, known, fps)
        gaze = self._gaze(human)
        out = np.empty((len(arms), len(self.joints)))
        out[:, : self.arms.size] = arms.reshape(len(arms), -1)
        for column, index in enumerate(self.joints[self.arms.size :], start=self.arms.size):
            role = next(role for role, own in self.head.items() if own == index)
            out[:, column] = np.clip(gaze[role], self.robot.lower[index], self.robot.upper[index])
        return out, targets

    def head_sign(self, role: str) -> float:
        """Sign of a head joint, `pan` or `tilt`, against turning left or looking down."""
        return self._head_signs[role]

    def _of_arms(self, angles: Float) -> Float:
        """The arms' part of angles of `self.joints`, (..., U) -> (..., 2, m)."""
        return angles[..., : self.arms.size].reshape(*angles.shape[:-1], *self.arms.shape)

    def hand_errors(self, q: Float, targets: ArmTargets) -> Float:
        """Distance of each hand from where the human's is on the robot's segments, seen from the shoulder, (T, 2) [m].

        Args:
            q: all joint angles, (T, n) [rad]; targets: of the same rows.

        Returns:
            NaN where the human's arm is straight: the robot's hand would have to be at the very end of its reach.
        """
        poses = self.chain.poses(q[:, self.arms])
        away = np.linalg.norm(poses.hand - poses.shoulder - self._wanted(targets), axis=-1)
        return np.where(self.straight(targets), np.nan, away)

    def targets(self, human: HumanKinematics) -> ArmTargets:
        """What the arms follow of the frames of a window."""
        return ArmTargets.of(human, self.chain, self.robot.safety.most_tilt)

    def straight(self, targets: ArmTargets) -> NDArray[np.bool_]:
        """Whether the human's arm is so straight that the robot's hand would be at the end of its reach, (T, 2)."""
        length, most = np.linalg.norm(self._wanted(targets), axis=-1), _STRAIGHT * self.lengths.sum(axis=1)
        straight: NDArray[np.bool_] = length >= most
        return straight

    def _wanted(self, targets: ArmTargets) -> Float:
        """Places of the hands from the shoulders, (T, 2, 3) [m]."""
        return self.lengths[:, :1] * targets.upper + self.lengths[:, 1:] * targets.fore

    def _gaze(self, human: HumanKinematics) -> dict[str, Float]:
        relative = np.swapaxes(human.torso_rotation, 1, 2) @ human.head_rotation
        yaw, pitch = zyx_yaw_pitch(relative)
        angles = {"pan": yaw, "tilt": pitch}
        return {role: sign * angles[role] for role, sign in self._head_signs.items()}
