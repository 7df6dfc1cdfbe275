"""The P series: RAM from 512 on, indirect addresses in EEPROM, positions of four bytes, other units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot
from flexmotion.configs.servo import catalogue, find_servo
from flexmotion.drivers.bus.inspection import NotConfiguredError
from flexmotion.drivers.dynamixel.layout import layout_of
from flexmotion.drivers.dynamixel.registers import table_of
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.dynamixel.tools import DynamixelTools
from flexmotion.drivers.emulator.dynamixel_bus import EmulatedDynamixelBus
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.registry import create

from ..bus.robots import looped, op3_with

MODELS = [name for name in catalogue() if name.startswith(("PH", "PM"))]


@pytest.fixture
def strong(tmp_path: Path) -> Robot:
    return op3_with(tmp_path, servo="PM54-060-S250-R", baud=2_000_000)


@pytest.mark.parametrize("model", MODELS)
def test_table_and_catalogue_agree(model: str) -> None:
    table, servo = table_of(model), find_servo(model)
    limits = table["max_position_limit"].range
    assert limits == (servo.min_tick, servo.max_tick) and servo.centre_tick == 0
    assert servo.current_unit is not None and servo.stall_current / servo.current_unit < table["current_limit"].initial
    assert table["torque_enable"].address == table.eeprom_end == 512 and table.keeps_indirect
    layout = layout_of(table, current_bound=True)
    assert layout.read.size == 13 and not layout.bounded and all(target >= 512 for _, target in layout.slots)


def test_a_factory_new_servo_is_configured_once_and_then_nothing_is_written(strong: Robot) -> None:
    driver, world = looped("dynamixel", strong)
    bus = world.emulator.lines[0].bus
    assert isinstance(bus, EmulatedDynamixelBus)
    for servo in bus.servos:
        servo.put("indirect_address_3", 700)
    with pytest.raises(NotConfiguredError, match=r"indirect_address_3 is 700, the robot file wants 581"):
        driver.open()
    assert not any(servo.eeprom_writes for servo in bus.servos)
    tools = DynamixelTools(world.open_port("main", 2_000_000))
    for joint in range(strong.n):
        tools.write_settings(strong, joint, tools.inspect(strong, joint).changes)
    assert [servo.eeprom_writes for servo in bus.servos] == [1] * strong.n
    for _ in range(2):
        with driver:
            driver.read(RobotState(strong.n))
    assert [servo.eeprom_writes for servo in bus.servos] == [1] * strong.n and not bus.refusals


def test_joints_are_read_and_follow_goals(strong: Robot) -> None:
    driver, world = looped("dynamixel", strong)
    state, command = RobotState(strong.n), JointCommand(strong.n)
    body = world.emulator.body
    with driver:
        driver.read(state)
        np.testing.assert_allclose(state.position, body.position, atol=2e-5)
        driver.set_torque(True)
        command.position[:] = state.position
        for _ in range(60):
            command.position[6] += 0.004
            driver.write(command)
            world.advance(0.008)
            driver.read(state)
        assert abs(state.position[6] - command.position[6]) < 0.05 and not state.stale.any()
        assert state.velocity[6] == pytest.approx(0.5, abs=0.2)
        np.testing.assert_allclose(state.voltage, body.plant.voltage, atol=0.1)
    assert driver.violations == 0 and body.receiver.violations == 0 and not body.plant.enabled.any()


def test_its_watchdog_stops_it_and_is_cleared(strong: Robot) -> None:
    driver, world = looped("dynamixel", strong)
    state, command = RobotState(strong.n), JointCommand(strong.n)
    with driver:
        driver.read(state)
        driver.set_torque(True)
        command.position[:] = state.position
        world.emulator.lines[0].bus.trip(14)
        for _ in range(12):
            driver.read(state)
            driver.write(command)
            world.advance(0.008)
        servo = next(one for one in world.emulator.lines[0].bus.servos if one.id == 14)
        assert servo.get("bus_watchdog") == 8 and not state.hardware_error.any()


def test_a_restart_keeps_its_indirect_addresses(strong: Robot) -> None:
    driver, world = looped("dynamixel", strong)
    state = RobotState(strong.n)
    with driver:
        driver.read(state)
        driver.reboot(np.arange(strong.n) == 3)
        ended = ()
        for _ in range(300):
            driver.read(state)
            world.advance(0.008)
            ended = ended or driver.take_restarted()
        assert list(ended) == [(3, None)] and not state.stale.any()
    assert not any(servo.eeprom_writes for servo in world.emulator.lines[0].bus.servos)


def test_a_current_bound_is_refused(tmp_path: Path) -> None:
    robot = op3_with(tmp_path, servo="PH42-020-S300-R", baud=2_000_000, current_bound=True)
    with pytest.raises(ConfigError, match=r"current_bound: servo PH42-020-S300-R of .* no current-based position mode"):
        create("dynamixel", robot, port="main")


def test_a_rate_of_the_p_series_is_refused_for_the_x_series(tmp_path: Path) -> None:
    create("dynamixel", op3_with(tmp_path, servo="PM42-010-S260-R", baud=6_000_000), port="main")
    with pytest.raises(ConfigError, match=r"buses.main.baud: 6000000, expected one of \[9600, .* 4500000\]"):
        create("dynamixel", op3_with(tmp_path, servo="XM430-W350", baud=6_000_000), port="main")


@pytest.mark.parametrize(
    ("before", "name", "value", "error", "rule"),
    [
        ({"torque_enable": 1}, "indirect_address_1", 580, "access", "eeprom_locked"),
        ({}, "indirect_address_1", 64, "range", "out_of_range"),
        ({}, "operating_mode", 5, "range", "out_of_range"),
        ({"max_position_limit": 1000}, "goal_position", 1001, "limit", "over_limit"),
        ({"pwm_limit": 900}, "goal_pwm", 901, "limit", "over_limit"),
        ({"torque_enable": 1}, "max_position_limit", 5, "access", "eeprom_locked"),
    ],
)
def test_the_emulated_servo_refuses_as_the_manual_says(
    strong: Robot, before: dict[str, int], name: str, value: int, error: str, rule: str
) -> None:
    _, world = looped("dynamixel", strong)
    bus = world.emulator.lines[0].bus
    client, table = Client(world.open_port("main", 2_000_000)), table_of("PM54-060-S250-R")
    for other, held in before.items():
        client.write(14, table[other], held)
    with pytest.raises(DriverError, match=rf"refused: {error} error"):
        client.write(14, table[name], value)
    assert bus.refusals[rule] == 1
