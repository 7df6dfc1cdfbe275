"""The simulated inertial sensor: MuJoCo's gyro and accelerometer, band-limited, with constant bias and white noise."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot_file import Imu
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

SENSORS = ("gyro", "accel")
"""Names of its sensors in the model; they are consecutive in `sensordata`."""


class SimImu:
    """Angular velocity and specific force in the frame of the body that carries the sensor.

    Attributes:
        sample: newest measurement in the sensor's frame, band-limited, without noise and bias: gyro, then accel, (6,).
    """

    def __init__(self, config: Imu, model: mujoco.MjModel, options: SimOptions, rng: np.random.Generator) -> None:
        self.sample = np.zeros(6)
        self._mount = Rotation.from_quat(config.quaternion, scalar_first=True).as_matrix()
        first = int(model.sensor(SENSORS[0]).adr[0])
        self._sensors = slice(first, first + 6)
        self._blend = 1.0 - math.exp(-2 * math.pi * options.imu_bandwidth_hz * options.timestep)
        self._noise = np.repeat([options.gyro_noise, options.accel_noise], 3) * options.noise_scale
        spread = np.repeat([options.gyro_bias, options.accel_bias], 3) * options.noise_scale
        self._rng = rng
        self._bias = spread * rng.standard_normal(6)
        self._reading, self._raw = np.zeros(6), np.zeros(6)

    def reset(self, up: Float) -> None:
        """Start at rest; `up` is the world's up in the frame of the carrying body, (3,)."""
        self.sample[:3] = 0.0
        self.sample[3:] = GRAVITY * self._mount.T @ up

    def step(self, data: mujoco.MjData) -> None:
        """Update `sample` after a physics step."""
        np.subtract(data.sensordata[self._sensors], self.sample, out=self._raw)
        self._raw *= self._blend
        self.sample += self._raw

    def read(self, sample: Float, gyro: Float, accel: Float) -> None:
        """Add noise and bias to a (possibly older) `sample`; write the result to `gyro` and `accel`, (3,) each."""
        self._rng.standard_normal(out=self._reading)
        self._reading *= self._noise
        self._reading += self._bias
        self._reading += sample
        np.matmul(self._mount, self._reading[:3], out=gyro)
        np.matmul(self._mount, self._reading[3:], out=accel)
