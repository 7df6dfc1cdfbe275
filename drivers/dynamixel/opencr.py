"""OP3's OpenCR board on the servo bus: the switch of servo power, and its inertial sensor."""

from __future__ import annotations

import logging
import math

import numpy as np
from scipy.spatial.transform import Rotation

from configs.errors import DriverError
from configs.robot_file import Imu
from drivers.bus.servo_bus import ImuSample
from drivers.dynamixel.layout import Span
from drivers.dynamixel.registers import open_cr
from drivers.dynamixel.sdk import Client

NAME = "opencr"
"""What a robot file calls it."""

GRAVITY = 9.81

START_S = 1.0
"""Time that servos take after power was switched on (assumption) [s]."""

log = logging.getLogger(__name__)


class OpenCr(ImuSample):
    """The board with its address, and the newest sample of its sensor in the torso's frame.

    Attributes:
        id: its address.
        span: where gyroscope and accelerometer lie.
    """

    def __init__(self, imu: Imu) -> None:
        super().__init__()
        assert imu.id is not None
        self.id = imu.id
        file = open_cr()
        self._registers, self._model = file.registers, file.model_number
        self.span = Span(file.registers["gyro_x"].address, 12)
        units, axes = file.units, np.array(file.units.axes, np.float64)
        mount = Rotation.from_quat(imu.quaternion, scalar_first=True).as_matrix()
        self._gyro = mount * (axes * math.radians(units.gyro_deg_s))
        self._accel = mount * (axes * units.accel_g * GRAVITY)

    def audit(self, client: Client) -> bool:
        """Find it and switch the servos' power on; False where it does not answer. Raises `DriverError`."""
        model = client.ping(self.id)
        if model is None:
            return False
        if model != self._model:
            raise DriverError(
                f"port {client.line.path}: id {self.id} is no OpenCR board: model {model}, expected {self._model}"
            )
        if client.read(self.id, self._registers["dynamixel_power"]) != 1:
            log.info("OpenCR (id %d): power of the servos switched on", self.id)
            client.write(self.id, self._registers["dynamixel_power"], 1)
            client.line.sleep(START_S)
        return True

    def take(self, data: bytes) -> None:
        """The bytes of `span`."""
        raw = np.frombuffer(data, "<i2").astype(np.float64)
        np.matmul(self._gyro, raw[:3], out=self.gyro)
        np.matmul(self._accel, raw[3:], out=self.accel)
        self.fresh = True
