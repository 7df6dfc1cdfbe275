"""A robot's emulated servos on the port `main` of this process."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.dynamixel_bus import EmulatedDynamixelBus
from flexmotion.drivers.emulator.loopback import Loopback

from ...drivers.bus.wire_tap import WireTap

PORT = ["--port", "main"]
KNEE = 14
TORQUE_ENABLE = 64
"""Id of the left knee, and a register that every servo of OP3 has."""


class Wired:
    """A robot's emulated servos on the port `main` of this process, and the bytes that commands send to them."""

    def __init__(
        self,
        robot: Robot,
        monkeypatch: pytest.MonkeyPatch,
        *,
        factory: bool,
        new: Sequence[str] = (),
        simulated_clock: bool = True,
    ) -> None:
        self.robot, self.world = robot, Loopback(BenchBody(robot), factory=factory, new=new)
        self.tap = WireTap(self.world)
        for module in ("flexmotion.drivers.bench", "flexmotion.drivers.bus.driver", "flexmotion.drivers.port"):
            monkeypatch.setattr(f"{module}.SerialPort", self.world.open_port)
        if not simulated_clock:  # commands with processes of their own
            return
        for clock in ("monotonic", "perf_counter"):
            monkeypatch.setattr(f"time.{clock}", lambda: self.world.now)
        monkeypatch.setattr("time.sleep", self.world.advance)

    @property
    def bus(self) -> EmulatedDynamixelBus:
        bus = self.world.emulator.lines[0].bus  # type: ignore[attr-defined]
        assert isinstance(bus, EmulatedDynamixelBus)
        return bus

    def servo(self, id_: int) -> object:
        return next(servo for servo in self.bus.servos if servo.id == id_)

    def memories(self) -> list[bytes]:
        """EEPROM of every servo."""
        return [bytes(servo.memory[: servo.table.eeprom_end]) for servo in self.bus.servos]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))


@pytest.fixture
def wired(folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Wired]:
    monkeypatch.chdir(tmp_path)

    def make(*, factory: bool = False, new: Sequence[str] = (), simulated_clock: bool = True) -> Wired:
        return Wired(load_robot(folder), monkeypatch, factory=factory, new=new, simulated_clock=simulated_clock)

    return make
