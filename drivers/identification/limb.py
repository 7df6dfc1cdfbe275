"""`Limb`: the part of a robot that one joint moves, by the masses of its MJCF."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from flexmotion.configs.robot import Robot
from flexmotion.drivers.identification.record import RobotRecord

Float = NDArray[np.float64]

CUTOFF_HZ = 12.0
"""Low-pass of measured angles and of the IMU, before they are differentiated: above it a limb hardly moves [Hz]."""

_GRID_RAD, _CLEARANCE_RAD = 0.02, 0.06
"""Step of the search for self-contact, and distance that is kept from it [rad]."""


@dataclass(frozen=True)
class LimbLoad:
    """Along a motion, (N,) each: inertia about the joint [kg·m²], and torque at no acceleration of the joint [N·m].

    The servo's own inertia is not part of it. The equation of the joint is
    (armature + inertia) qdd + load = torque of the servo - friction.
    """

    inertia: Float
    load: Float


class Limb:
    """The bodies beyond a joint, as a load of its servo.

    Attributes:
        robot, joint: the robot, and the index of the joint.
    """

    def __init__(self, robot: Robot, joint: int) -> None:
        self.robot, self.joint = robot, joint
        self._model = robot.compile()
        self._model.dof_armature[:] = 0.0
        self._data = mujoco.MjData(self._model)
        self._dof = int(robot.dof_address[joint])
        self._joint_id = self._model.joint(robot.joint_names[joint]).id
        self._root_dof = int(self._model.jnt_dofadr[self._model.body_jntadr[robot.torso_id]])

    def along(self, record: RobotRecord) -> LimbLoad:
        """The load along a measured motion, of all joints and of the torso (by its IMU). One stretch without gaps."""
        robot, dt = self.robot, 1.0 / self.robot.rate_hz
        time = np.arange(record.time[0], record.time[-1] + 0.5 * dt, dt)
        position = np.column_stack([_resampled(record, joint, time) for joint in range(robot.n)])
        position = _smooth(position, robot.rate_hz)
        velocity = np.gradient(position, dt, axis=0)
        acceleration = np.gradient(velocity, dt, axis=0)
        acceleration[:, self.joint] = 0.0
        turning = _smooth(_on(time, record.time, np.nan_to_num(record.gyro)), robot.rate_hz)
        turning_rate = np.gradient(turning, dt, axis=0)
        force = _smooth(_on(time, record.time, record.specific_force()), robot.rate_hz)
        imu = robot.config.imu
        if imu is not None and imu.body == robot.config.torso:
            arm = np.array(imu.position)
            force -= np.cross(turning_rate, arm) + np.cross(turning, np.cross(turning, arm))
        inertia, load = np.empty(len(time)), np.empty(len(time))
        for k in range(len(time)):
            self._place(position[k], velocity[k], turning[k], gravity=-force[k])
            inertia[k], load[k] = self._inverse(acceleration[k], turning_rate[k])
        return LimbLoad(np.interp(record.time, time, inertia), np.interp(record.time, time, load))

    def at(self, pose: Float, angles: Float, gravity: Float) -> LimbLoad:
        """The load at rest with this joint at each of `angles`, (N,), and the others at `pose`, (n,) [rad].

        `gravity` is in the torso frame, (3,) [m/s²].
        """
        inertia, load = np.empty(len(angles)), np.empty(len(angles))
        still, position = np.zeros(self.robot.n), pose.copy()
        for k, angle in enumerate(angles):
            position[self.joint] = angle
            self._place(position, still, np.zeros(3), gravity)
            inertia[k], load[k] = self._inverse(still, np.zeros(3))
        return LimbLoad(inertia, load)

    def reach(self, pose: Float) -> float:
        """Greatest distance of a point of the limb from the joint's axis, at `pose` (n,) [m]."""
        model, data = self._model, self._data
        self._place(pose, np.zeros(self.robot.n), np.zeros(3), np.zeros(3))
        anchor, axis = data.xanchor[self._joint_id], data.xaxis[self._joint_id]
        away = data.geom_xpos[self._geoms()] - anchor
        distance = np.linalg.norm(away - np.outer(away @ axis, axis), axis=1)
        return float((distance + model.geom_rbound[self._geoms()]).max(initial=0.0))

    def free_range(self, pose: Float) -> tuple[float, float]:
        """Range of the joint around `pose` (n,) within its limits and clear of the robot's other bodies [rad].

        A clearance is kept from contacts. Contacts that exist at the pose are not counted: the bodies hang so.
        """
        lower, upper = float(self.robot.lower[self.joint]), float(self.robot.upper[self.joint])
        start = float(np.clip(pose[self.joint], lower, upper))
        known = self._contacts(pose, start)
        ends = []
        for limit, step in ((lower, -_GRID_RAD), (upper, _GRID_RAD)):
            angle, end = start, limit
            while (limit - angle) * step > 0:
                angle += step
                if self._contacts(pose, angle) - known:
                    end = angle - step - np.sign(step) * _CLEARANCE_RAD
                    break
            ends.append(end)
        return float(min(ends[0], start)), float(max(ends[1], start))

    # ---------------------------------------------------------------- inside

    def _place(self, position: Float, velocity: Float, turning: Float, gravity: Float) -> None:
        """Joints and torso, in a frame that moves with the torso: its acceleration is part of `gravity`."""
        model, data, root = self._model, self._data, self._root_dof
        address = int(model.jnt_qposadr[model.body_jntadr[self.robot.torso_id]])
        data.qpos[address : address + 7] = (0, 0, 0, 1, 0, 0, 0)
        data.qpos[self.robot.qpos_address] = position
        data.qvel[:] = 0.0
        data.qvel[root + 3 : root + 6] = turning
        data.qvel[self.robot.dof_address] = velocity
        model.opt.gravity[:] = gravity
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)

    def _inverse(self, acceleration: Float, turning_rate: Float) -> tuple[float, float]:
        """Inertia about the joint and torque at `acceleration` of the joints, by recursive Newton-Euler."""
        model, data, force = self._model, self._data, np.zeros(self._model.nv)
        data.qacc[:] = 0.0
        data.qacc[self._root_dof + 3 : self._root_dof + 6] = turning_rate
        data.qacc[self.robot.dof_address] = acceleration
        mujoco.mj_rne(model, data, 1, force)
        load = float(force[self._dof])
        data.qacc[self._dof] += 1.0
        mujoco.mj_rne(model, data, 1, force)
        return float(force[self._dof]) - load, load

    def _geoms(self) -> list[int]:
        """Shapes of the bodies that the joint moves."""
        model = self._model
        first = int(model.jnt_bodyid[self._joint_id])
        moved: set[int] = set()
        for body in range(first, model.nbody):  # a body comes after its parent
            if body == first or int(model.body_parentid[body]) in moved:
                moved.add(body)
        return [geom for geom in range(model.ngeom) if int(model.geom_bodyid[geom]) in moved]

    def _contacts(self, pose: Float, angle: float) -> set[tuple[int, int]]:
        """Pairs of bodies that touch with the joint at an angle."""
        model, data = self._model, self._data
        position = pose.copy()
        position[self.joint] = angle
        self._place(position, np.zeros(self.robot.n), np.zeros(3), np.zeros(3))
        mujoco.mj_collision(model, data)
        pairs = model.geom_bodyid[data.contact.geom]
        return {(int(min(pair)), int(max(pair))) for pair in pairs}


def _resampled(record: RobotRecord, joint: int, time: Float) -> Float:
    good = record.believed(joint)
    if not good.any():
        return np.zeros(len(time))
    return np.interp(time, record.time[good], record.position[good, joint])


def _on(time: Float, known: Float, values: Float) -> Float:
    return np.column_stack([np.interp(time, known, column) for column in values.T])


def _smooth(values: Float, rate_hz: float) -> Float:
    """Low-pass without delay, along the first axis."""
    if 0.45 * rate_hz <= CUTOFF_HZ:
        return values
    sos = butter(2, CUTOFF_HZ, fs=rate_hz, output="sos")
    return np.asarray(sosfiltfilt(sos, values, axis=0, padlen=min(30, len(values) - 1)))
