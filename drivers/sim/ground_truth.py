"""`GroundTruth`: the true state of the robot, taken from MuJoCo's data."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.sim.world import FLOOR
from flexmotion.drivers.simulated import Truth

Float = NDArray[np.float64]


class GroundTruth:
    """Reads `Truth` from a model and its data."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model, self._data = model, data
        self._torso, self._feet = robot.torso_id, np.array(robot.foot_ids)
        self._joints = robot.qpos_address
        self._soles = robot.soles[:, :, None]
        self._floor = model.geom(FLOOR).id

    def read(self, torque: Float, saturated: Float) -> Truth:
        """The true state now; ground forces are those of the last physics step.

        Args:
            torque, saturated: as in `Truth`, (n,) each; copied.
        """
        model, data = self._model, self._data
        # After mj_step, derived positions are those before its integration: update what is reported here.
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        arm = np.matmul(data.xmat[self._feet].reshape(2, 3, 3), self._soles)[:, :, 0]
        soles = data.xpos[self._feet] + arm
        # cvel: angular velocity, then linear velocity at the centre of mass of the body's whole tree.
        twist = data.cvel[self._feet]
        arm = soles - data.subtree_com[self._torso]
        return Truth(
            base_position=data.xpos[self._torso].copy(),
            base_quaternion=data.xquat[self._torso].copy(),
            joint_position=data.qpos[self._joints],
            foot_position=soles,
            foot_velocity=twist[:, 3:] + _cross(twist[:, :3], arm),
            foot_force=data.cfrc_ext[self._feet, 3:],
            torque=torque.copy(),
            saturated=saturated.copy(),
            com=data.subtree_com[self._torso].copy(),
            self_contact=self._self_contact(),
        )

    def _self_contact(self) -> bool:
        contacts = self._data.contact.geom
        return bool((contacts != self._floor).all(axis=1).any()) if len(contacts) else False


def _cross(a: Float, b: Float) -> Float:
    """Cross products by row, (m, 3). Written out: `np.cross` takes longer than the physics step before it."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
