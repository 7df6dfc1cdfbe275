"""`BusTools`: bench operations on single servos, for any protocol."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from flexmotion.configs.errors import DriverError
from flexmotion.configs.servo import Protocol, catalogue
from flexmotion.drivers.port import SerialPort


@dataclass(frozen=True)
class Found:
    """A device on a bus: baud rate, id, model name or number, and firmware version if known."""

    baud: int
    id: int
    model: str
    firmware: int | None = None


class BusTools(ABC):
    """Tools for one protocol on an open port.

    Class attributes:
        protocol: as in the catalogue.
        baud_rates: that its servos support.
    """

    protocol: ClassVar[Protocol]
    baud_rates: ClassVar[tuple[int, ...]]

    def __init__(self, port: SerialPort) -> None:
        self.port = port

    def scan(self, baud_rates: tuple[int, ...]) -> Iterator[Found]:
        """Every device that answers, at each of the baud rates in turn."""
        for baud in baud_rates:
            self.port.set_baud(baud)
            yield from self.scan_here()

    def change_id(self, old: int, new: int) -> None:
        """Change the id of a servo. Raises `DriverError` if `old` does not answer or `new` is in use."""
        if not self.answers(old):
            raise DriverError(f"port {self.port.path}: id {old} does not answer at {self.port.baud} baud")
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
    def write_id(self, old: int, new: int) -> None:
        """Write the id of a servo."""

    def reboot(self, id_: int) -> None:
        """Restart a servo: torque goes off, hardware errors are cleared. Raises `DriverError`."""
        raise DriverError(f"servos of protocol {self.protocol} cannot reboot: switch their power off and on")


def model_name(number: int) -> str:
    """Name of a model number in the catalogue."""
    names = [servo.name for servo in catalogue().values() if servo.model_number == number]
    return " or ".join(names) if names else f"model {number}"
