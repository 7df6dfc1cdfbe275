"""Joint torques of a planned motion under its planned ground forces.

Inverse dynamics gives the total wrench of the ground. It is divided between the feet by load, with each centre of
pressure as near to the middle of its sole as the total allows, and the legs' torques are reduced by it:
tau = (M q'' + h)_joints - sum_feet J^T w  (Featherstone 2008, *Rigid Body Dynamics Algorithms*, eq. 5.22).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import ANY, FLOATS, INTS, compiled, fields, packed
from flexmotion.configs.robot import Robot
from flexmotion.retarget.legs import Leg

Float = NDArray[np.float64]
Int = NDArray[np.int64]


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
        self._soles = packed(
            _Soles,
            joints=np.array([[self.model.joint(robot.joint_names[i]).id for i in leg.indices] for leg in legs]),
            columns=np.stack([leg.indices for leg in legs]),
            dofs=robot.dof_address,
            half_sizes=robot.sole_half_size,
        )
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
        return _divided(self._soles, force, base, all_axes, all_anchors, feet, share)


class _Soles(NamedTuple):
    """Whose torques the ground forces reduce.

    Attributes:
        joints, columns: of both legs, in the model and in the robot's order, (2, 6).
        dofs: of all joints of the robot, (n,).
        half_sizes: of both soles, (2, 2) [m].
    """

    joints: Int
    columns: Int
    dofs: Int
    half_sizes: Float


@compiled(fields(_Soles, *[INTS[2]] * 2, INTS[1], FLOATS[2]), FLOATS[2], ANY[2], *[FLOATS[3]] * 2, ANY[3], ANY[1])
def _divided(
    soles: _Soles, force: Float, base: Float, axes: Float, anchors: Float, feet: Float, share: Float
) -> tuple[Float, Float]:
    """Joint torques and zero-moment point of the whole body's dynamics; returns as `RobotDynamics.inverse`.

    Args:
        force: of all degrees of freedom, without the ground's, (T, nv); the root's: force in the world, moment in the
            torso frame about its origin.
        base, feet, share: as of `RobotDynamics.inverse`.
        axes, anchors: of all joints of the model, (T, njnt, 3).
    """
    rows, count = len(force), len(soles.dofs)
    torque, zmp = np.empty((rows, count)), np.empty((rows, 2))
    for t in range(rows):
        for joint in range(count):
            torque[t, joint] = force[t, soles.dofs[joint]]
        fx, fy, fz = force[t, 0], force[t, 1], force[t, 2]
        # About the world's origin: the moment turned by the quaternion w, x, y, z, and that of the force.
        w, x, y, z = base[t, 3], base[t, 4], base[t, 5], base[t, 6]
        mx, my, mz = force[t, 3], force[t, 4], force[t, 5]
        tx, ty, tz = 2.0 * (y * mz - z * my), 2.0 * (z * mx - x * mz), 2.0 * (x * my - y * mx)
        mx, my, mz = (
            mx + w * tx + y * tz - z * ty + base[t, 1] * fz - base[t, 2] * fy,
            my + w * ty + z * tx - x * tz + base[t, 2] * fx - base[t, 0] * fz,
            mz + w * tz + x * ty - y * tx + base[t, 0] * fy - base[t, 1] * fx,
        )
        load = max(fz, 1e-6)
        zmp[t, 0], zmp[t, 1] = -my / load, mx / load
        left = 1.0 - share[t]
        # What the feet's forces leave of the moment, divided as they are.
        for foot, part in ((0, left), (1, share[t])):
            cx, cy, cz = feet[t, foot, 0], feet[t, foot, 1], feet[t, foot, 2]
            mx -= part * (cy * fz - cz * fy)
            my -= part * (cz * fx - cx * fz)
            mz -= part * (cx * fy - cy * fx)
        for foot, part in ((0, left), (1, share[t])):
            px, py, pz = part * fx, part * fy, part * fz
            # Bounded so that the centre of pressure is on the sole.
            cos, sin = math.cos(feet[t, foot, 3]), math.sin(feet[t, foot, 3])
            most_x = soles.half_sizes[foot, 1] * max(pz, 0.0)
            most_y = soles.half_sizes[foot, 0] * max(pz, 0.0)
            about_x = min(max(part * (cos * mx + sin * my), -most_x), most_x)
            about_y = min(max(part * (cos * my - sin * mx), -most_y), most_y)
            turn_x, turn_y = cos * about_x - sin * about_y, sin * about_x + cos * about_y
            for k in range(soles.joints.shape[1]):
                joint = soles.joints[foot, k]
                lx = feet[t, foot, 0] - anchors[t, joint, 0]
                ly = feet[t, foot, 1] - anchors[t, joint, 1]
                lz = feet[t, foot, 2] - anchors[t, joint, 2]
                torque[t, soles.columns[foot, k]] -= (
                    axes[t, joint, 0] * (turn_x + ly * pz - lz * py)
                    + axes[t, joint, 1] * (turn_y + lz * px - lx * pz)
                    + axes[t, joint, 2] * (part * mz + lx * py - ly * px)
                )
    return torque, zmp
