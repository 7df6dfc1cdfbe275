"""The zero-rate offset of the gyro, measured while the robot stands still."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

REST_S = 0.5
"""How long the robot stands still for it [s]."""
_PARTS = 4
"""The rest is judged by the means of so many parts, in which the gyro's noise is no more than 0.002 rad/s; what a mean
over a part hides is shaking, which the accelerometer shows."""
_DRIFT = 0.012
"""Greatest difference between those means, as much as four times their noise [rad/s]."""
_ACCEL_SPREAD = 0.3
"""Greatest standard deviation of an axis at rest [m/s²]: some times the noise of consumer parts, 0.05."""
_GREATEST = 0.03
"""Greatest offset that is taken out, 1.7°/s [rad/s]. MEMS gyros are within that; near the turning point of its speed a
slow swing looks like a constant rate, and this bounds what could be mistaken for a bias."""


class GyroBias:
    """Collects samples of a rest, then knows the bias or why there is none; allocates nothing that grows.

    Attributes:
        bias: mean of the gyro over the rest, (3,) [rad/s]; zero where it is not known.
        done: whether the rest is over; `known` whether it was one.
        reason: why the bias is not known.
    """

    def __init__(self, rate_hz: float) -> None:
        self.bias = np.zeros(3)
        self._samples = np.zeros((max(round(REST_S * rate_hz), _PARTS), 6))
        self.reset()

    def reset(self) -> None:
        """A rest begins; what an earlier one told holds until it is over."""
        self._count, self.done, self.known, self.reason = 0, False, False, ""

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
        """There is no rest: the bias is not known."""
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
