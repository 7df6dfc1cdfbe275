"""Poses of the robot to draw: measured and planned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.spatial.heading import heading, matrix_heading

Float = NDArray[np.float64]
Row = np.ndarray[Any, Any]


@dataclass(frozen=True)
class Placement:
    """Where the plan's world lies in the drawn one.

    Attributes:
        yaw: of the plan's world about z [rad].
        pivot, to: a point (2,) of the plan's world, and where it is in the drawn one [m].
    """

    yaw: float
    pivot: Float
    to: Float

    def points(self, xy: Float) -> Float:
        """Points of the plan's world (..., 2) in the drawn one [m]."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        placed: Float = (np.asarray(xy, float) - self.pivot) @ np.array([[cos, sin], [-sin, cos]]) + self.to
        return placed

    def base(self, base: Float) -> Float:
        """A torso (7,) of the plan's world in the drawn one."""
        placed, turn = base.copy(), np.array([np.cos(0.5 * self.yaw), 0.0, 0.0, np.sin(0.5 * self.yaw)])
        placed[:2] = self.points(base[:2])
        mujoco.mju_mulQuat(placed[3:], turn, base[3:])
        return placed

    def feet(self, feet: Float) -> Float:
        """Soles (2, 4) of the plan's world, x, y, z [m] and yaw [rad], in the drawn one."""
        placed = np.array(feet, float)
        placed[:, :2] = self.points(feet[:, :2])
        placed[:, 3] += self.yaw
        return placed


AS_PLANNED = Placement(0.0, np.zeros(2), np.zeros(2))


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

    @property
    def sole_yaws(self) -> Float:
        """Headings of the left and right foot, (2,) [rad]."""
        return matrix_heading(self.data.xmat[list(self.robot.foot_ids)].reshape(2, 3, 3))


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
    """The planned robot, standing on the measured robot's feet.

    The plan's world drifts from the simulation's with what the feet slip. The poses are compared without that drift.

    Attributes:
        placement: of the plan's world in the drawn one, at the last `show`.
    """

    placement = AS_PLANNED

    def show(self, row: Row, measured: MeasuredPose) -> bool:
        """Set the reference of a row of `flexmotion.streamer.control.tick_row`; returns whether there is one.

        Args:
            row: of the loop.
            measured: the robot of this row, already shown.
        """
        self.placement = AS_PLANNED
        known = bool(np.isfinite(row["base_ref"]).all() and np.isfinite(row["q_ref"]).all())
        if not known:
            return False
        self.place(row["base_ref"], row["q_ref"])
        if np.isfinite(row["true_base"]).all() and np.isfinite(row["q"]).all():
            self.placement = self._under(measured, row["contact_ref"])
            self.place(self.placement.base(row["base_ref"]), row["q_ref"])
        return True

    def _under(self, measured: MeasuredPose, in_contact: NDArray[np.bool_]) -> Placement:
        """The placement that brings the planned feet in contact, or both, to the measured ones."""
        feet = in_contact if in_contact.any() else ~in_contact
        turns = measured.sole_yaws[feet] - self.sole_yaws[feet]
        yaw = float(np.arctan2(np.sin(turns).mean(), np.cos(turns).mean()))
        return Placement(yaw, self.soles[feet, :2].mean(axis=0), measured.soles[feet, :2].mean(axis=0))


def _tilted(quaternion: Float, tilt: Float) -> Float:
    """The quaternion's heading with roll and pitch `tilt` (2,) [rad]."""
    tilted = np.zeros(4)
    mujoco.mju_euler2Quat(tilted, np.array([0.0, tilt[1], tilt[0]]), "zyx")
    yaw = heading(quaternion) - heading(tilted)
    mujoco.mju_euler2Quat(tilted, np.array([yaw, tilt[1], tilt[0]]), "zyx")
    return tilted
