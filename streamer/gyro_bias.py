"""The zero-rate offset of the gyro, measured while the robot stands still."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

REST_S = 0.5
"""How long the robot stands still for it [s]."""
_GYRO_SPREAD, _ACCEL_SPREAD = 0.03, 0.3
"""Greatest standard deviation of an axis at rest [rad/s, m/s²]: some times the noise of consumer parts, 0.005 and 0.05;
less than what a torso shows that sways or that is held by hand."""
_GREATEST = 0.35
"""Greatest offset that data sheets of consumer gyros allow, 20°/s; more is rotation [rad/s]."""


class GyroBias:
    """Collects samples of a rest, then knows the bias or that there was no rest; allocates nothing that grows.

    Attributes:
        bias: mean of the gyro over the rest, (3,) [rad/s]; zero where it is not known.
        done: whether the rest is over; `known` whether it was one.
    """

    def __init__(self, rate_hz: float) -> None:
        self.bias = np.zeros(3)
        self._samples = np.zeros((max(round(REST_S * rate_hz), 2), 6))
        self.reset()

    def reset(self) -> None:
        """A rest begins; what an earlier one told holds until it is over."""
        self._count, self.done, self.known = 0, False, False

    def add(self, gyro: Float, accel: Float) -> bool:
        """Take one sample of the IMU, (3,) each [rad/s, m/s²]; whether it was the last of the rest."""
        if self.done:
            return False
        sample = self._samples[self._count]
        sample[:3], sample[3:] = gyro, accel
        self._count += 1
        if self._count == len(self._samples):
            self._judge()
        return self.done

    def _judge(self) -> None:
        mean, spread = self._samples.mean(axis=0)[:3], self._samples.std(axis=0)
        quiet = spread[:3].max() < _GYRO_SPREAD and spread[3:].max() < _ACCEL_SPREAD
        self.done, self.known = True, bool(quiet and np.abs(mean).max() < _GREATEST)
        self.bias[:] = mean if self.known else 0.0
