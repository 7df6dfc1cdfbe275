"""`RandomErrors`: what servos and inertial sensors of simulated robots report wrongly, at random."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

OF_SERVO = ("false_position", "false_speed", "false_torque", "false_voltage", "false_temperature")
OF_IMU = ("false_gyro", "false_accel")
"""Kinds of false readings; faults of the emulator have the same names (`flexmotion.drivers.emulator.faults`)."""

RANDOM_SIZE = {
    "false_position": (16.0, 4096.0),
    "false_speed": (1.0, 100.0),
    "false_torque": (0.5, 50.0),
    "false_voltage": (0.5, 20.0),
    "false_temperature": (5.0, 200.0),
    "false_gyro": (1.0, 35.0),
    "false_accel": (5.0, 150.0),
}
"""Smallest and largest random error: [servo units], [rad/s], [N·m], [V], [°C], [rad/s], [m/s²]."""


@dataclass
class ServoError:
    """Errors of one reading of a servo, in its own direction: position [servo units], [rad/s], [N·m], [V], [°C]."""

    position: float = 0.0
    speed: float = 0.0
    torque: float = 0.0
    voltage: float = 0.0
    temperature: float = 0.0

    def add(self, kind: str, value: float) -> None:
        """Add the error of a fault of that kind."""
        name = kind.removeprefix("false_")
        setattr(self, name, getattr(self, name) + value)


@dataclass
class ImuError:
    """Errors of one reading of an inertial sensor, in the torso frame: [rad/s] and [m/s²], (3,) each."""

    gyro: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    accel: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    def add(self, kind: str, value: NDArray[np.float64] | float, axis: int | None = None) -> None:
        """Add an error of that kind to all axes or to one."""
        values = self.gyro if kind == "false_gyro" else self.accel
        values[slice(None) if axis is None else axis] += value


class RandomErrors:
    """Falsifies a share of readings. One value of such a reading is false.

    Which one, sign and size are random, the size evenly on a logarithmic scale between the bounds of `RANDOM_SIZE`.

    Args:
        share: of readings that are false.
        seed: equal ones give equal errors.

    Attributes:
        told: number of false readings so far, by kind.
    """

    def __init__(self, share: float = 0.0, seed: int = 0) -> None:
        self.share = share
        self.told = dict.fromkeys((*OF_SERVO, *OF_IMU), 0)
        self._random = np.random.default_rng(seed)

    def due(self) -> bool:
        """Whether the next reading is false."""
        return self.share > 0 and self._random.random() < self.share

    def of_servo(self, error: ServoError) -> None:
        """Make a reading of a servo false."""
        kind = OF_SERVO[self._random.integers(len(OF_SERVO))]
        self.told[kind] += 1
        error.add(kind, self._size(kind))

    def of_imu(self, error: ImuError) -> None:
        """Make a reading of an inertial sensor false, on one axis."""
        kind = OF_IMU[self._random.integers(len(OF_IMU))]
        self.told[kind] += 1
        axis = int(self._random.integers(3))
        error.add(kind, self._size(kind), axis)

    def _size(self, kind: str) -> float:
        low, high = (math.log(bound) for bound in RANDOM_SIZE[kind])
        return float(self._random.choice((-1.0, 1.0)) * math.exp(self._random.uniform(low, high)))
