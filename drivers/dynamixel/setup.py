"""Settings of a Dynamixel: reads and checks them, writes those in RAM for a run, and those in EEPROM on request."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.inspection import Inspection
from flexmotion.drivers.bus.packet import SumFormat
from flexmotion.drivers.bus.sum_client import SumClient
from flexmotion.drivers.dynamixel.layout import Layout
from flexmotion.drivers.dynamixel.registers import RETURN_DELAY_US, Table, table_of
from flexmotion.drivers.dynamixel.sdk import Client

PROTOCOL_1 = SumFormat(header=0xFF, counted=2)
PROTOCOL_1_PING = 0x01
ANOTHER_PROTOCOL = "set its protocol_type to 2.0 if it has one, otherwise it needs a driver plug-in"

POSITION_MODE, CURRENT_POSITION_MODE = 3, 5
NO_SECONDARY_ID = 255
ANSWER_ALL = 2
"""Status return level at which every instruction is answered."""


@dataclass(frozen=True)
class Found:
    """A servo as it was read.

    Attributes:
        table: its control table.
        memory: the registers at the start of the table.
        inspection: its settings in EEPROM.
    """

    table: Table
    memory: bytes
    inspection: Inspection

    def value(self, name: str) -> int:
        """A register."""
        return _value(self.table, self.memory, name)


@dataclass(frozen=True)
class Prepared:
    """A servo that is ready for a run.

    Attributes:
        fast: whether it answers fast sync reads.
        position_limits, current_limit: its own limits of goals [servo units].
    """

    fast: bool
    position_limits: tuple[int, int]
    current_limit: float


def kept_settings(robot: Robot, joint: int) -> dict[str, int]:
    """Values that the EEPROM of a joint's servo must have, by name, in the order in which they must be written.

    The mode comes first, because a change of it resets goals to their limits; the limits come next.
    """
    config, servo = robot.joints[joint], robot.servos[joint]
    table, bus = table_of(servo.name), robot.config.buses[config.bus]
    ticks = sorted(
        (angle * config.direction + config.zero) / servo.tick_rad + servo.centre_tick for angle in config.limits
    )
    margin = robot.safety.standing_margin / servo.tick_rad
    bounded = bus.current_bound and "goal_current" in table
    settings = {
        "operating_mode": CURRENT_POSITION_MODE if bounded else POSITION_MODE,
        "drive_mode": 0,
        "homing_offset": 0,
        "min_position_limit": max(math.floor(ticks[0] - margin), servo.min_tick),
        "max_position_limit": min(math.ceil(ticks[1] + margin), servo.max_tick),
        "pwm_limit": table["pwm_limit"].initial,
        "return_delay_time": round(bus.return_delay_us / RETURN_DELAY_US),
        "secondary_id": NO_SECONDARY_ID,
        "shutdown": table["shutdown"].initial,
        "startup_configuration": 0,
    }
    return {name: value for name, value in settings.items() if name in table}


def run_settings(robot: Robot, joint: int) -> dict[str, int]:
    """Values that the RAM of a joint's servo must have for a run, by name, in the order in which they must be written.

    The goal PWM comes last: it must not be greater than the PWM limit.
    """
    config, servo = robot.joints[joint], robot.servos[joint]
    table = table_of(servo.name)
    settings = {
        "position_p_gain": config.p_gain or servo.gain_register,
        "position_i_gain": 0,
        "position_d_gain": 0,
        "feedforward_1st_gain": 0,
        "feedforward_2nd_gain": 0,
        "profile_velocity": 0,
        "profile_acceleration": 0,
        "goal_pwm": table["pwm_limit"].initial,
    }
    return {name: value for name, value in settings.items() if name in table}


def find(client: Client, robot: Robot, joint: int, present_id: int | None = None) -> Found:
    """Read a joint's servo, which may have another id at present; nothing is written.

    Raises `DriverError` if the servo does not answer, or has another model number or protocol.
    """
    config, servo = robot.joints[joint], robot.servos[joint]
    table, id_ = table_of(servo.name), config.id if present_id is None else present_id
    where = f"servo of {config.name} (id {id_}) on {client.line.path}"
    model = client.ping(id_)
    if model is None:
        reason = client.line.lost or f"does not answer at {client.line.baud} baud"
        if SumClient(client.line, PROTOCOL_1).ask(id_, PROTOCOL_1_PING, answer=0, once=True) is not None:
            raise DriverError(f"{where}: uses Protocol 1, or is a Feetech servo; {ANOTHER_PROTOCOL}")
        raise DriverError(f"{where}: {reason}; is its power on? `flexmotion servo scan` finds servos at any baud rate")
    if servo.model_number is not None and model != servo.model_number:
        raise DriverError(f"{where}: model number {model}, expected {servo.model_number} of {servo.name}")
    memory = read_head(client, id_, table)
    if memory is None:
        raise DriverError(
            f"{where}: answers a ping and no read: its status return level is 0; `flexmotion servo configure` changes "
            "it until the power is switched off"
        )
    if _value(table, memory, "protocol_type") != 2:
        raise DriverError(f"{where}: uses another protocol than 2.0; {ANOTHER_PROTOCOL}")
    wanted = kept_settings(robot, joint)
    held = {name: _value(table, memory, name) for name in wanted}
    torque_on = bool(_value(table, memory, "torque_enable"))
    inspection = Inspection(config.name, id_, servo.name, client.line.path, held, wanted, torque_on)
    return Found(table, memory, inspection)


def read_head(client: Client, id_: int, table: Table) -> bytes | None:
    """The registers from the start of the table to the goals; None if a servo that answers pings answers no read."""
    try:
        return client.read_block(id_, 0, table["goal_position"].end)
    except DriverError:
        if client.line.lost is not None:
            raise
        return None


def prepare(client: Client, robot: Robot, joint: int, layout: Layout, found: Found) -> Prepared:
    """Write the settings in RAM that differ. EEPROM is not written. Raises `DriverError` if a write is refused."""
    table, id_ = found.table, robot.joints[joint].id
    for name, value in run_settings(robot, joint).items():
        if found.value(name) != value:
            client.write(id_, table[name], value)
    _point(client, id_, layout)
    lowest = table.fast_sync_read_firmware
    return Prepared(
        fast=lowest is not None and found.value("firmware_version") >= lowest,
        position_limits=(found.value("min_position_limit"), found.value("max_position_limit")),
        current_limit=found.value("current_limit") if "current_limit" in table else math.inf,
    )


def write_kept(client: Client, robot: Robot, joint: int, settings: Mapping[str, int]) -> None:
    """Write settings in EEPROM, in the order of `kept_settings`, and read them back.

    Raises `DriverError` if one is refused or not kept.
    """
    config, table = robot.joints[joint], table_of(robot.servos[joint].name)
    for name in kept_settings(robot, joint):
        if name not in settings:
            continue
        client.write(config.id, table[name], settings[name])
        held = client.read(config.id, table[name])
        if held != settings[name]:
            where = f"servo of {config.name} (id {config.id}) on {client.line.path}"
            raise DriverError(f"{where}: {name} is {held} after {settings[name]} was written")


def _value(table: Table, memory: bytes, name: str) -> int:
    register = table[name]
    return register.unpack(memory[register.address : register.end])


def _point(client: Client, id_: int, layout: Layout) -> None:
    """Set the indirect addresses of the layout."""
    first = layout.slots[0][0]
    wanted = b"".join(target.to_bytes(2, "little") for _, target in layout.slots)
    if client.read_block(id_, first, len(wanted)) != wanted:
        client.write_block(id_, first, wanted)
