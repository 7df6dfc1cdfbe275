"""`SumBus`: base of emulated buses whose packets end in a sum."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable
from typing import ClassVar, Generic, TypeVar

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.servo import Protocol
from flexmotion.drivers.bus.packet import SumDecoder, SumFormat, SumPacket
from flexmotion.drivers.emulator.rules import Refusals
from flexmotion.drivers.emulator.servo import Joints
from flexmotion.drivers.emulator.wire import Reply, mix


class SumServo(ABC):
    """One servo of such a bus.

    Attributes:
        off_until: time until which it receives nothing, after a loss of power [s].
        refusals: number of refusals by the name of their rule.
        eeprom_writes, ram_writes: number of registers, or settings, that were written by packets.
    """

    def __init__(self, protocol: Protocol) -> None:
        self.off_until = 0.0
        self.refusals = Refusals(protocol)
        self.eeprom_writes = self.ram_writes = 0

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

    @property
    def refusals(self) -> Counter[str]:
        """See `EmulatedBus`."""
        return sum((servo.refusals for servo in self.servos), Counter())

    def may_be_answered(self, data: bytes) -> bool:
        """See `EmulatedBus`."""
        return True

    def receive(self, data: bytes, baud: int, now: float) -> list[tuple[int, list[Reply]]]:
        """See `EmulatedBus`."""
        answers = []
        for packet in self._decoder.feed(data):
            self.received += 1
            replies: list[list[Reply]] = []
            for layer in self._layers(baud, now):
                replies.append(self.answer(packet, layer))
            answers.append((packet.size, mix(replies)))
            self.joints.commit()
        return answers

    def _layers(self, baud: int, now: float) -> list[dict[int, ServoKind]]:
        """Servos that receive, by id; those whose id another one has too in a layer of their own."""
        layers: list[dict[int, ServoKind]] = [{}]
        for servo in self.servos:
            if servo.baud == baud and now >= servo.off_until and servo.address not in self.dead:
                layer = next((layer for layer in layers if servo.address not in layer), None)
                if layer is None:
                    layers.append(layer := {})
                layer[servo.address] = servo
        return layers

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
