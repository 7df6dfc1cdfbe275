"""Emulated buses with servos on a bench."""

from __future__ import annotations

import pytest

from flexmotion.configs.robot import Robot
from flexmotion.drivers.dynamixel.packet import Decoder, Instruction, Packet, encode
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.build import make_bus
from flexmotion.drivers.emulator.dynamixel_bus import EmulatedDynamixelBus
from flexmotion.drivers.emulator.servo import Joints, XServo


class Host:
    """Exchanges bytes with a bus of servos with factory settings, without a port, on a simulated clock.

    Attributes:
        bus, body: what it speaks to, and what moves behind.
        now: the time [s].
    """

    def __init__(self, robot: Robot) -> None:
        self.body = BenchBody(robot)
        bus = make_bus(Joints(self.body), "main", factory=True)
        assert isinstance(bus, EmulatedDynamixelBus)
        self.bus, self.baud, self.now = bus, robot.config.buses["main"].baud, 0.0

    def send(self, id_: int, instruction: int, params: bytes = b"") -> list[Packet]:
        """Status packets that answer an instruction."""
        return self.send_bytes(encode(id_, instruction, params))

    def send_bytes(self, data: bytes) -> list[Packet]:
        """Status packets that answer bytes."""
        answers = b"".join(self.raw(data))
        return list(Decoder().feed(answers))

    def raw(self, data: bytes) -> list[bytes]:
        """Bytes of each answer to bytes."""
        return [reply.data for _, replies in self.bus.receive(data, self.baud, self.now) for reply in replies]

    def read(self, id_: int, name: str) -> int:
        """A register's value, signed as in the table."""
        register = self.servo(id_).table[name]
        (answer,) = self.send(id_, Instruction.READ, _span(register.address, register.size))
        assert answer.params[0] & 0x7F == 0
        return register.unpack(answer.params[1:])

    def write(self, id_: int, name: str, value: int) -> int:
        """Write a register; the error in the answer."""
        register = self.servo(id_).table[name]
        params = register.address.to_bytes(2, "little") + register.pack(value)
        (answer,) = self.send(id_, Instruction.WRITE, params)
        return answer.params[0] & 0x7F

    def servo(self, id_: int) -> XServo:
        """The servo with this id."""
        return next(servo for servo in self.bus.servos if servo.id == id_)

    def live(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / 0.01)):
            self.now += 0.01
            self.body.step(0.01)
            self.bus.watch(self.now)


def _span(address: int, size: int) -> bytes:
    return address.to_bytes(2, "little") + size.to_bytes(2, "little")


@pytest.fixture
def host(op3: Robot) -> Host:
    return Host(op3)
