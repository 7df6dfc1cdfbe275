"""`Imu`: the interface of inertial sensors, on a servo bus or on a port of their own."""

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
        name: `imu.driver` in a robot file.

    Attributes:
        config: `imu` of the robot file.
        mount: rotation from the sensor's frame to the body's, (3, 3).
        gyro, accel: angular velocity [rad/s] and specific force [m/s²] (at rest +9.81 up), (3,) each; filled in place.
    """

    name: ClassVar[str]

    def __init__(self, config: ImuConfig) -> None:
        self.config = config
        self.mount: Float = Rotation.from_quat(config.quaternion, scalar_first=True).as_matrix()
        self.gyro, self.accel = np.zeros(3), np.array([0.0, 0.0, GRAVITY])

    @abstractmethod
    def read(self, now: float) -> bool:
        """Take samples received by `now` [s]; whether the newest one is fresh.

        Does not wait, and does not raise for errors on the wire.
        """


class StandaloneImu(Imu):
    """A sensor that is not on a servo bus. Plug-ins in group `flexmotion.imus` are subclasses.

    Class attributes:
        Options: fields of `imu.options` in a robot file.
    """

    Options: ClassVar[type[Strict]] = Strict

    def __init__(self, config: ImuConfig, *, options: Strict | None = None) -> None:
        super().__init__(config)
        self.options = self.Options() if options is None else options

    @abstractmethod
    def open(self, open_port: OpenPort, rate_hz: float) -> None:
        """Connect and set it up, so that each read at `rate_hz` finds a new sample. Raises `DriverError`.

        A sensor on a serial port opens it with `open_port`, which tests replace.
        """

    @abstractmethod
    def close(self) -> None:
        """Release it. May be called twice."""


def do_without(config: ImuConfig, error: DriverError) -> None:
    """Warn that there is no IMU (the robot runs open loop). Raises `DriverError` if the robot file requires one."""
    if config.required:
        raise DriverError(f"{error}: no IMU, which the robot file requires") from error
    log.warning("%s: no IMU", error)
