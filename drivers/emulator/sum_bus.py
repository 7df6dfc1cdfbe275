"""`SumBus`: base of emulated buses whose packets end in a sum."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import ClassVar, Generic, TypeVar

from flexmotion.configs.errors import ConfigError
from flexmotion.drivers.bus.packet import SumDecoder, SumFormat, SumPacket
from flexmotion.drivers.emulator.servo import Joints
from flexmotion.drivers.emulator.wire import Reply


class SumServo(ABC):
    """One servo of such a bus.

    Attributes:
        off_until: time until which it receives nothing, after a loss of power [s].
    """

    def __init__(self) -> None:
        self.off_until = 0.0

    @property
    @abstractmethod
    def address(self) -> int:
        """Its id."""

    @property
    @abstractmethod
    def baud(self) -> int:
        """Its bit rate."""

    @abstractmethod
    def watch(self) -> None:
        """Update errors from temperature and voltage."""

    @abstractmethod
    def restart(self, now: float) -> None:
        """Interrupt the power."""


ServoKind = TypeVar("ServoKind", bound=SumServo)


class SumBus(ABC, Generic[ServoKind]):
    """See `flexmotion.drivers.emulator.line.EmulatedBus`.

    Class attributes:
        form: format of its packets.
    """

    form: ClassVar[SumFormat]

    def __init__(self, joints: Joints, servos: Iterable[ServoKind]) -> None:
        self.joints, self.servos = joints, list(servos)
        self.dead: set[int] = set()
        self.received = 0
        self.imu_ids: frozenset[int] = frozenset()
        self._decoder = SumDecoder(self.form)

    @property
    def bad(self) -> int:
        """See `EmulatedBus`."""
        return self._decoder.bad

    def may_be_answered(self, data: bytes) -> bool:
        """See `EmulatedBus`."""
        return True

    def receive(self, data: bytes, baud: int, now: float) -> list[tuple[int, list[Reply]]]:
        """See `EmulatedBus`."""
        answers = []
        for packet in self._decoder.feed(data):
            self.received += 1
            listening = {
                servo.address: servo
                for servo in self.servos
                if servo.baud == baud and now >= servo.off_until and servo.address not in self.dead
            }
            answers.append((packet.size, self.answer(packet, listening)))
            self.joints.commit()
        return answers

    @abstractmethod
    def answer(self, packet: SumPacket, listening: dict[int, ServoKind]) -> list[Reply]:
        """Answers to a packet of the servos that receive it; `listening`: by id."""

    def drop_incomplete(self) -> None:
        """See `EmulatedBus`."""
        self._decoder.clear()

    def watch(self, now: float) -> None:
        """See `EmulatedBus`."""
        for servo in self.servos:
            servo.watch()

    def reset(self, id_: int, now: float) -> None:
        """See `EmulatedBus`."""
        for servo in self.servos:
            if servo.address == id_:
                servo.restart(now)

    def trip(self, id_: int) -> None:
        """See `EmulatedBus`."""
        raise ConfigError(f"fault tripped:{id_}: servos of this protocol have no bus watchdog")
