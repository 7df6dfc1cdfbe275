"""For all bytes received on the bus, a driver neither crashes nor waits longer than its share of the tick."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.bus.driver import READ_SHARE, BusDriver
from flexmotion.drivers.dynamixel.bus import DynamixelBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.port import SerialPort

from .robots import looped, op3_with

PERIOD = 1 / 125


class NoisyPort(SerialPort):
    """A port that drops what is sent; a test sets the bytes received, a piece at a time.

    Attributes:
        pieces: still to come.
    """

    def __init__(self, real: SerialPort, world: Loopback) -> None:
        self.path, self.baud, self.lost, self.sent, self.busy_until = real.path, real.baud, None, 0, 0.0
        self.pieces: list[bytes] = []
        self._world = world
        self._asked = False

    def send(self, data: bytes) -> None:
        self._count(data)
        self._asked = True

    def receive(self) -> bytes:
        return self.pieces.pop(0) if self.pieces and self._asked else b""

    def wait_any(self, ports: Sequence[SerialPort], seconds: float) -> None:
        self._world.now += 0.0001 if self.pieces else max(seconds, 1e-6)

    def now(self) -> float:
        return self._world.now

    def sleep(self, seconds: float) -> None:
        self._world.now += max(seconds, 0.0)


class Noise:
    """A driver that is opened on a healthy bus, which is then cut off.

    Attributes:
        reply: what a healthy bus answers to the driver's first question of a cycle.
    """

    def __init__(self, name: str, robot: Robot) -> None:
        self.driver: BusDriver
        self.driver, world = looped(name, robot)
        self.driver.open()
        self.state, self.command = RobotState(robot.n), JointCommand(robot.n)
        self.driver.read(self.state)
        self.driver.set_torque(True)
        self.command.position[:] = robot.stand_pose
        bus = self.driver.buses[0]
        bus.port.receive()
        bus.request(world.now)
        world.advance(0.02)
        self.reply = bus.port.receive()
        bus.finish()
        self.port = bus.port = NoisyPort(bus.port, world)
        if isinstance(bus, DynamixelBus):
            bus.cycle.port = self.port
        self.world = world

    def suffer(self, pieces: list[bytes]) -> None:
        self.port.pieces = list(pieces)
        begin = self.world.now
        self.driver.read(self.state)
        self.driver.write(self.command)
        assert self.world.now - begin <= READ_SHARE * PERIOD + 0.001
        assert np.isfinite(self.state.position).all()


@pytest.fixture(scope="module")
def suffering(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Noise]:
    robots = {
        "dynamixel": load_robot("op3"),
        "feetech": op3_with(tmp_path_factory.mktemp("feetech"), servo="STS3215-12V", baud=1_000_000),
        "lx16a": op3_with(tmp_path_factory.mktemp("lx16a"), servo="LX-16A", baud=115_200),
    }
    return {name: Noise(name, robot) for name, robot in robots.items()}


@pytest.mark.parametrize("name", ["dynamixel", "feetech", "lx16a"])
@settings(max_examples=400)
@given(data=st.data())
def test_no_bytes_crash_or_hang_a_driver(suffering: dict[str, Noise], name: str, data: st.DataObject) -> None:
    noise = suffering[name]
    reply = noise.reply
    cut = st.integers(0, len(reply)).map(lambda at: reply[:at])
    tail = st.integers(0, len(reply)).map(lambda at: reply[at:])
    flipped = st.tuples(st.integers(0, max(len(reply) - 1, 0)), st.integers(1, 255)).map(
        lambda flip: bytes(byte ^ (flip[1] if at == flip[0] else 0) for at, byte in enumerate(reply))
    )
    noise.suffer(data.draw(st.lists(st.one_of(st.binary(max_size=60), cut, tail, flipped), max_size=4)))
