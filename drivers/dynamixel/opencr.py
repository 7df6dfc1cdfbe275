"""`OpenCr`: the controller board of OP3 on the servo bus, with the servos' power switch and an inertial sensor."""

from __future__ import annotations

import logging
import math

import numpy as np

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.configs.robot_file import Imu as ImuConfig
from flexmotion.drivers.dynamixel.layout import Span
from flexmotion.drivers.dynamixel.registers import open_cr
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.imu.interface import Imu
from flexmotion.spatial.gravity import GRAVITY

START_S = 1.0
"""Time that servos need after power is switched on (assumption) [s]."""

log = logging.getLogger(__name__)


class OpenCr(Imu):
    """The board. Its bus reads it with the servos and passes it the answers.

    Attributes:
        id: its address.
        span: of the gyroscope's and accelerometer's registers.
    """

    name = "opencr"

    def __init__(self, config: ImuConfig) -> None:
        super().__init__(config)
        assert config.id is not None
        self.id = config.id
        file = open_cr()
        self._registers, self._model = file.registers, file.model_number
        self.span = Span(file.registers["gyro_x"].address, 12)
        units, axes = file.units, np.array(file.units.axes, np.float64)
        # Angular velocity and specific force, in one product.
        self._to_units = np.zeros((6, 6))
        self._to_units[:3, :3] = self.mount * (axes * math.radians(units.gyro_deg_s))
        self._to_units[3:, 3:] = self.mount * (axes * units.accel_g * GRAVITY)
        self._raw, self._sample = np.zeros(6), np.concatenate([self.gyro, self.accel])
        self.gyro, self.accel = self._sample[:3], self._sample[3:]
        self._came = False

    def find(self, client: Client) -> DriverError | None:
        """Look for the board; the error to report if it does not answer, else None.

        Raises:
            DriverError: another device answers at its address.
        """
        where, model = f"port {client.line.path}", client.ping(self.id)
        if model is None:
            return DriverError(f"{where}: no OpenCR board answers at id {self.id}")
        if model != self._model:
            raise DriverError(f"{where}: id {self.id} is not an OpenCR board: model {model}, expected {self._model}")
        return None

    def audit(self, client: Client) -> None:
        """Switch the servos' power on. Raises `DriverError` if the board refuses."""
        if not self.powered(client):
            log.info("OpenCR (id %d): power of the servos switched on", self.id)
            client.write(self.id, self._registers["dynamixel_power"], 1)
            client.line.sleep(START_S)

    def powered(self, client: Client) -> bool:
        """Whether the servos' power is switched on."""
        return client.read(self.id, self._registers["dynamixel_power"]) == 1

    def forget(self) -> None:
        """Start of a tick: the last sample is no longer fresh."""
        self._came = False

    def take(self, data: bytes) -> None:
        """Take the bytes of `span`, received in this tick."""
        self._raw[:] = np.frombuffer(data, "<i2")
        np.matmul(self._to_units, self._raw, out=self._sample)
        self._came = True

    def read(self, now: float) -> bool:
        """See `Imu`. The bus has passed the answer to `take`."""
        return self._came


def board_of(robot: Robot, bus: str) -> OpenCr | None:
    """The board on a bus of a robot; None if the robot file names none there."""
    imu = robot.config.imu
    if imu is None or imu.driver != OpenCr.name or imu.bus != bus or imu.id is None:
        return None
    return OpenCr(imu)
