"""Control tables of Dynamixel devices, from `tables/*.yaml` (which name their sources)."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import Strict, parse, read_yaml

FOLDER = Path(__file__).parent / "tables"
SERIES = ("x", "p")

BAUD_RATES = (
    *(9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000),
    *(6_000_000, 10_500_000),
)
"""Bit rate of each value of the baud rate register (e-Manual); the last two are those of the P series."""

RETURN_DELAY_US = 2.0
VOLTAGE = 0.1
WATCHDOG_S = 0.020
"""One unit of return delay [us], voltage [V] and bus watchdog [s]."""


class Register(Strict):
    """One register. `initial` is its value after a factory reset, `range` the values that may be written."""

    address: int = Field(ge=0)
    size: Literal[1, 2, 4]
    access: Literal["r", "rw"] = "rw"
    signed: bool = False
    initial: int = 0
    range: tuple[int, int] | None = None

    @property
    def end(self) -> int:
        """Address after the last byte."""
        return self.address + self.size

    def pack(self, value: int) -> bytes:
        """Encode a value."""
        return value.to_bytes(self.size, "little", signed=self.signed)

    def unpack(self, data: bytes | bytearray) -> int:
        """Decode the register's bytes."""
        return int.from_bytes(data, "little", signed=self.signed)


class Indirect(Strict):
    """`count` indirect registers: first of their addresses (2 bytes each) and first of their data (1 byte each)."""

    address: int
    data: int
    count: int


class Table(Strict):
    """The control table of one family of devices.

    Attributes:
        registers: by name.
        eeprom_end: registers below this address are in EEPROM, which is locked while torque is on.
        indirect: groups of indirect registers.
        fast_sync_read_firmware: lowest firmware version that supports fast sync reads; None: not supported.
        velocity_rpm: one unit of velocity [rpm].
        position_bytes: low bytes of a position that hold a turn and more.
        modes: operating modes.
    """

    registers: dict[str, Register]
    eeprom_end: int
    indirect: tuple[Indirect, ...] = ()
    fast_sync_read_firmware: int | None = None
    velocity_rpm: float = 0.229
    position_bytes: Literal[2, 4] = 2
    modes: tuple[int, ...] = ()

    def __getitem__(self, name: str) -> Register:
        return self.registers[name]

    def __contains__(self, name: str) -> bool:
        return name in self.registers

    @property
    def velocity_unit(self) -> float:
        """One unit of velocity [rad/s]."""
        return self.velocity_rpm * 2 * math.pi / 60

    @property
    def full_pwm(self) -> int:
        """PWM units of full supply."""
        return self["pwm_limit"].initial

    @property
    def keeps_indirect(self) -> bool:
        """Whether indirect addresses are kept without power, and locked while torque is on."""
        return bool(self.indirect) and self.indirect[0].address < self.eeprom_end

    @property
    def size(self) -> int:
        """Number of bytes from address 0 to the end of the last register."""
        ends = [register.end for register in self.registers.values()]
        ends += [max(run.address + 2 * run.count, run.data + run.count) for run in self.indirect]
        return max(ends)


class _Family(Strict):
    servos: list[str]
    fast_sync_read_firmware: int | None
    indirect: tuple[Indirect, ...]
    without: list[str] = []
    changes: dict[str, dict[str, Any]] = {}


class _SeriesFile(Strict):
    eeprom_end: int
    velocity_rpm: float
    position_bytes: Literal[2, 4]
    modes: tuple[int, ...]
    registers: dict[str, dict[str, Any]]
    families: dict[str, _Family]


class OpenCrUnits(Strict):
    """Scale of the raw inertial readings and the sign of each axis in the torso's frame."""

    gyro_deg_s: float
    accel_g: float
    axes: tuple[int, int, int]


class OpenCrFile(Strict):
    """OP3's controller board: control table and units."""

    eeprom_end: int
    model_number: int
    registers: dict[str, Register]
    units: OpenCrUnits

    @property
    def table(self) -> Table:
        """The control table alone."""
        return Table(registers=self.registers, eeprom_end=self.eeprom_end)


@cache
def _tables() -> dict[str, Table]:
    return {name: table for series in SERIES for name, table in _tables_in(FOLDER / f"{series}.yaml").items()}


def _tables_in(file: Path) -> dict[str, Table]:
    content = parse(_SeriesFile, read_yaml(file), file)
    tables: dict[str, Table] = {}
    for family in content.families.values():
        registers = {
            name: parse(Register, fields | family.changes.get(name, {}), f"{file}: register {name}")
            for name, fields in content.registers.items()
            if name not in family.without
        }
        table = Table(
            registers=registers,
            eeprom_end=content.eeprom_end,
            indirect=family.indirect,
            fast_sync_read_firmware=family.fast_sync_read_firmware,
            velocity_rpm=content.velocity_rpm,
            position_bytes=content.position_bytes,
            modes=content.modes,
        )
        if table.keeps_indirect:
            # Settings like others: `servo configure` writes them, a run compares them.
            table = table.model_copy(update={"registers": registers | _indirect_registers(table)})
        tables |= dict.fromkeys(family.servos, table)
    return tables


def _indirect_registers(table: Table) -> dict[str, Register]:
    run = table.indirect[0]
    last = table.size - 1
    return {
        f"indirect_address_{slot + 1}": Register(
            address=run.address + 2 * slot, size=2, initial=run.data + slot, range=(table.eeprom_end, last)
        )
        for slot in range(run.count)
    }


def table_of(servo: str) -> Table:
    """The control table of a servo model of the catalogue. Raises `ConfigError` if there is none."""
    tables = _tables()
    if servo not in tables:
        raise ConfigError(f"{FOLDER}: no control table for servo {servo!r}, there are: {', '.join(tables)}")
    return tables[servo]


@cache
def open_cr() -> OpenCrFile:
    """OP3's controller board. Raises `ConfigError` if its file is malformed."""
    file = FOLDER / "opencr.yaml"
    return parse(OpenCrFile, read_yaml(file), file)
