"""Checks a servo against the robot file and writes the settings that it must have."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.packet import SumFormat
from flexmotion.drivers.bus.sum_client import SumClient
from flexmotion.drivers.dynamixel.layout import Layout
from flexmotion.drivers.dynamixel.registers import RETURN_DELAY_US, Table, table_of
from flexmotion.drivers.dynamixel.sdk import Client

PROTOCOL_1 = SumFormat(header=0xFF, counted=2)
PROTOCOL_1_PING = 0x01
ANOTHER_PROTOCOL = "set its protocol_type to 2.0 if it has one, otherwise it needs a driver plug-in"

POSITION_MODE, CURRENT_POSITION_MODE = 3, 5


@dataclass(frozen=True)
class Audited:
    """A servo that was checked and set up.

    Attributes:
        fast: whether it answers fast sync reads.
        position_limits, current_limit: its own limits of goals, read after it was set up [servo units].
        changes: what was written to EEPROM, each `register old -> new`.
    """

    fast: bool
    position_limits: tuple[int, int]
    current_limit: float
    changes: tuple[str, ...]


def expected_settings(robot: Robot, joint: int, layout: Layout) -> dict[str, int]:
    """Values that the registers of a joint's servo must have, by name; only registers that the servo has."""
    config, servo = robot.joints[joint], robot.servos[joint]
    table = table_of(servo.name)
    ticks = sorted(
        (angle * config.direction + config.zero) / servo.tick_rad + servo.centre_tick for angle in config.limits
    )
    margin = robot.safety.standing_margin / servo.tick_rad
    settings = {
        # in EEPROM
        "return_delay_time": round(robot.config.buses[config.bus].return_delay_us / RETURN_DELAY_US),
        "drive_mode": 0,
        "operating_mode": CURRENT_POSITION_MODE if layout.bounded else POSITION_MODE,
        "homing_offset": 0,
        "min_position_limit": max(math.floor(ticks[0] - margin), servo.min_tick),
        "max_position_limit": min(math.ceil(ticks[1] + margin), servo.max_tick),
        "startup_configuration": 0,
        # in RAM
        "status_return_level": 2,
        "position_p_gain": config.p_gain or servo.gain_register,
        "position_i_gain": 0,
        "position_d_gain": 0,
        "feedforward_1st_gain": 0,
        "feedforward_2nd_gain": 0,
        "profile_velocity": 0,
        "profile_acceleration": 0,
        "goal_pwm": table["pwm_limit"].initial,
        "pwm_limit": table["pwm_limit"].initial,
    }
    return {name: value for name, value in settings.items() if name in table}


def audit(client: Client, robot: Robot, joint: int, layout: Layout, *, configure: bool) -> Audited:
    """Check one servo and set it up; only settings that differ are written.

    Raises `DriverError` if the servo does not answer, has another model number or protocol, or if a setting in EEPROM
    differs and may not be written: without `configure`, or while its torque is on.
    """
    config, servo = robot.joints[joint], robot.servos[joint]
    table, id_ = table_of(servo.name), config.id
    where = f"servo of {config.name} (id {id_}) on {client.line.path}"
    model = client.ping(id_)
    if model is None:
        reason = client.line.lost or f"does not answer at {client.line.baud} baud"
        if SumClient(client.line, PROTOCOL_1).ask(id_, PROTOCOL_1_PING, answer=0, once=True) is not None:
            raise DriverError(f"{where}: uses Protocol 1, or is a Feetech servo; {ANOTHER_PROTOCOL}")
        raise DriverError(f"{where}: {reason}; is its power on? `flexmotion servo scan` finds servos at any baud rate")
    if servo.model_number is not None and model != servo.model_number:
        raise DriverError(f"{where}: model number {model}, expected {servo.model_number} of {servo.name}")
    memory = client.read_block(id_, 0, max(register.end for register in table.registers.values() if register.end < 128))
    if _value(table, memory, "protocol_type") != 2:
        raise DriverError(f"{where}: uses another protocol than 2.0; {ANOTHER_PROTOCOL}")
    firmware = _value(table, memory, "firmware_version")
    torque_on = bool(_value(table, memory, "torque_enable"))
    wrong = {
        name: value
        for name, value in expected_settings(robot, joint, layout).items()
        if _value(table, memory, name) != value
    }
    kept = [name for name in wrong if table[name].address < table.eeprom_end]
    if kept and not configure:
        difference = _difference(table, memory, kept[0], wrong)
        raise DriverError(f"{where}: {difference}; option configure (--configure) would write it")
    if kept and torque_on:
        raise DriverError(
            f"{where}: {_difference(table, memory, kept[0], wrong)}, and torque is on, which locks it: "
            "hold the robot and switch its power off and on"
        )
    for name, value in wrong.items():
        client.write(id_, table[name], value)
    _point(client, id_, layout)
    lowest = table.fast_sync_read_firmware
    limits = {name: client.read(id_, table[name]) for name in ("min_position_limit", "max_position_limit")}
    return Audited(
        fast=lowest is not None and firmware >= lowest,
        position_limits=(limits["min_position_limit"], limits["max_position_limit"]),
        current_limit=client.read(id_, table["current_limit"]) if "current_limit" in table else math.inf,
        changes=tuple(f"{name} {_value(table, memory, name)} -> {wrong[name]}" for name in kept),
    )


def _value(table: Table, memory: bytes, name: str) -> int:
    register = table[name]
    return register.unpack(memory[register.address : register.end])


def _difference(table: Table, memory: bytes, name: str, wrong: dict[str, int]) -> str:
    return f"{name} is {_value(table, memory, name)}, expected {wrong[name]}"


def _point(client: Client, id_: int, layout: Layout) -> None:
    """Set the indirect addresses of the layout."""
    first = layout.slots[0][0]
    wanted = b"".join(target.to_bytes(2, "little") for _, target in layout.slots)
    if client.read_block(id_, first, len(wanted)) != wanted:
        client.write_block(id_, first, wanted)
