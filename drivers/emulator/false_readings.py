"""False readings: what the devices of an emulated robot report instead of what is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from flexmotion.drivers.emulator.faults import FALSE_OF_IMU, FALSE_OF_SERVO, Fault
from flexmotion.drivers.random_errors import ImuError, RandomErrors, ServoError


class FalseReadings:
    """Falsifies the readings of all devices of a robot: by faults that act now, and a share of readings at random.

    A reading is one answer of one device. The device itself, its control loop and its protections, knows the truth.

    Args:
        share, seed: of the random errors, see `RandomErrors`.

    Attributes:
        told: number of false readings so far, by kind.
    """

    def __init__(self, share: float = 0.0, seed: int = 0) -> None:
        self._at_random = RandomErrors(share, seed)
        self.told = self._at_random.told
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
        acting, at_random = self._of_servo.get(joint), self._at_random.due()
        if not acting and not at_random:
            return None
        error = ServoError()
        for fault in acting or ():
            self._tell(fault)
            error.add(fault.kind, fault.value)
        self._of_servo[joint] = [fault for fault in acting or () if not fault.once]
        if at_random:
            self._at_random.of_servo(error)
        return error

    def of_imu(self) -> ImuError | None:
        """Errors of the reading that the inertial sensor makes now; None: it is true."""
        acting, at_random = self._of_imu, self._at_random.due()
        if not acting and not at_random:
            return None
        error = ImuError()
        for fault in acting:
            self._tell(fault)
            error.add(fault.kind, np.float64(fault.argument))
        self._of_imu = [fault for fault in acting if not fault.once]
        if at_random:
            self._at_random.of_imu(error)
        return error

    def _tell(self, fault: Fault) -> None:
        self.told[fault.kind] += 1
        if fault.once:
            self._spent.append(fault)
