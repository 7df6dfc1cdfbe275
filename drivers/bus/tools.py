"""`BusTools`: bench operations on single servos, for any protocol."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.configs.servo import Protocol, catalogue, not_driven
from flexmotion.drivers.bus.attempts import DAMAGED
from flexmotion.drivers.bus.inspection import Inspection
from flexmotion.drivers.imu.interface import Imu
from flexmotion.drivers.port import SerialPort


@dataclass(frozen=True)
class Found:
    """A device on a bus: baud rate, id, model name or number, and firmware version if known."""

    baud: int
    id: int
    model: str
    firmware: int | None = None


@dataclass(frozen=True)
class Reading:
    """What a servo measures: position [servo units], speed of its shaft [rad/s], torque [N·m] (NaN: unknown).

    Attributes:
        voltage, temperature: [V, °C].
        error: bits as the servo reports them.
        torque_on: whether torque is on.
    """

    ticks: int
    velocity: float
    effort: float
    voltage: float
    temperature: float
    error: int
    torque_on: bool


class BusTools(ABC):
    """Tools for one protocol on an open port.

    Class attributes:
        protocol: as in the catalogue.
        baud_rates: that its servos support.
        new_id, new_baud: id and baud rate of a new servo.
    """

    protocol: ClassVar[Protocol]
    baud_rates: ClassVar[tuple[int, ...]]
    new_id: ClassVar[int] = 1
    new_baud: ClassVar[int]

    def __init__(self, port: SerialPort) -> None:
        self.port = port

    def scan(self, baud_rates: tuple[int, ...]) -> Iterator[Found]:
        """Every device that answers, at each of the baud rates in turn."""
        for baud in baud_rates:
            self.port.set_baud(baud)
            yield from self.scan_here()

    def change_id(self, old: int, new: int) -> None:
        """Change the id of a servo.

        Raises:
            DriverError: `old` does not answer, two servos have it, or `new` is in use.
        """
        if not self.answers(old):
            raise DriverError(f"port {self.port.path}: id {old} does not answer at {self.port.baud} baud")
        if not self.is_alone(old):
            raise DriverError(f"port {self.port.path}: id {old}: {DAMAGED}; nothing was written")
        if self.answers(new):
            raise DriverError(f"port {self.port.path}: id {new} is taken")
        self.write_id(old, new)
        if not self.answers(new):
            raise DriverError(f"port {self.port.path}: id {new} does not answer after the change from {old}")

    @abstractmethod
    def scan_here(self) -> Iterator[Found]:
        """Every device that answers at the port's baud rate."""

    @abstractmethod
    def answers(self, id_: int) -> bool:
        """Whether a device has this id."""

    @abstractmethod
    def is_alone(self, id_: int) -> bool:
        """Whether a servo's measurements come intact: those of two servos with one id differ, and collide in bits.

        What all servos of a model answer alike, such as a ping, also two of them answer well.
        """

    @abstractmethod
    def write_id(self, old: int, new: int) -> None:
        """Write the id of a servo."""

    @abstractmethod
    def inspect(self, robot: Robot, joint: int, present_id: int | None = None) -> Inspection:
        """Read the settings of a joint's servo, which may have another id at present; nothing is written.

        Raises `DriverError` if it does not answer, or has another model or protocol than the robot file says.
        """

    @abstractmethod
    def write_settings(self, robot: Robot, joint: int, settings: Mapping[str, int]) -> None:
        """Write settings of a joint's servo that it keeps without power. Raises `DriverError` if one is refused."""

    @abstractmethod
    def look(self, robot: Robot, joint: int) -> Reading | None:
        """Read what a joint's servo measures; None: it does not answer. Nothing is written."""

    @abstractmethod
    def torque_off(self, robot: Robot, joint: int) -> None:
        """Switch the torque of a joint's servo off. Raises `DriverError`."""

    @abstractmethod
    def write_baud(self, robot: Robot, joint: int, baud: int) -> None:
        """Write the bit rate of a joint's servo; from then on it answers at that rate only."""

    def acknowledge(self, robot: Robot, joints: Sequence[int]) -> None:  # noqa: B027 - some servos always do
        """Make servos answer every instruction."""

    def find_board(self, robot: Robot, name: str) -> Imu | None:
        """The board with an inertial sensor on the bus `name`; None: the robot has none there.

        Raises `DriverError` if it has switched the power of the servos off.
        """
        return None

    def switch_power(self, robot: Robot, name: str) -> None:  # noqa: B027 - most buses have no such board
        """Switch the power of the servos on at their board. Raises `DriverError` if the board refuses."""

    def read_board(self, board: Imu) -> bool:
        """Read the sensor of a board; whether it answered."""
        return False

    def reboot(self, id_: int) -> None:
        """Restart a servo: torque goes off, hardware errors are cleared. Raises `DriverError`."""
        raise DriverError(f"servos of protocol {self.protocol} cannot reboot: switch their power off and on")


def model_name(number: int) -> str:
    """Name of a model number, of servos that are not driven too."""
    names = [servo.name for servo in catalogue().values() if servo.model_number == number]
    names += [f"{name} (not supported)" for name, other in not_driven().items() if other.model_number == number]
    return " or ".join(names) if names else f"model {number}"
