"""False readings: what the devices of an emulated robot report instead of what is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.emulator.faults import FALSE_OF_IMU, FALSE_OF_SERVO, Fault, FaultKind

RANDOM_SIZE = {
    FaultKind.FALSE_POSITION: (16.0, 4096.0),
    FaultKind.FALSE_SPEED: (1.0, 100.0),
    FaultKind.FALSE_TORQUE: (0.5, 50.0),
    FaultKind.FALSE_VOLTAGE: (0.5, 20.0),
    FaultKind.FALSE_TEMPERATURE: (5.0, 200.0),
    FaultKind.FALSE_GYRO: (1.0, 35.0),
    FaultKind.FALSE_ACCEL: (5.0, 150.0),
}
"""Smallest and largest random error, in the units of `flexmotion.drivers.emulator.faults.MEANING`."""


@dataclass
class ServoError:
    """Errors of one reading of a servo, in its own direction: position [servo units], [rad/s], [N·m], [V], [°C]."""

    position: float = 0.0
    speed: float = 0.0
    torque: float = 0.0
    voltage: float = 0.0
    temperature: float = 0.0

    def add(self, kind: FaultKind, value: float) -> None:
        """Add the error of a fault of that kind."""
        name = kind.removeprefix("false_")
        setattr(self, name, getattr(self, name) + value)


@dataclass
class ImuError:
    """Errors of one reading of an inertial sensor, in the torso frame: [rad/s] and [m/s²], (3,) each."""

    gyro: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    accel: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))


class FalseReadings:
    """Falsifies the readings of all devices of a robot: by faults that act now, and a share of readings at random.

    A reading is one answer of one device. The device itself, its control loop and its protections, knows the truth.

    Args:
        share: of readings that are false at random. One value of such a reading is false: which one, sign and size are
            random, the size evenly on a logarithmic scale between the bounds of `RANDOM_SIZE`.
        seed: of the random errors.

    Attributes:
        told: number of false readings so far, by kind.
    """

    def __init__(self, share: float = 0.0, seed: int = 0) -> None:
        self.share = share
        self.told = dict.fromkeys((*FALSE_OF_SERVO, *FALSE_OF_IMU), 0)
        self._random = np.random.default_rng(seed)
        self._of_servo: dict[int, list[Fault]] = {}
        self._of_imu: list[Fault] = []
        self._spent: list[Fault] = []

    def act(self, faults: Iterable[Fault], joint_of: Mapping[Fault, int]) -> None:
        """Set the active faults; `joint_of`: index of the joint that a fault of a servo names."""
        acting = [fault for fault in faults if not any(fault is spent for spent in self._spent)]
        self._of_imu = [fault for fault in acting if fault.kind in FALSE_OF_IMU]
        self._of_servo = {}
        for fault in acting:
            if fault.kind in FALSE_OF_SERVO:
                self._of_servo.setdefault(joint_of[fault], []).append(fault)

    def of_servo(self, joint: int) -> ServoError | None:
        """Errors of the reading that the servo of a joint makes now; None: it is true."""
        acting, at_random = self._of_servo.get(joint), self._at_random()
        if not acting and not at_random:
            return None
        error = ServoError()
        for fault in acting or ():
            self._tell(fault)
            error.add(fault.kind, fault.value)
        self._of_servo[joint] = [fault for fault in acting or () if not fault.once]
        if at_random:
            kind = FALSE_OF_SERVO[self._random.integers(len(FALSE_OF_SERVO))]
            self.told[kind] += 1
            error.add(kind, self._size(kind))
        return error

    def of_imu(self) -> ImuError | None:
        """Errors of the reading that the inertial sensor makes now; None: it is true."""
        acting, at_random = self._of_imu, self._at_random()
        if not acting and not at_random:
            return None
        error = ImuError()
        for fault in acting:
            self._tell(fault)
            (error.gyro if fault.kind is FaultKind.FALSE_GYRO else error.accel)[:] += fault.argument
        self._of_imu = [fault for fault in acting if not fault.once]
        if at_random:
            kind = FALSE_OF_IMU[self._random.integers(len(FALSE_OF_IMU))]
            self.told[kind] += 1
            axis = int(self._random.integers(3))
            (error.gyro if kind is FaultKind.FALSE_GYRO else error.accel)[axis] += self._size(kind)
        return error

    def _at_random(self) -> bool:
        return self.share > 0 and self._random.random() < self.share

    def _size(self, kind: FaultKind) -> float:
        low, high = (math.log(bound) for bound in RANDOM_SIZE[kind])
        return float(self._random.choice((-1.0, 1.0)) * math.exp(self._random.uniform(low, high)))

    def _tell(self, fault: Fault) -> None:
        self.told[fault.kind] += 1
        if fault.once:
            self._spent.append(fault)
