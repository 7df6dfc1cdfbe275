"""`ServoBus`: the servos on one port, whatever they speak; what drivers of all vendors have in common."""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.servo import Protocol, Servo
from flexmotion.drivers.bus.goal_guard import GoalGuard
from flexmotion.drivers.bus.options import BusOptions
from flexmotion.drivers.imu.interface import Imu
from flexmotion.drivers.port import SerialPort

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

log = logging.getLogger(__name__)

TORQUE_LOST = 0x100
"""Bit of `RobotState.hardware_error` that no servo reports: torque went off without being told to."""


@dataclass(frozen=True)
class Budget:
    """What a cycle costs on the wire, calculated.

    Attributes:
        read_bytes, write_bytes: both directions together.
        read_s, write_s: at the bus's baud rate, with return delays [s].
    """

    read_bytes: int
    write_bytes: int
    read_s: float
    write_s: float

    @property
    def cycle_s(self) -> float:
        """A read and a write [s]."""
        return self.read_s + self.write_s


class Measurement:
    """The newest values of the servos of one bus, (m,) each, in the order of the bus.

    Attributes:
        ticks: position in servo units.
        velocity: of the servo's shaft [rad/s].
        effort: torque at the shaft [N·m]; NaN where unknown.
        voltage, temperature: [V, °C]; NaN where unknown.
        error: bits as the servo reports them.
        torque: torque is on, as the servo says.
        fresh: answered in the last cycle.
        asked: was asked in the last cycle; a bus too slow to ask all asks the others later.
    """

    def __init__(self, m: int) -> None:
        self.ticks, self.velocity = np.zeros(m), np.zeros(m)
        self.effort, self.voltage, self.temperature = (np.full(m, np.nan) for _ in range(3))
        self.error = np.zeros(m, np.int64)
        self.torque = np.zeros(m, np.bool_)
        self.fresh, self.asked = np.zeros(m, np.bool_), np.ones(m, np.bool_)


class ServoBus(ABC):
    """One port with servos of one protocol.

    `audit` and `switch_on` may take their time and raise; everything else is done within a tick and never raises for
    what happens on the bus: servos that do not answer are not `fresh`.

    Class attributes:
        protocol: of servos in the catalogue that it speaks to.

    Attributes:
        name: in the robot file; `config` what the file says of it.
        joints: indices of its joints in the robot's order, (m,); `where` the same, as a slice if it is one, which numpy
            takes several times faster.
        ids: addresses of their servos.
        torque_per_unit: torque of one unit of measured current, (m,) [N·m]; NaN where a servo measures none.
        measured: the newest values.
        guard: keeps back goals that the servos are not to take.
        pins: goals that servos were last pinned to, in their units, (m,); NaN once the driver has taken them.
        imu: that answers on this bus; None where there is none.
    """

    protocol: Protocol

    def __init__(self, robot: Robot, name: str, port: SerialPort, options: BusOptions) -> None:
        self.robot, self.name, self.port, self.options = robot, name, port, options
        self.config = robot.config.buses[name]
        self.joints = np.array([i for i, joint in enumerate(robot.joints) if joint.bus == name], np.int64)
        first, m = int(self.joints[0]), len(self.joints)
        consecutive = np.array_equal(self.joints, np.arange(first, first + m))
        self.where: slice | NDArray[np.int64] = slice(first, first + m) if consecutive else self.joints
        self.ids = [robot.joints[i].id for i in self.joints]
        self.servos = [robot.servos[i] for i in self.joints]
        self.torque_per_unit = np.array([_torque_per_unit(servo) for servo in self.servos])
        self.measured = Measurement(len(self.joints))
        ends = np.stack([robot.to_ticks(robot.lower), robot.to_ticks(robot.upper)])[:, self.joints]
        self.guard = GoalGuard(ends.min(axis=0), ends.max(axis=0))
        self.pins = np.full(len(self.joints), np.nan)
        self.imu: Imu | None = None

    @classmethod
    def check(cls, robot: Robot, name: str) -> None:
        """Raise `ConfigError` where a servo of the bus speaks another protocol, or the file asks for the impossible."""
        for joint, servo in zip(robot.joints, robot.servos, strict=True):
            if joint.bus == name and servo.protocol != cls.protocol:
                raise ConfigError(
                    f"{robot.file}: joint {joint.name!r}: servo {servo.name} on bus {name!r} speaks {servo.protocol}, "
                    f"this driver speaks {cls.protocol}"
                )
        if not any(joint.bus == name for joint in robot.joints):
            raise ConfigError(f"{robot.file}: field buses.{name}: no joint is on it")

    @classmethod
    @abstractmethod
    def budget(cls, robot: Robot, name: str) -> Budget:
        """What a cycle costs on the bus `name`, everything answering as it should."""

    @classmethod
    def bounds_torque(cls, robot: Robot) -> bool:
        """Whether torque bounds reach the servos."""
        return False

    @classmethod
    def carries_imu(cls, robot: Robot, name: str) -> bool:
        """Whether the robot's IMU is one that answers on this bus."""
        return False

    @abstractmethod
    def audit(self) -> None:
        """Find every servo, check it against the robot file and set it up; torque stays as it is.

        Raises `DriverError` naming joint, id and port.
        """

    @abstractmethod
    def request(self, now: float) -> None:
        """Begin a read cycle at time `now` [s]."""

    @abstractmethod
    def receive(self, now: float) -> bool:
        """Take what has come, and ask on where that was all or its time is over; whether the cycle is done."""

    @property
    @abstractmethod
    def patience(self) -> float:
        """Time at which `receive` gives up on what it waits for, and asks on [s]."""

    @abstractmethod
    def finish(self) -> None:
        """End the cycle: `measured` holds what came, `fresh` tells of what."""

    @abstractmethod
    def send_goals(self, ticks: Float, bound: Float) -> None:
        """Goal positions in servo units and torque bounds [N·m, NaN: none], (m,) each."""

    @abstractmethod
    def switch_on(self) -> None:
        """Pin every goal to its present position, check that, and switch torque on. Raises `DriverError`."""

    @abstractmethod
    def repeat_on(self, off: Bool) -> None:
        """Pin and switch on once more servos that missed it, (m,)."""

    @abstractmethod
    def switch_off(self) -> None:
        """Torque off, told more than once."""

    @abstractmethod
    def damp(self) -> None:
        """Pin the goals and give way softly, as far as the servos can."""

    def log_changes(self, changes: Mapping[int, Sequence[str]]) -> None:
        """Log what the audit wrote for good: one line for the bus, one for each servo to whoever wants to know.

        Args:
            changes: slot -> `register old -> new` of every register that was written.
        """
        changed = {slot: names for slot, names in changes.items() if names}
        if not changed:
            return
        registers = dict.fromkeys(change.split()[0] for names in changed.values() for change in names)
        count = f"{len(changed)} servos" if len(changed) > 1 else self.joint_name(next(iter(changed)))
        log.warning("bus %s: set for good on %s: %s (details: -v)", self.name, count, ", ".join(registers))
        for slot, names in changed.items():
            log.info("%s on %s: %s", self.joint_name(slot), self.port.path, ", ".join(names))

    def joint_name(self, slot: int) -> str:
        """`servo of JOINT (id N)` for messages."""
        return f"servo of {self.robot.joint_names[self.joints[slot]]} (id {self.ids[slot]})"

    def close(self) -> None:
        """Let go of the port."""
        self.port.close()


def _torque_per_unit(servo: Servo) -> float:
    return (servo.current_unit or math.nan) * (servo.torque_constant or servo.stall_torque / servo.stall_current)
