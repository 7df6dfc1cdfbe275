"""OP3's OpenCR board on the servo bus: the switch of servo power, and its inertial sensor."""

from __future__ import annotations

import logging
import math

import numpy as np

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot_file import Imu as ImuConfig
from flexmotion.drivers.dynamixel.layout import Span
from flexmotion.drivers.dynamixel.registers import open_cr
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.imu.interface import Imu
from flexmotion.drivers.interface import GRAVITY

START_S = 1.0
"""Time that servos take after power was switched on (assumption) [s]."""

log = logging.getLogger(__name__)


class OpenCr(Imu):
    """The board with its address; its bus asks it with the servos and hands it the answers.

    Attributes:
        id: its address.
        span: where gyroscope and accelerometer lie.
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
        self._to_gyro = self.mount * (axes * math.radians(units.gyro_deg_s))
        self._to_accel = self.mount * (axes * units.accel_g * GRAVITY)
        self._came = False

    def find(self, client: Client) -> DriverError | None:
        """None where it is there, else what to say of its absence.

        Raises:
            DriverError: something else answers at its address.
        """
        where, model = f"port {client.line.path}", client.ping(self.id)
        if model is None:
            return DriverError(f"{where}: no OpenCR board answers at id {self.id}")
        if model != self._model:
            raise DriverError(f"{where}: id {self.id} is no OpenCR board: model {model}, expected {self._model}")
        return None

    def audit(self, client: Client) -> None:
        """Switch the servos' power on. Raises `DriverError` where it does not take that."""
        if client.read(self.id, self._registers["dynamixel_power"]) != 1:
            log.info("OpenCR (id %d): power of the servos switched on", self.id)
            client.write(self.id, self._registers["dynamixel_power"], 1)
            client.line.sleep(START_S)

    def forget(self) -> None:
        """A tick begins: what came before is no answer in it."""
        self._came = False

    def take(self, data: bytes) -> None:
        """The bytes of `span`, as they came in answer to this tick's question."""
        raw = np.frombuffer(data, "<i2").astype(np.float64)
        np.matmul(self._to_gyro, raw[:3], out=self.gyro)
        np.matmul(self._to_accel, raw[3:], out=self.accel)
        self._came = True

    def read(self, now: float) -> bool:
        """See `Imu`; its bus has taken what came."""
        return self._came
