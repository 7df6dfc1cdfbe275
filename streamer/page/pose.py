"""Poses of the robot to draw: measured and planned."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.spatial.heading import heading

Float = NDArray[np.float64]
Row = np.ndarray[Any, Any]


class Pose:
    """All bodies of one robot in one pose.

    Attributes:
        base: torso in the world, position [m] and quaternion w x y z, (7,).
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model, self.data = robot, robot.model, mujoco.MjData(robot.model)
        self.base = np.array([0.0, 0, 0, 1, 0, 0, 0])
        self.place(self.base, robot.stand_pose)
        self.base[2] = -self.soles[:, 2].min()
        self.place(self.base, robot.stand_pose)

    def place(self, base: Float, q: Float) -> None:
        """Set the torso to `base` (7,) and the joints to `q` (n,) [rad]."""
        data = self.data
        self.base[:] = base
        data.qpos[:7] = base
        data.qpos[self.robot.qpos_address] = q
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)

    @property
    def com(self) -> Float:
        """Centre of mass in the world, (3,) [m]."""
        return self.data.subtree_com[self.robot.torso_id]

    @property
    def soles(self) -> Float:
        """Centres of the left and right sole in the world, (2, 3) [m]."""
        feet = list(self.robot.foot_ids)
        rotation = self.data.xmat[feet].reshape(2, 3, 3)
        return self.data.xpos[feet] + np.einsum("fij,fj->fi", rotation, self.robot.soles)


class MeasuredPose(Pose):
    """The measured robot: the simulation's truth; on hardware joints and tilt as measured, on the planned feet."""

    def show(self, row: Row) -> bool:
        """Set the pose of a row of `flexmotion.streamer.control.tick_row`; returns whether it is known."""
        if not np.isfinite(row["q"]).all():
            return False
        if np.isfinite(row["true_base"]).all():
            self.place(row["true_base"], row["q"])
        else:
            self._stand_on_plan(row)
        return True

    def _stand_on_plan(self, row: Row) -> None:
        """Set the measured tilt, and move the torso so that the soles in contact are at their planned positions.

        Without a plan the robot stays where it was, its lower sole on the floor.
        """
        planned = bool(np.isfinite(row["base_ref"]).all())
        base = row["base_ref"].copy() if planned else self.base.copy()
        if np.isfinite(row["tilt"]).all():
            base[3:] = _tilted(base[3:], row["tilt"])
        self.place(base, row["q"])
        soles = self.soles
        if planned and row["contact_ref"].any():
            in_contact = row["contact_ref"]
            base[:3] += (row["foot_ref"][in_contact, :3] - soles[in_contact]).mean(axis=0)
        else:
            base[2] -= soles[:, 2].min()
        self.place(base, row["q"])


class PlannedPose(Pose):
    """The planned robot."""

    def show(self, row: Row) -> bool:
        """Set the reference of a row of `flexmotion.streamer.control.tick_row`; returns whether there is one."""
        known = bool(np.isfinite(row["base_ref"]).all() and np.isfinite(row["q_ref"]).all())
        if known:
            self.place(row["base_ref"], row["q_ref"])
        return known


def _tilted(quaternion: Float, tilt: Float) -> Float:
    """The quaternion's heading with roll and pitch `tilt` (2,) [rad]."""
    tilted = np.zeros(4)
    mujoco.mju_euler2Quat(tilted, np.array([0.0, tilt[1], tilt[0]]), "zyx")
    yaw = heading(quaternion) - heading(tilted)
    mujoco.mju_euler2Quat(tilted, np.array([yaw, tilt[1], tilt[0]]), "zyx")
    return tilted
