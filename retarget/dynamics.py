"""Joint torques of a planned motion under its planned ground forces.

Inverse dynamics gives the total wrench of the ground. It is divided between the feet by load, with each centre of
pressure as near to the middle of its sole as the total allows, and the legs' torques are reduced by it:
tau = (M q'' + h)_joints - sum_feet J^T w  (Featherstone 2008, *Rigid Body Dynamics Algorithms*, eq. 5.22).
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.human.vectors import cross
from flexmotion.retarget.legs import Leg
from flexmotion.spatial.rotations import matrices

Float = NDArray[np.float64]


class RobotDynamics:
    """Kinematics and inverse dynamics of the robot over the rows of a plan; has MuJoCo data of its own."""

    def __init__(self, robot: Robot, legs: tuple[Leg, Leg]) -> None:
        self.robot = robot
        # A copy without contacts, limits and dry friction: the ground forces are planned.
        self.model = robot.compile()
        disable = mujoco.mjtDisableBit
        self.model.opt.disableflags |= int(disable.mjDSBL_CONSTRAINT)
        self.data = mujoco.MjData(self.model)
        self.torso = robot.torso_id
        self.leg_joints = np.array([[self.model.joint(robot.joint_names[i]).id for i in leg.indices] for leg in legs])
        self.leg_columns = np.stack([leg.indices for leg in legs])
        self.half_sizes = robot.sole_half_size
        self.mass = float(self.model.body_subtreemass[self.torso])

    def centre_of_mass(self, base: Float, q: Float) -> Float:
        """Centre of mass of each row, (T, 3) [m], for torso poses (T, 7) and joints (T, n)."""
        data, model = self.data, self.model
        com = np.empty((len(q), 3))
        rows = np.empty((len(q), model.nq))
        rows[:, :7] = base
        rows[:, self.robot.qpos_address] = q
        # Views, looked up once: an attribute of MjData costs as much as the kinematics of this robot.
        qpos, centre = data.qpos, data.subtree_com[self.torso]
        kinematics, centres = mujoco.mj_kinematics, mujoco.mj_comPos
        for row, found in zip(rows, com, strict=True):
            qpos[...] = row
            kinematics(model, data)
            centres(model, data)
            found[...] = centre
        return com

    def inverse(
        self,
        base: Float,
        base_velocity: Float,
        base_acceleration: Float,
        q: Float,
        qd: Float,
        qdd: Float,
        feet: Float,
        share: Float,
    ) -> tuple[Float, Float]:
        """Joint torques, and the zero-moment point of the whole body's dynamics.

        Args:
            base: torso poses (T, 7); base_velocity, base_acceleration: (T, 6), linear in the world, angular in the
                torso frame (MuJoCo's free joint) [m/s, rad/s, m/s², rad/s²].
            q, qd, qdd: (T, n).
            feet: sole centres and yaw, (T, 2, 4); share: load on the right foot, (T,) in [0, 1].

        Returns:
            torque (T, n) [N·m], and zmp (T, 2) [m] before it is bounded to the soles.
        """
        data, model, robot = self.data, self.model, self.robot
        rows = len(q)
        qpos, qvel, qacc = np.empty((rows, model.nq)), np.empty((rows, model.nv)), np.empty((rows, model.nv))
        qpos[:, :7], qpos[:, robot.qpos_address] = base, q
        qvel[:, :6], qvel[:, robot.dof_address] = base_velocity, qd
        qacc[:, :6], qacc[:, robot.dof_address] = base_acceleration, qdd
        force, passive_force = np.empty((rows, model.nv)), np.empty((rows, model.nv))
        all_axes, all_anchors = np.empty((rows, model.njnt, 3)), np.empty((rows, model.njnt, 3))
        position, velocity, acceleration, passive = data.qpos, data.qvel, data.qacc, data.qfrc_passive
        xaxis, xanchor = data.xaxis, data.xanchor
        kinematics, centres_of_mass, velocities = mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel
        passives, newton_euler = mujoco.mj_passive, mujoco.mj_rne
        lines = zip(qpos, qvel, qacc, force, passive_force, all_axes, all_anchors, strict=True)
        for q_row, v_row, a_row, found, passive_row, axes_row, anchors_row in lines:
            position[...], velocity[...], acceleration[...] = q_row, v_row, a_row
            if model.ntendon:
                mujoco.mj_inverse(model, data)
                found[...] = data.qfrc_inverse
            else:
                # What `mj_inverse` does, without the mass matrix, tendons, sensors and constraints: half of its time.
                kinematics(model, data)
                centres_of_mass(model, data)
                velocities(model, data)
                passives(model, data)
                newton_euler(model, data, 1, found)
                passive_row[...] = passive
            axes_row[...], anchors_row[...] = xaxis, xanchor
        if not model.ntendon:
            force += model.dof_armature * qacc - passive_force
        axes, anchors = (array.take(self.leg_joints, axis=1) for array in (all_axes, all_anchors))
        torque = force[:, robot.dof_address].copy()
        # Root rows: force in the world, moment in the torso frame about its origin.
        total = force[:, :3]
        moment = np.einsum("tij,tj->ti", matrices(base[:, 3:]), force[:, 3:6])
        moment = moment + cross(base[:, :3], total)
        zmp = np.column_stack([-moment[:, 1], moment[:, 0]]) / np.maximum(total[:, 2:], 1e-6)
        # From here on of both feet, (T, 2, ...).
        weights, centres = np.stack([1.0 - share, share], axis=1)[:, :, None], feet[:, :, :3]
        push = weights * total[:, None]
        turn = weights * (moment - cross(centres, push).sum(axis=1))[:, None]
        turn = self._inside_sole(turn, push[..., 2], feet[..., 3])
        at_joint = turn[:, :, None] + cross(centres[:, :, None] - anchors, push[:, :, None])
        torque[:, self.leg_columns] -= np.einsum("tsji,tsji->tsj", axes, at_joint)
        return torque, zmp

    def _inside_sole(self, moment: Float, load: Float, yaw: Float) -> Float:
        """Moments of the feet, bounded so that their centres of pressure are on the soles, (T, 2, 3) [N·m].

        Args:
            moment: about each sole's centre, in the world, (T, 2, 3) [N·m]; load: vertical force, (T, 2) [N].
            yaw: of the feet, (T, 2) [rad].
        """
        cos, sin = np.cos(yaw), np.sin(yaw)
        about_x = cos * moment[..., 0] + sin * moment[..., 1]
        about_y = cos * moment[..., 1] - sin * moment[..., 0]
        most_x, most_y = (half * np.maximum(load, 0.0) for half in (self.half_sizes[:, 1], self.half_sizes[:, 0]))
        about_x = np.minimum(np.maximum(about_x, -most_x), most_x)
        about_y = np.minimum(np.maximum(about_y, -most_y), most_y)
        return np.stack([cos * about_x - sin * about_y, sin * about_x + cos * about_y, moment[..., 2]], axis=-1)
