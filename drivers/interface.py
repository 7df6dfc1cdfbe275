"""The hardware interface: what a driver does, and the messages that it exchanges with the control loop.

The loop calls `open`, then `read` and `write` in every tick, then `close`. Messages are allocated once and filled in
place. Joints are in the order of the robot file. `flexmotion.drivers.simulated` adds what simulated robots offer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import Strict
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]


@dataclass(frozen=True)
class Capabilities:
    """What a driver offers. The loop checks it before it relies on anything.

    Attributes:
        imu: an inertial measurement unit is read with the joints.
        effort: `RobotState.effort` is measured.
        torque_bound: `JointCommand.torque_bound` reaches the servos.
        joint_torque: `switch` acts on single joints.
        reboot: `reboot` restarts single servos.
        lockstep: time passes only in `advance` (`flexmotion.drivers.simulated.LockstepDriver`).
        truth: the true state is known (`flexmotion.drivers.simulated.SimulatedDriver`).
    """

    imu: bool = False
    effort: bool = False
    torque_bound: bool = False
    joint_torque: bool = False
    reboot: bool = False
    lockstep: bool = False
    truth: bool = False


@dataclass
class RobotState:
    """Measurements, filled in place by `Driver.read`.

    Attributes:
        stamp_ns: `time.perf_counter_ns` (or simulated time) of the measurement.
        values: the five that follow, (5, n); they are views of its rows.
        position, velocity: joint angles and speeds, (n,) [rad, rad/s].
        effort: joint torque estimated from current, (n,) [N·m]; NaN where unknown.
        voltage, temperature: per servo, (n,) [V, °C]; NaN where unknown.
        hardware_error: per servo, (n,) bits as the servo reports them; 0: no error.
        stale: consecutive reads without a new value, per joint, (n,) int; 0: fresh.
        gyro: angular velocity in the torso frame, (3,) [rad/s].
        accel: specific force in the torso frame, (3,) [m/s²] (at rest: +9.81 along up).
        imu_stale: consecutive reads without a new IMU sample; -1: no IMU.
    """

    n: int
    stamp_ns: int = 0
    values: Float = field(init=False)
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
        self.values = np.full((5, self.n), np.nan)
        self.values[:2] = 0.0
        self.position, self.velocity, self.effort, self.voltage, self.temperature = self.values
        self.hardware_error, self.stale = np.zeros(self.n, np.int64), np.zeros(self.n, np.int64)


@dataclass
class JointCommand:
    """Goals for one tick.

    Attributes:
        position: goal positions, (n,) [rad].
        torque_bound: upper bound of each servo's torque, (n,) [N·m]; NaN: the servo's own limit. Ignored by drivers
            without `Capabilities.torque_bound`.
    """

    n: int
    position: Float = field(init=False)
    torque_bound: Float = field(init=False)

    def __post_init__(self) -> None:
        self.position, self.torque_bound = np.zeros(self.n), np.full(self.n, np.nan)


class Driver(ABC):
    """A robot, or its servo bus. As a context manager it opens and closes itself.

    Class attributes:
        name: the entry-point name in group `flexmotion.drivers`.
        Options: fields that may be set when it is created, checked by `flexmotion.drivers.registry.create`.

    Methods raise `flexmotion.configs.errors.DriverError`, which names joint, servo id and port, if hardware fails.
    """

    name: ClassVar[str]
    Options: ClassVar[type[Strict]] = Strict

    def __init__(self, robot: Robot, *, options: Strict | None = None) -> None:
        self.robot = robot
        self.options = self.Options() if options is None else options

    @property
    @abstractmethod
    def capabilities(self) -> Capabilities:
        """What this driver offers; known before `open`."""

    @property
    @abstractmethod
    def delay_s(self) -> float:
        """Time from `write` to the servo acting on it [s], measured if the driver can, otherwise an assumption."""

    @property
    def turns(self) -> int:
        """Reads within which every joint is read once: a slow bus reads its servos in turns."""
        return 1

    def look(self) -> None:  # noqa: B027 - optional
        """Check every servo as `open` does, and release the hardware again; nothing is written to the servos.

        For whoever wants to know what `open` would refuse before anything else is prepared. It passes servos that do
        not answer before something has been written to them.
        """

    @abstractmethod
    def open(self) -> None:
        """Connect and check every servo; torque stays as it is. Raises if one is missing or differs from the file."""

    @abstractmethod
    def read(self, state: RobotState) -> None:
        """Fill `state` with the newest measurement; never blocks longer than its share of the tick."""

    @abstractmethod
    def write(self, command: JointCommand) -> None:
        """Send the goals. Servos whose torque is off ignore them."""

    @abstractmethod
    def set_torque(self, on: bool) -> None:
        """Switch the torque of all servos. Before it goes on, every goal is pinned to the present position."""

    def take_pins(self, goal: Float) -> None:  # noqa: B027 - optional
        """Write goals that were pinned since the last call into `goal`, (n,) [rad]; the others are left unchanged.

        For drivers that read the joints again before they switch torque on, switch a servo on again later, or find one
        that refused goals: they pin goals to positions that the loop has not read. Goals that follow begin there, and
        must not be further outside the limits.
        """

    def switch(self, which: Bool, on: bool) -> None:
        """Switch the torque of the joints in `which`, (n,), while the robot has torque (`Capabilities.joint_torque`).

        On: their goals are pinned to their present positions first; see `take_pins`. Returns within a tick, and asks no
        servo: what is lost on a bus is sent again in the next ticks. `set_torque` acts on all joints.
        """
        raise DriverError(f"driver {self.name!r} does not switch the torque of single joints")

    def reboot(self, which: Bool) -> None:
        """Restart the servos of the joints in `which`, (n,), while all torque is off (`Capabilities.reboot`).

        A restart clears hardware errors whose cause is gone. It returns at once; `read` then sets the servos up again,
        one exchange a tick, and `take_restarted` tells the end.
        """
        raise DriverError(f"driver {self.name!r} does not restart servos")

    def take_restarted(self) -> Sequence[tuple[int, str | None]]:
        """Restarts that have ended since the last call: index of the joint, and None or why it is not ready."""
        return ()

    @abstractmethod
    def damp(self) -> None:
        """Lower stiffness and torque, as far as servos can, so that joints give way. Only after a detected fall."""

    @property
    def temperature_limit(self) -> Float:
        """Temperature at which each servo switches itself off, (n,) [°C]; known exactly after `open`."""
        return np.array([servo.temperature_limit for servo in self.robot.servos])

    @property
    def voltage_limit(self) -> Float:
        """Supply below which each servo reports an error, (n,) [V]; 0: not known."""
        return np.zeros(self.robot.n)

    @property
    def connected(self) -> bool:
        """Whether goals can still be sent: False once the hardware is known to be out of reach, such as a port gone."""
        return True

    @property
    def holding(self) -> Sequence[str]:
        """Servos that have not confirmed that their torque went off in the last `set_torque(False)`, for messages."""
        return ()

    @property
    def violations(self) -> int:
        """Goals outside a servo's envelope that were written, counted after quantisation.

        Drivers of a bus hold positions among them back: the servo's goal before is sent again. A simulated robot
        receives them.
        """
        return 0

    @abstractmethod
    def close(self) -> None:
        """Switch torque off and release the port. May be called twice."""

    def __enter__(self) -> Driver:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
