"""`GyroBias`: the zero-rate offset of the gyro, measured while the robot stands still."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.interface import RobotState

Float = NDArray[np.float64]

REST_S = 0.5
"""Length of the measurement [s]."""
_PARTS = 4
"""Rest is detected from the means over this many parts of the measurement. The gyro's noise moves such a mean by no
more than 0.002 rad/s. A mean hides shaking; the accelerometer shows it."""
_DRIFT = 0.012
"""Greatest difference between those means at rest [rad/s]: four times the noise of such a difference."""
_ACCEL_SPREAD = 0.3
"""Greatest standard deviation of an accelerometer axis at rest [m/s²]: six times the noise of consumer parts, 0.05."""
_GREATEST = 0.03
"""Greatest bias that is subtracted [rad/s], 1.7°/s. MEMS gyros are within that. Near its turning point a slow swing
looks like a constant rate; this bounds the error of mistaking one for a bias."""


class GyroBias:
    """Collects samples, then gives the bias or why it is not known; allocates nothing that grows.

    Attributes:
        bias: mean of the gyro over the measurement, (3,) [rad/s]; zero where it is not known.
        done: whether the measurement is over; `known`: whether the robot was at rest in it.
        reason: why the bias is not known.
    """

    def __init__(self, rate_hz: float) -> None:
        self.bias = np.zeros(3)
        self._samples = np.zeros((max(round(REST_S * rate_hz), _PARTS), 6))
        self.reset()

    def reset(self) -> None:
        """Begin a measurement; the bias of an earlier one holds until this one is done."""
        self._count, self.done, self.known, self.reason = 0, False, False, ""

    def update(self, measured: RobotState, *, has_imu: bool, hung: bool) -> None:
        """Take one reading of a robot that should stand still.

        Args:
            has_imu: whether the IMU answers.
            hung: whether the feet are in the air: the robot then swings, with a period longer than the measurement.
        """
        if not has_imu:
            self.give_up("no IMU")
        elif hung:
            self.give_up("the robot hangs")
        elif measured.imu_stale == 0:
            self.add(measured.gyro, measured.accel)

    def add(self, gyro: Float, accel: Float) -> None:
        """Take one sample of the IMU, (3,) each [rad/s, m/s²]."""
        if self.done:
            return
        sample = self._samples[self._count]
        sample[:3], sample[3:] = gyro, accel
        self._count += 1
        if self._count == len(self._samples):
            self._judge()

    def give_up(self, reason: str) -> None:
        """End the measurement without a result."""
        self.done, self.known, self.reason = True, False, reason
        self.bias[:] = 0.0

    def _judge(self) -> None:
        gyro, accel = self._samples[:, :3], self._samples[:, 3:]
        mean, parts = gyro.mean(axis=0), np.stack([part.mean(axis=0) for part in np.array_split(gyro, _PARTS)])
        greatest = float(np.abs(mean).max())
        if not (np.ptp(parts, axis=0).max() < _DRIFT and accel.std(axis=0).max() < _ACCEL_SPREAD):
            self.give_up("the robot did not stand still")
        elif greatest > _GREATEST:
            self.give_up(f"the gyro measures {greatest:.2f} rad/s, more than a bias is ({_GREATEST:g})")
        else:
            self.done = self.known = True
            self.bias[:] = mean
