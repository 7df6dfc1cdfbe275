"""Settings of a Dynamixel: reads and checks them, writes those in RAM for a run, and those in EEPROM on request."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.attempts import DAMAGED
from flexmotion.drivers.bus.inspection import Inspection, refuse_unconfigured
from flexmotion.drivers.bus.packet import SumFormat
from flexmotion.drivers.bus.sum_client import SumClient
from flexmotion.drivers.bus.tools import model_name
from flexmotion.drivers.dynamixel.layout import CURRENT_POSITION_MODE, Layout, bounds_current, layout_of
from flexmotion.drivers.dynamixel.packet import Instruction, encode
from flexmotion.drivers.dynamixel.registers import BAUD_RATES, RETURN_DELAY_US, Table, table_of
from flexmotion.drivers.dynamixel.sdk import Client

PROTOCOL_1 = SumFormat(header=0xFF, counted=2)
PROTOCOL_1_PING = 0x01
ANOTHER_PROTOCOL = "set its protocol_type to 2.0 if it has one, otherwise it needs a driver plug-in"

POSITION_MODE = 3
NO_SECONDARY_ID = 255
_MOST_SLOTS = 24
"""Indirect addresses that are read, more than any layout has."""
ANSWER_ALL = 2
"""Status return level at which every instruction is answered."""

BOOT_S, LONGEST_BOOT_S, BOOT_LOOK_S = 0.3, 2.0, 0.2
"""Time after a reboot in which a servo is not asked, time after which it counts as silent, and time between two looks
[s] (assumptions: the e-Manual gives no time)."""


class UnreadableError(DriverError):
    """A servo answers pings, and reads only after `ANSWER_ALL` has been written."""


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


def check_settings(robot: Robot, name: str) -> None:
    """Raise `ConfigError` if the servos of a bus cannot have the settings that the robot file gives the bus."""
    bus = robot.config.buses[name]
    for joint, servo in zip(robot.joints, robot.servos, strict=True):
        if joint.bus != name:
            continue
        table = table_of(servo.name)
        codes = table["baud_rate"].range
        rates = BAUD_RATES if codes is None else BAUD_RATES[: codes[1] + 1]
        if bus.baud not in rates:
            raise ConfigError(f"{robot.file}: field buses.{name}.baud: {bus.baud}, expected one of {list(rates)}")
        if bus.current_bound and "goal_current" in table and not bounds_current(table):
            raise ConfigError(
                f"{robot.file}: field buses.{name}.current_bound: servo {servo.name} of {joint.name} has no "
                "current-based position mode"
            )


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
    bounded = bus.current_bound and bounds_current(table)
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
    if table.keeps_indirect:
        slots = layout_of(table, current_bound=bus.current_bound).slots
        settings |= {f"indirect_address_{number}": target for number, (_, target) in enumerate(slots, 1)}
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

    Raises `DriverError` if the servo does not answer, or has another model number or protocol, `UnreadableError` if its
    status return level is 0.
    """
    config, servo = robot.joints[joint], robot.servos[joint]
    table, id_ = table_of(servo.name), config.id if present_id is None else present_id
    where = f"servo of {config.name} (id {id_}) on {client.line.path}"
    model = client.ping(id_)
    if model is None:
        if client.damaged:
            raise DriverError(f"{where}: {DAMAGED}")
        reason = client.line.lost or f"does not answer at {client.line.baud} baud"
        if SumClient(client.line, PROTOCOL_1).ask(id_, PROTOCOL_1_PING, answer=0, once=True) is not None:
            raise DriverError(f"{where}: uses Protocol 1, or is a Feetech servo; {ANOTHER_PROTOCOL}")
        raise DriverError(f"{where}: {reason}; is its power on? `flexmotion servo scan` finds servos at any baud rate")
    if servo.model_number is not None and model != servo.model_number:
        expected = f"{servo.name} (model number {servo.model_number})"
        raise DriverError(f"{where}: is {model_name(model)} (model number {model}), the robot file has {expected}")
    memory = read_head(client, id_, table)
    if memory is None and client.damaged:
        raise DriverError(f"{where}: {DAMAGED}")
    if memory is None:
        raise UnreadableError(
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
    """The registers from the start of the table to the goals; None if a servo that answers pings answers no read.

    Where much is between the settings and the goals it is not read, and 0 here.
    """
    ram, end = table["torque_enable"].address, table["goal_position"].end
    try:
        if not table.keeps_indirect:
            return client.read_block(id_, 0, end)
        settings = client.read_block(id_, 0, table[f"indirect_address_{_MOST_SLOTS}"].end)
        return settings.ljust(ram, b"\0") + client.read_block(id_, ram, end - ram)
    except DriverError:
        if client.line.lost is not None:
            raise
        return None


def prepare(client: Client, robot: Robot, joint: int, layout: Layout, found: Found) -> Prepared:
    """Write the settings in RAM that differ. EEPROM is not written. Raises `DriverError` if a write is refused."""
    table = found.table
    for _ in _set_up(client, robot, joint, layout, found):
        pass
    lowest = table.fast_sync_read_firmware
    return Prepared(
        fast=lowest is not None and found.value("firmware_version") >= lowest,
        position_limits=(found.value("min_position_limit"), found.value("max_position_limit")),
        current_limit=found.value("current_limit") if "current_limit" in table else math.inf,
    )


def _set_up(client: Client, robot: Robot, joint: int, layout: Layout, found: Found) -> Iterator[None]:
    """Write the settings in RAM that differ, one exchange for each step."""
    table, id_ = found.table, robot.joints[joint].id
    for name, value in run_settings(robot, joint).items():
        if found.value(name) != value:
            client.write(id_, table[name], value)
            yield
    first = layout.slots[0][0]
    wanted = b"".join(target.to_bytes(2, "little") for _, target in layout.slots)
    held = client.read_block(id_, first, len(wanted))
    yield
    if held != wanted:
        client.write_block(id_, first, wanted)
        yield


def restart(client: Client, robot: Robot, joint: int, layout: Layout) -> Iterator[None]:
    """Reboot a joint's servo and set it up for a run again, one exchange for each step; its torque is off.

    The instruction is sent twice and its answer not waited for: a servo in shutdown may be slow to answer.

    Raises `DriverError` if the servo does not answer again, or reports a hardware error whose cause is not gone.
    """
    line, id_ = client.line, robot.joints[joint].id
    where = f"servo of {robot.joint_names[joint]} (id {id_}) on {line.path}"
    for _ in range(2):
        line.send(encode(id_, Instruction.REBOOT, b""))
        yield
    begun = asked = line.now()
    while line.now() < begun + BOOT_S:
        yield
    while client.ping(id_, once=True) is None:
        asked = line.now()
        if line.lost is not None or asked > begun + LONGEST_BOOT_S:
            raise DriverError(f"{where}: {line.lost or f'does not answer {LONGEST_BOOT_S:g} s after its reboot'}")
        while line.now() < asked + BOOT_LOOK_S:
            yield
    yield
    found = find(client, robot, joint)
    yield
    refuse_unconfigured([found.inspection])
    error = found.value("hardware_error_status")
    if error:
        raise DriverError(f"{where}: reports hardware error 0x{error:02x} after its reboot: its cause is not gone")
    yield from _set_up(client, robot, joint, layout, found)


def write_kept(client: Client, robot: Robot, joint: int, settings: Mapping[str, int]) -> None:
    """Write settings in EEPROM, in the order of `kept_settings`, and read them back.

    Raises `DriverError`, with joint, setting and value, if one is refused or not kept.
    """
    config, table = robot.joints[joint], table_of(robot.servos[joint].name)
    where = f"servo of {config.name} (id {config.id}) on {client.line.path}"
    for name in kept_settings(robot, joint):
        if name not in settings:
            continue
        try:
            client.write(config.id, table[name], settings[name])
        except DriverError as error:
            raise DriverError(f"{where}: {name} {settings[name]} is not written: {error}") from error
        held = client.read(config.id, table[name])
        if held != settings[name]:
            raise DriverError(f"{where}: {name} is {held} after {settings[name]} was written")


def _value(table: Table, memory: bytes, name: str) -> int:
    register = table[name]
    return register.unpack(memory[register.address : register.end])
