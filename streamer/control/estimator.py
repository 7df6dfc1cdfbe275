"""`Estimator`: tilt, centre of mass and its divergent component, from encoders, IMU and stance foot.

The tilt of the torso comes from the IMU. The rest of its pose comes from the stance foot, which is assumed to stand
where the plan placed it.
"""

from __future__ import annotations

import math

import imufusion
import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import RobotState
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.control.reference import Reference

Float = NDArray[np.float64]

_AHRS_GAIN = 0.4
"""Weight of the accelerometer against the gyroscope: the gyroscope's bias acts over seconds, impacts of steps over
tenths of one."""
_VELOCITY_CUTOFF_HZ = 12.0
"""Low-pass of the centre of mass's velocity, since encoder speeds are coarse [Hz]."""

_MISSED_S = 0.3
"""Time without samples of the IMU over which the torso is taken to have turned at the mean of its speeds before and
after [s]; in a fall by 30 degrees. After a longer one the accelerometer alone leads the attitude back."""
_LEAST_COSINE = 0.2
"""Of the torso's pitch; beyond it the robot lies, and has no heading to speak of."""


class Estimator:
    """Fills its attributes each tick; allocates nothing that grows.

    Args:
        omega: natural frequency of the linear inverted pendulum [1/s].

    Attributes:
        tilt: roll and pitch of the torso, (2,) [rad]; tilt_rate: their rates, (2,) [rad/s].
        com, dcm: horizontal centre of mass and its divergent component in the plan's world, (2,) [m].
        odometry: way of the centre of mass, x and y [m], and turn of the torso [rad] since `reset`, (3,); from the
            gyroscope (without one from the stance foot) and the joints' speeds, so that it drifts slowly.
        leg_axes: axes of each leg's joints in the plan's world, (2, 6, 3).
        has_imu: whether the tilt is measured; else it is the reference's.
        gyro_bias: is subtracted from what the gyro measures, (3,) [rad/s]; set by the loop.
    """

    def __init__(self, robot: Robot, omega: float) -> None:
        self.robot, self.omega, self.dt = robot, omega, 1.0 / robot.rate_hz
        self.model = robot.model
        self.data = mujoco.MjData(self.model)
        self.ahrs = imufusion.Ahrs()
        settings = imufusion.AhrsSettings()
        settings.convention = imufusion.CONVENTION_NWU
        settings.gain = _AHRS_GAIN
        settings.sample_rate = robot.rate_hz
        self.ahrs.set_settings(settings)
        self.legs = [
            np.array([self.model.joint(robot.joint_names[i]).id for i in robot.chain(f"{side}_leg").values()])
            for side in ("left", "right")
        ]
        self._patience = robot.safety.max_stale_reads
        self.has_imu = False
        self.gyro_bias, self._gyro = np.zeros(3), np.zeros(3)
        self._before, self._missed = np.zeros(3), 0  # what the gyro measured last, and ticks since
        self.tilt, self.tilt_rate = np.zeros(2), np.zeros(2)
        self.com, self.dcm = np.zeros(2), np.zeros(2)
        self.com_velocity = np.zeros(2)
        self.odometry = np.zeros(3)
        self.leg_axes = np.zeros((2, 6, 3))
        self._smoothing = 1.0 - np.exp(-2 * np.pi * _VELOCITY_CUTOFF_HZ * self.dt)
        self._spatial, self._euler = np.zeros(6), np.zeros(3)

    @property
    def tilt_angle(self) -> float:
        """Angle between the torso's up axis and the world's [rad], 0 to pi, from roll and pitch."""
        roll, pitch = self.tilt
        return math.acos(math.cos(roll) * math.cos(pitch))

    def reset(self) -> None:
        """Set speeds and the way to zero for a new run; the attitude is kept, since the IMU measures on."""
        self.com_velocity[:] = 0.0
        self.odometry[:] = 0.0

    def begin_attitude(self, accel: Float) -> None:
        """Begin the attitude anew, from the specific force of a torso at rest, (3,) [m/s²]."""
        ahead, left, up = accel.tolist()
        self._euler[:] = 0.0, math.atan2(-ahead, math.hypot(left, up)), math.atan2(left, up)
        quaternion = np.zeros(4)
        mujoco.mju_euler2Quat(quaternion, self._euler, "zyx")
        self.ahrs.set_quaternion(quaternion)

    def update(self, state: RobotState, reference: Reference) -> None:
        """Update from one measurement and the reference that was in force when it was made."""
        # For a few missed samples the last attitude holds; after that it is not trusted.
        self.has_imu = state.imu_stale == 0 or (self.has_imu and 0 < state.imu_stale <= self._patience)
        if state.imu_stale == 0:
            self._take(state)
        else:
            self._missed += 1
        if self.has_imu:
            quaternion = self.ahrs.get_quaternion()
            self.tilt[:] = roll_pitch(quaternion)
            self.tilt_rate[:] = self._gyro[:2]
            self.odometry[2] += self._turning() * self.dt
        else:
            self.tilt[:], self.tilt_rate[:] = roll_pitch(reference.base[3:]), 0.0
        if reference.balanced:
            self._anchor(state, reference)

    def _take(self, state: RobotState) -> None:
        """Update the attitude by a sample, and by the turn since the last one."""
        np.copyto(self._before, self._gyro)
        np.subtract(state.gyro, self.gyro_bias, out=self._gyro)
        turned = np.degrees(self._gyro)
        if 0 < self._missed <= _MISSED_S * self.robot.rate_hz:
            turned += 0.5 * self._missed * np.degrees(self._before + self._gyro)
        self._missed = 0
        self.ahrs.update_no_magnetometer(turned, state.accel / GRAVITY)

    def _turning(self) -> float:
        """Rate of the torso's heading by the gyroscope [rad/s], z-y-x order.

        The heading of the attitude is of no use: the filter holds it at zero in its first seconds.
        """
        roll, pitch = self.tilt
        about_z = self._gyro[1] * math.sin(roll) + self._gyro[2] * math.cos(roll)
        return float(about_z / max(math.cos(pitch), _LEAST_COSINE))

    def _anchor(self, state: RobotState, reference: Reference) -> None:
        model, data, robot = self.model, self.data, self.robot
        data.qpos[:3] = 0.0
        self._euler[1:] = self.tilt[1], self.tilt[0]
        mujoco.mju_euler2Quat(data.qpos[3:7], self._euler, "zyx")
        data.qpos[robot.qpos_address] = state.position
        data.qvel[:3] = 0.0
        data.qvel[3:6] = self._gyro if self.has_imu else 0.0
        data.qvel[robot.dof_address] = state.velocity
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_subtreeVel(model, data)
        com, speed = data.subtree_com[robot.torso_id], data.subtree_linvel[robot.torso_id]
        weights = (1.0 - reference.share, reference.share)
        self.com[:] = 0.0
        velocity = np.zeros(2)
        ahead = aside = turning = 0.0
        for side, body in enumerate(robot.foot_ids):
            rotation = data.xmat[body].reshape(3, 3)
            arm = rotation @ robot.soles[side]
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, self._spatial, 0)
            wx, wy, wz = self._spatial[:3]
            drift_x = speed[0] - self._spatial[3] - (wy * arm[2] - wz * arm[1])
            drift_y = speed[1] - self._spatial[4] - (wz * arm[0] - wx * arm[2])
            yaw = reference.feet[side, 3] - math.atan2(rotation[1, 0], rotation[0, 0])
            cos, sin = math.cos(yaw), math.sin(yaw)
            away = com - data.xpos[body] - arm
            weight = weights[side]
            self.com[0] += weight * (reference.feet[side, 0] + cos * away[0] - sin * away[1])
            self.com[1] += weight * (reference.feet[side, 1] + sin * away[0] + cos * away[1])
            velocity[0] += weight * (cos * drift_x - sin * drift_y)
            velocity[1] += weight * (sin * drift_x + cos * drift_y)
            ahead, aside, turning = ahead + weight * drift_x, aside + weight * drift_y, turning - weight * wz
            axes = data.xaxis[self.legs[side]]
            self.leg_axes[side, :, 0] = cos * axes[:, 0] - sin * axes[:, 1]
            self.leg_axes[side, :, 1] = sin * axes[:, 0] + cos * axes[:, 1]
            self.leg_axes[side, :, 2] = axes[:, 2]
        if not self.has_imu:
            self.odometry[2] += turning * self.dt
        cos, sin = math.cos(self.odometry[2]), math.sin(self.odometry[2])
        self.odometry[0] += (cos * ahead - sin * aside) * self.dt
        self.odometry[1] += (sin * ahead + cos * aside) * self.dt
        self.com_velocity += self._smoothing * (velocity - self.com_velocity)
        self.dcm[:] = self.com + self.com_velocity / self.omega


def roll_pitch(quaternion: Float) -> tuple[float, float]:
    """Roll and pitch [rad] of a quaternion w x y z, yaw taken out (z-y-x order)."""
    w, x, y, z = quaternion
    sine = min(max(2 * (w * y - z * x), -1.0), 1.0)
    return math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), math.asin(sine)


def planned_tilt_rate(planned: Reference, dt: float) -> Float:
    """Rates of roll and pitch of the torso that a plan has from this row to the next, (2,) [rad/s]; else 0.

    Args:
        dt: time of a row [s].
    """
    if not planned.balanced:
        return np.zeros(2)
    found: Float = np.subtract(roll_pitch(planned.base_after[3:]), roll_pitch(planned.base[3:])) / dt
    return found


def yaw_of(quaternion: Float) -> float:
    """Yaw [rad] of a quaternion w x y z (z-y-x order)."""
    w, x, y, z = quaternion
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
