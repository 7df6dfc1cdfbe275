"""Settings of a Feetech servo: reads and checks them, writes those in RAM for a run, and those in EEPROM on request."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.attempts import DAMAGED
from flexmotion.drivers.bus.inspection import Inspection
from flexmotion.drivers.bus.sum_client import SumClient
from flexmotion.drivers.bus.tools import model_name
from flexmotion.drivers.feetech.registers import RETURN_DELAY_US, Instruction, sts

_HEAD = 56
"""Number of bytes before the measurements: all settings."""

SEVERAL_TURNS = 0x10
"""Bit of the phase: the position counts over several turns, from an unknown one after power-up. The other bits describe
motor and bridge, and stay."""


@dataclass(frozen=True)
class Found:
    """A servo as it was read: all of its settings by name, and those in EEPROM."""

    held: dict[str, int]
    inspection: Inspection


def kept_settings(robot: Robot, joint: int) -> dict[str, int]:
    """Values that the EEPROM of a joint's servo must have, by name; of the phase one bit, see `find`.

    Both limits at 0 would be the mode of several turns as well.
    """
    config, servo = robot.joints[joint], robot.servos[joint]
    return {
        "operating_mode": 0,
        "angle_resolution": 1,
        "homing_offset": 0,
        "min_position_limit": servo.min_tick,
        "max_position_limit": servo.max_tick,
        "return_delay": round(robot.config.buses[config.bus].return_delay_us / RETURN_DELAY_US),
        "p_gain": config.p_gain or servo.gain_register,
        "d_gain": sts()["d_gain"].initial,
        "i_gain": 0,
    }


RUN_SETTINGS = {"acceleration": 0, "goal_time": 0, "goal_speed": 0}
"""Values that the RAM of every servo must have for a run."""


def find(client: SumClient, robot: Robot, joint: int, present_id: int | None = None) -> Found:
    """Read a joint's servo, which may have another id at present; nothing is written.

    Raises `DriverError` if it does not answer or has another model.
    """
    config, servo = robot.joints[joint], robot.servos[joint]
    id_ = config.id if present_id is None else present_id
    where = f"servo of {config.name} (id {id_}) on {client.port.path}"
    answer = client.ask(id_, Instruction.READ, bytes([0, _HEAD]), answer=_HEAD)
    if answer is None:
        silent = f"does not answer at {client.port.baud} baud; is its power on? `flexmotion servo scan` finds servos"
        reason = client.port.lost or (DAMAGED if client.damaged else f"{silent} at any baud rate")
        raise DriverError(f"{where}: {reason}")
    held = {name: r.unpack(answer.params[r.address : r.end]) for name, r in sts().registers.items() if r.end <= _HEAD}
    if servo.model_number is not None and held["model_number"] != servo.model_number:
        found, expected = held["model_number"], f"{servo.name} (model number {servo.model_number})"
        raise DriverError(f"{where}: is {model_name(found)} (model number {found}), the robot file has {expected}")
    wanted = kept_settings(robot, joint) | {"phase": held["phase"] & ~SEVERAL_TURNS}
    kept = {name: held[name] for name in wanted}
    inspection = Inspection(config.name, id_, servo.name, client.port.path, kept, wanted, bool(held["torque_enable"]))
    return Found(held, inspection)


def prepare(client: SumClient, robot: Robot, joint: int, found: Found) -> None:
    """Write the settings in RAM that differ. Raises `DriverError` if a write is not acknowledged."""
    for name, value in RUN_SETTINGS.items():
        if found.held[name] != value:
            write(client, robot, joint, name, value)


def write_kept(client: SumClient, robot: Robot, joint: int, settings: Mapping[str, int]) -> None:
    """Write settings in EEPROM and read them back. Raises `DriverError` if one is not kept."""
    config = robot.joints[joint]
    write(client, robot, joint, "lock", 0)
    try:
        for name, value in settings.items():
            write(client, robot, joint, name, value)
    finally:
        write(client, robot, joint, "lock", 1)
    held = find(client, robot, joint).held
    for name, value in settings.items():
        if held[name] != value:
            raise DriverError(
                f"servo of {config.name} (id {config.id}) on {client.port.path}: {name} is {held[name]} after {value} "
                "was written"
            )


def write(client: SumClient, robot: Robot, joint: int, name: str, value: int) -> None:
    """Write a register. Raises `DriverError` if it is not acknowledged."""
    config, register = robot.joints[joint], sts()[name]
    params = bytes([register.address]) + register.pack(value)
    if client.ask(config.id, Instruction.WRITE, params, answer=0) is None:
        raise DriverError(
            f"servo of {config.name} (id {config.id}) on {client.port.path}: does not acknowledge a write of {name}"
        )
