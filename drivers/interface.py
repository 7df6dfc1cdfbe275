"""The one door to servos and robots: what a driver can do, and the messages that pass through it.

The loop calls `open`, then every tick `read` and `write`, then `close`. Messages are allocated once and filled in
place, so that a tick allocates nothing that grows. Joints are in the order of the robot file.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import Strict
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Capabilities:
    """What a driver offers; the loop asks before it relies on anything.

    Attributes:
        imu: an inertial measurement unit is read with the joints.
        effort: `RobotState.effort` is measured.
        torque_bound: `JointCommand.torque_bound` reaches the servo.
        lockstep: time stands still between `advance` calls (simulation in this process).
        truth: `truth()` tells the robot's real pose (simulation).
    """

    imu: bool = False
    effort: bool = False
    torque_bound: bool = False
    lockstep: bool = False
    truth: bool = False


@dataclass
class RobotState:
    """What a driver measured, filled in place by `Driver.read`.

    Attributes:
        stamp_ns: `time.perf_counter_ns` (or simulated time) of the measurement.
        position, velocity: joint angles and speeds, (n,) [rad, rad/s].
        effort: joint torque estimated from current, (n,) [N·m]; NaN where unknown.
        voltage, temperature: per servo, (n,) [V, °C]; NaN where unknown.
        hardware_error: per servo, (n,) bits as the servo reports them; 0 is healthy.
        stale: reads in a row that each joint's values are old, (n,) int; 0 is fresh.
        gyro: angular velocity in the IMU's frame as mounted and calibrated to the torso frame, (3,) [rad/s].
        accel: specific force in the torso frame, (3,) [m/s²] (at rest: +9.81 along up).
        imu_stale: reads in a row without a fresh IMU sample; -1 where there is no IMU.
    """

    n: int
    stamp_ns: int = 0
    position: Float = field(init=False)
    velocity: Float = field(init=False)
    effort: Float = field(init=False)
    voltage: Float = field(init=False)
    temperature: Float = field(init=False)
    hardware_error: NDArray[np.int64] = field(init=False)
    stale: NDArray[np.int64] = field(init=False)
    gyro: Float = field(default_factory=lambda: np.zeros(3))
    accel: Float = field(default_factory=lambda: np.array([0.0, 0.0, GRAVITY]))
    imu_stale: int = -1

    def __post_init__(self) -> None:
        self.position, self.velocity = np.zeros(self.n), np.zeros(self.n)
        self.effort, self.voltage, self.temperature = (np.full(self.n, np.nan) for _ in range(3))
        self.hardware_error, self.stale = np.zeros(self.n, np.int64), np.zeros(self.n, np.int64)


@dataclass
class JointCommand:
    """What the loop asks of the servos in one tick.

    Attributes:
        position: goal positions, (n,) [rad].
        torque_bound: upper bound of each servo's torque, (n,) [N·m]; NaN leaves the servo's own limit. Only
            drivers with `Capabilities.torque_bound` obey it.
    """

    n: int
    position: Float = field(init=False)
    torque_bound: Float = field(init=False)

    def __post_init__(self) -> None:
        self.position, self.torque_bound = np.zeros(self.n), np.full(self.n, np.nan)


class Driver(ABC):
    """A robot, or its servo bus, behind one interface. Used as a context manager it opens and closes itself.

    Class attributes:
        name: the entry-point name in group `flexmotion.drivers`.
        Options: what may be set when it is created; `flexmotion.drivers.registry.create` checks its options against it.

    Every method raises `flexmotion.configs.errors.DriverError` naming joint, servo id and port where hardware fails.
    """

    name: ClassVar[str]
    Options: ClassVar[type[Strict]] = Strict

    def __init__(self, robot: Robot, *, options: Strict | None = None) -> None:
        self.robot = robot
        self.options = self.Options() if options is None else options

    @property
    @abstractmethod
    def capabilities(self) -> Capabilities:
        """What this driver offers, known before `open`."""

    @property
    @abstractmethod
    def delay_s(self) -> float:
        """Time from `write` to the servo acting on it [s], measured where the driver can, else assumed."""

    @abstractmethod
    def open(self) -> None:
        """Connect and audit; torque stays off. Raises if a servo is missing or not what the robot file says."""

    @abstractmethod
    def read(self, state: RobotState) -> None:
        """Fill `state` with the newest measurement; never blocks past the tick's budget."""

    @abstractmethod
    def write(self, command: JointCommand) -> None:
        """Send the goals; ignored by servos whose torque is off."""

    @abstractmethod
    def set_torque(self, on: bool) -> None:
        """Switch all servos. Switching on pins every goal to its present position first."""

    def take_pins(self, goal: Float) -> None:  # noqa: B027 - who pins to what was read last has nothing to add
        """Write where goals were pinned since the last call into `goal`, (n,) [rad]; others stay as they are.

        A driver that reads once more before it switches on, or switches a servo on again later, pins goals to where the
        loop has not seen the joints yet; the goals that follow must not lie further out.
        """

    @abstractmethod
    def damp(self) -> None:
        """Let the joints give way softly, within what the servos can (after a detected fall only)."""

    @property
    def violations(self) -> int:
        """Goals received outside a servo's envelope, counted at the receiving end after quantisation."""
        return 0

    @abstractmethod
    def close(self) -> None:
        """Leave the robot safe (torque off) and release the port. May be called twice."""

    def __enter__(self) -> Driver:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
