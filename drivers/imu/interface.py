"""`Imu`: an inertial sensor behind one interface, whether it answers on the servo bus or on a port of its own."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot_file import Imu as ImuConfig
from flexmotion.configs.schema import Strict
from flexmotion.drivers.port import SerialPort
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

OpenPort = Callable[[str, int], SerialPort]
"""Makes a serial port from path and baud rate. Raises `DriverError`."""

log = logging.getLogger(__name__)


class Imu(ABC):
    """An inertial sensor with its newest sample, in the frame of the body that carries it.

    Class attributes:
        name: what a robot file calls it.

    Attributes:
        config: what the robot file says of it; its quaternion is how the sensor is mounted.
        mount: rotation from its own frame to the body's, (3, 3).
        gyro, accel: angular velocity [rad/s] and specific force [m/s², at rest 9.81 up], (3,); filled in place.
    """

    name: ClassVar[str]

    def __init__(self, config: ImuConfig) -> None:
        self.config = config
        self.mount: Float = Rotation.from_quat(config.quaternion, scalar_first=True).as_matrix()
        self.gyro, self.accel = np.zeros(3), np.array([0.0, 0.0, GRAVITY])

    @abstractmethod
    def read(self, now: float) -> bool:
        """Take in what has come by `now` [s]; whether the newest sample is of now, not one that has grown old.

        Never waits, and never raises for what happens on the wire.
        """


class StandaloneImu(Imu):
    """A sensor that is no part of a servo bus; what a plug-in in group `flexmotion.imus` names a subclass of.

    Class attributes:
        Options: what a robot file may set about it (`imu.options`).
    """

    Options: ClassVar[type[Strict]] = Strict

    def __init__(self, config: ImuConfig, *, options: Strict | None = None) -> None:
        super().__init__(config)
        self.options = self.Options() if options is None else options

    @abstractmethod
    def open(self, open_port: OpenPort, rate_hz: float) -> None:
        """Find it and set it up, so that each read at `rate_hz` finds a new sample. Raises `DriverError`.

        One with a serial port takes it from `open_port`, which tests replace.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of it. May be called twice."""


def do_without(config: ImuConfig, error: DriverError) -> None:
    """An IMU was not found: a warning, and the loop is open; raises `DriverError` where the robot file requires it."""
    if config.required:
        raise DriverError(f"{error}: no IMU, which the robot file requires") from error
    log.warning("%s: no IMU", error)
