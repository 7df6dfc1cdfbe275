"""`OpenCr`: the controller board of OP3 on an emulated bus, with its inertial sensor and the servos' power switch."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot_file import Quaternion
from flexmotion.drivers.dynamixel.registers import VOLTAGE, open_cr
from flexmotion.drivers.emulator.body import Body
from flexmotion.drivers.emulator.device import Device
from flexmotion.drivers.emulator.false_readings import FalseReadings
from flexmotion.spatial.gravity import GRAVITY

FIRMWARE = 5


class OpenCr(Device):
    """The board. While its power switch is off, the servos are off.

    Args:
        body: that carries it.
        mount: orientation of the sensor in the body, as in the robot file, w x y z.
        powered: initial state of the power switch.
        false_readings: what its sensor reports wrongly.
    """

    def __init__(
        self,
        body: Body,
        id_: int,
        mount: Quaternion = (1.0, 0.0, 0.0, 0.0),
        *,
        powered: bool = True,
        false_readings: FalseReadings | None = None,
    ) -> None:
        self.body = body
        self._false = FalseReadings() if false_readings is None else false_readings
        file = open_cr()
        super().__init__(file.table, id_, file.model_number, FIRMWARE)
        units = file.units
        axes = np.array(units.axes, float)
        self._gyro_scale = axes / math.radians(units.gyro_deg_s)
        self._accel_scale = axes / (units.accel_g * GRAVITY)
        self._first = file.registers["gyro_x"].address
        self._raw = np.zeros(6)
        self._unmount = Rotation.from_quat(mount, scalar_first=True).as_matrix().T
        self.put("dynamixel_power", int(powered))

    @property
    def powered(self) -> bool:
        """Whether the servos have power."""
        return self.get("dynamixel_power") == 1

    def refresh(self, now: float) -> None:
        """Update the measurements in the table, clipped to 16 bits."""
        body, raw = self.body, self._raw
        body.sense()
        error = self._false.of_imu()
        gyro, accel = (body.gyro, body.accel) if error is None else (body.gyro + error.gyro, body.accel + error.accel)
        np.multiply(self._unmount @ gyro, self._gyro_scale, out=raw[:3])
        np.multiply(self._unmount @ accel, self._accel_scale, out=raw[3:])
        np.rint(raw, out=raw)
        np.clip(raw, -32768, 32767, out=raw)
        self.memory[self._first : self._first + 12] = raw.astype("<i2").tobytes()
        self.put("voltage", min(round(body.plant.voltage / VOLTAGE), 255))
