"""`ServoBus`: the servos on one port, for any protocol."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot
from flexmotion.configs.servo import Protocol, Servo
from flexmotion.drivers.bus.attempts import TRIES
from flexmotion.drivers.bus.goal_guard import GoalGuard
from flexmotion.drivers.bus.options import BusOptions
from flexmotion.drivers.imu.interface import Imu
from flexmotion.drivers.masks import every
from flexmotion.drivers.port import SerialPort

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

TORQUE_LOST, WATCHDOG_TRIPS = 0x100, 0x200
"""Bits of `RobotState.hardware_error` set by the driver: torque went off unasked; the bus watchdog of a servo trips
again and again."""


@dataclass(frozen=True)
class Budget:
    """Bytes and time of a cycle on the wire, calculated.

    Attributes:
        read_bytes, write_bytes: both directions together.
        read_s, write_s: at the bus's baud rate, with return delays [s].
        asked_s: from the beginning of a read until a servo has been asked for its angle, on average [s].
    """

    read_bytes: int
    write_bytes: int
    read_s: float
    write_s: float
    asked_s: float

    @property
    def cycle_s(self) -> float:
        """A read and a write [s]."""
        return self.read_s + self.write_s


class Measurement:
    """The newest values of the servos of one bus, (m,) each, in the order of the bus.

    Attributes:
        values: the first five of the following, (5, m); they are views of its rows.
        ticks: position in servo units.
        velocity: of the output shaft [rad/s].
        effort: torque at the output shaft [N·m]; NaN where unknown.
        voltage, temperature: [V, °C]; NaN where unknown.
        error: bits as the servo reports them.
        torque: whether torque is on, as the servo reports it.
        watchdog: its bus watchdog, as the servo reports it; -1: it has tripped, and goals are refused.
        fresh: whether it answered in the last cycle.
        asked: whether it was asked in the last cycle; a slow bus asks servos in turns.
    """

    def __init__(self, m: int) -> None:
        self.values = np.full((5, m), np.nan)
        self.values[:2] = 0.0
        self.ticks, self.velocity, self.effort, self.voltage, self.temperature = self.values
        self.error = np.zeros(m, np.int64)
        self.torque, self.watchdog = np.zeros(m, np.bool_), np.zeros(m, np.int64)
        self.fresh, self.asked = np.zeros(m, np.bool_), np.ones(m, np.bool_)

    @property
    def complete(self) -> bool:
        """Whether all servos answered in the last cycle."""
        return every(self.fresh)


class ServoBus(ABC):
    """One port with servos of one protocol.

    `look`, `audit` and `switch_on` may block and raise. All other methods return within a tick and do not raise for
    errors on the bus: servos that do not answer are not `fresh`.

    Class attributes:
        protocol: of its servos, as in the catalogue.
        restarts: whether its servos restart on request.

    Attributes:
        name, config: name and content of its entry in the robot file.
        joints: indices of its joints in the robot's order, (m,).
        where: the same, as a slice if they are consecutive, which numpy reads several times faster.
        ids: addresses of their servos.
        torque_per_unit: torque of one unit of measured current, (m,) [N·m]; NaN where a servo measures none.
        measured: the newest values.
        guard: replaces goals outside the envelope before they are sent.
        pins: goals that servos were last pinned to, (m,) [servo units]; NaN once the driver has taken them.
        holding: servos that have not confirmed that torque is off since `confirm_off`, as `JOINT (id N)`.
        temperature_limit, voltage_limit: the servos' own limits, (m,) [°C, V]; see `Driver`.
        imu: inertial sensor on this bus; None if there is none.
    """

    protocol: Protocol
    restarts: ClassVar[bool] = False

    def __init__(self, robot: Robot, name: str, port: SerialPort, options: BusOptions) -> None:
        self.robot, self.name, self.port, self.options = robot, name, port, options
        self.config = robot.config.buses[name]
        self.joints = np.array([i for i, joint in enumerate(robot.joints) if joint.bus == name], np.int64)
        first, m = int(self.joints[0]), len(self.joints)
        consecutive = np.array_equal(self.joints, np.arange(first, first + m))
        self.where: slice | NDArray[np.int64] = slice(first, first + m) if consecutive else self.joints
        self.ids = [robot.joints[i].id for i in self.joints]
        self.servos = [robot.servos[i] for i in self.joints]
        self.torque_per_unit = np.array([torque_per_unit(servo) for servo in self.servos])
        self.measured = Measurement(len(self.joints))
        ends = np.stack([robot.to_ticks(robot.lower), robot.to_ticks(robot.upper)])[:, self.joints]
        self.guard = GoalGuard(ends.min(axis=0), ends.max(axis=0))
        self.pins = np.full(len(self.joints), np.nan)
        self.temperature_limit = np.array([servo.temperature_limit for servo in self.servos])
        self.voltage_limit = np.zeros(len(self.servos))
        self.holding: list[str] = []
        self.imu: Imu | None = None

    @classmethod
    def check(cls, robot: Robot, name: str) -> None:
        """Raise `ConfigError` if a servo of the bus has another protocol, or a setting is not supported."""
        for joint, servo in zip(robot.joints, robot.servos, strict=True):
            if joint.bus == name and servo.protocol != cls.protocol:
                raise ConfigError(
                    f"{robot.file}: joint {joint.name!r}: servo {servo.name} on bus {name!r} has protocol "
                    f"{servo.protocol}, this driver supports {cls.protocol}"
                )
        if not any(joint.bus == name for joint in robot.joints):
            raise ConfigError(f"{robot.file}: field buses.{name}: no joint uses it")

    @classmethod
    @abstractmethod
    def budget(cls, robot: Robot, name: str) -> Budget:
        """Bytes and time of a cycle on the bus `name` if every device answers."""

    @classmethod
    def turns(cls, robot: Robot, name: str) -> int:
        """Cycles within which every servo is read once."""
        return 1

    @classmethod
    def bounds_torque(cls, robot: Robot) -> bool:
        """Whether torque bounds are sent to the servos."""
        return False

    @classmethod
    def carries_imu(cls, robot: Robot, name: str) -> bool:
        """Whether the robot's IMU is on this bus."""
        return False

    @abstractmethod
    def look(self) -> None:
        """Find every servo and check its settings against the robot file; nothing is written.

        Raises as `audit`. Servos that do not answer before something has been written to them are passed: those whose
        power a board has switched off, and Dynamixels that are set to answer nothing.
        """

    @abstractmethod
    def audit(self) -> None:
        """Find every servo, check all against the robot file, and prepare them for a run; torque stays as it is.

        EEPROM is not written, and nothing that a run changes before all servos are found to be configured.

        Raises `DriverError`, naming joint, id and port, and `NotConfiguredError` if a setting in EEPROM differs.
        """

    @abstractmethod
    def request(self, now: float) -> None:
        """Start a read cycle at time `now` [s]."""

    @abstractmethod
    def receive(self, now: float) -> bool:
        """Take received bytes; start the next exchange if one is complete or timed out. True once the cycle is done."""

    @property
    @abstractmethod
    def patience(self) -> float:
        """Time at which `receive` gives up the pending exchange [s]."""

    @property
    def due(self) -> float:
        """Time before which answers of which a part has come cannot be complete [s]; 0: nothing has come."""
        return 0.0

    @abstractmethod
    def finish(self) -> None:
        """End the cycle and update `measured`; `fresh` marks the servos that answered."""

    @abstractmethod
    def send_goals(self, ticks: Float, bound: Float) -> None:
        """Send goal positions [servo units] and torque bounds [N·m, NaN: none], (m,) each."""

    @abstractmethod
    def switch_on(self) -> None:
        """Pin every goal to the present position, verify it, and switch torque on. Raises `DriverError`."""

    @abstractmethod
    def repeat_on(self, off: Bool) -> None:
        """Pin and switch on again the servos marked in `off`, (m,)."""

    @abstractmethod
    def switch(self, which: Bool, on: bool) -> None:
        """Send torque on or off to the servos in `which`, (m,), pinned before it goes on; waits for no answer."""

    def restart(self, slot: int) -> Iterator[None]:
        """Restart a servo and set it up for a run, one exchange for each step. Raises `DriverError` if that fails."""
        raise DriverError(f"{self.joint_name(slot)}: servos of protocol {self.protocol} cannot restart")

    @abstractmethod
    def send_off(self) -> None:
        """Send torque off to all servos; waits for no answer."""

    @abstractmethod
    def torque_is_off(self, asked: Bool, until: float) -> Bool:
        """Ask the servos in `asked`, blocking until time `until` [s] at most: which say that torque is off, (m,)."""

    @abstractmethod
    def damp(self) -> None:
        """Pin the goals and lower stiffness and torque as far as the servos can."""

    def joint_name(self, slot: int) -> str:
        """`servo of JOINT (id N)` for messages."""
        return f"servo of {self.robot.joint_names[self.joints[slot]]} (id {self.ids[slot]})"

    def confirm_off(self, until: float) -> None:
        """Ask servos whether torque is off, and send it again to all while some have not confirmed it.

        Fills `holding`. Blocks until time `until` [s] at most, on a bus that does not answer too.
        """
        off = self.torque_is_off(np.ones(len(self.ids), np.bool_), until)
        for _ in range(TRIES - 1):
            if off.all() or self.port.lost is not None or self.port.now() >= until:
                break
            self.send_off()
            off |= self.torque_is_off(~off, until)
        self.measured.torque[off] = False
        names = self.robot.joint_names
        self.holding = [f"{names[self.joints[slot]]} (id {self.ids[slot]})" for slot in np.flatnonzero(~off)]

    def close(self) -> None:
        """Release the port."""
        self.port.close()


def torque_per_unit(servo: Servo) -> float:
    """Torque of one unit of a servo's measured current [N·m]; NaN if it measures none."""
    return (servo.current_unit or math.nan) * (servo.torque_constant or servo.stall_torque / servo.stall_current)
