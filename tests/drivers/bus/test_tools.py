from __future__ import annotations

from pathlib import Path

import pytest

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.bus.tools import BusTools, Found
from flexmotion.drivers.dynamixel.tools import DynamixelTools
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.dynamixel_bus import EmulatedDynamixelBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.lx16a_bus import EmulatedLx16aBus
from flexmotion.drivers.feetech.tools import FeetechTools
from flexmotion.drivers.lx16a.tools import Lx16aTools

from .robots import op3_with

IDS = list(range(1, 21))


def bench(kind: type[BusTools], robot: Robot) -> tuple[BusTools, Loopback]:
    world = Loopback(BenchBody(robot))
    return kind(world.open_port("main", robot.config.buses["main"].baud)), world


@pytest.fixture(params=["dynamixel", "feetech", "lx16a"])
def tools(request: pytest.FixtureRequest, tmp_path: Path) -> BusTools:
    if request.param == "dynamixel":
        return bench(DynamixelTools, load_robot("op3"))[0]
    if request.param == "feetech":
        return bench(FeetechTools, op3_with(tmp_path, servo="STS3215-12V", baud=1_000_000))[0]
    return bench(Lx16aTools, op3_with(tmp_path, servo="LX-16A", baud=115_200))[0]


def test_a_scan_finds_every_servo_once(tools: BusTools) -> None:
    found = list(tools.scan(tools.baud_rates[:4] if len(tools.baud_rates) > 1 else tools.baud_rates))
    if tools.protocol == "dynamixel2":
        assert not found  # OP3's bus runs at 2 M, the fifth rate
        found = list(tools.scan((2_000_000,)))
        assert found[-1] == Found(2_000_000, 200, "OpenCR board", 5)
        found = found[:-1]
    assert [each.id for each in found] == IDS


def test_an_id_is_changed_and_never_used_twice(tools: BusTools) -> None:
    tools.change_id(14, 77)
    assert tools.answers(77) and not tools.answers(14)
    with pytest.raises(DriverError, match="id 14 does not answer"):
        tools.change_id(14, 78)
    with pytest.raises(DriverError, match="id 3 is taken"):
        tools.change_id(77, 3)


def test_a_reboot_clears_a_shutdown(tools: BusTools) -> None:
    if not isinstance(tools, DynamixelTools):
        with pytest.raises(DriverError, match="cannot reboot"):
            tools.reboot(14)
        return
    robot = load_robot("op3")
    kind, world = bench(DynamixelTools, robot)
    bus = world.emulator.lines[0].bus
    assert isinstance(bus, EmulatedDynamixelBus)
    knee = next(servo for servo in bus.servos if servo.id == 14)
    knee.write(64, b"\x01")
    knee.fail(0x20)
    assert not knee.torque and knee.alert
    kind.reboot(14)
    assert not knee.alert


def test_the_id_of_a_dynamixel_is_locked_by_its_torque() -> None:
    kind, world = bench(DynamixelTools, load_robot("op3"))
    bus = world.emulator.lines[0].bus
    assert isinstance(bus, EmulatedDynamixelBus)
    bus.servos[0].write(64, b"\x01")
    with pytest.raises(DriverError, match="torque is on, which locks the id"):
        kind.change_id(bus.servos[0].id, 99)


@pytest.mark.parametrize("lost", [1, 99])
def test_torque_off_of_an_lx16a_is_proven(lost: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: `servo calibrate` sent it once, and did not look."""
    robot = op3_with(tmp_path, servo="LX-16A", baud=115_200)
    tools, world = bench(Lx16aTools, robot)
    bus, knee = world.emulator.lines[0].bus, robot.index("l_knee")
    assert isinstance(bus, EmulatedLx16aBus)
    servo = bus.servos[knee]
    servo.load(True)
    load, missed = servo.load, []

    def lossy(on: bool) -> None:
        missed.append(on)
        if len(missed) > lost:
            load(on)

    monkeypatch.setattr(servo, "load", lossy)
    if lost == 1:
        tools.torque_off(robot, knee)
        assert not servo.loaded
    else:
        with pytest.raises(DriverError, match=r"l_knee \(id 14\) on main: torque does not go off"):
            tools.torque_off(robot, knee)
