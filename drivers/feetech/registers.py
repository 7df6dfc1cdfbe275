"""The control table of Feetech's STS series, from `tables/sts.yaml` (which names its source)."""

from __future__ import annotations

from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Literal

from pydantic import Field

from flexmotion.configs.schema import Strict, load
from flexmotion.drivers.bus.packet import SumFormat, from_sign_magnitude, to_sign_magnitude

FORMAT = SumFormat(header=0xFF, counted=2)

BAUD_RATES = (1_000_000, 500_000, 250_000, 128_000, 115_200, 76_800, 57_600, 38_400)
"""Bit rate of each value of the baud rate register."""

VOLTAGE = 0.1
"""One unit of voltage [V]."""

RETURN_DELAY_US = 2.0
"""One unit of the return delay [us]."""


class Instruction(IntEnum):
    """Instruction codes."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83


class Register(Strict):
    """One register. `sign_bit` is set if the value may be negative."""

    address: int = Field(ge=0)
    size: Literal[1, 2]
    access: Literal["r", "rw"] = "rw"
    sign_bit: int | None = None
    initial: int = 0

    @property
    def end(self) -> int:
        """Address after the last byte."""
        return self.address + self.size

    def pack(self, value: int) -> bytes:
        """Encode a value."""
        raw = value if self.sign_bit is None else to_sign_magnitude(value, self.sign_bit)
        return raw.to_bytes(self.size, "little")

    def unpack(self, data: bytes | bytearray) -> int:
        """Decode the register's bytes."""
        raw = int.from_bytes(data, "little")
        return raw if self.sign_bit is None else from_sign_magnitude(raw, self.sign_bit)


class Table(Strict):
    """The control table."""

    eeprom_end: int
    registers: dict[str, Register]

    def __getitem__(self, name: str) -> Register:
        return self.registers[name]


@cache
def sts() -> Table:
    """The table. Raises `ConfigError` if its file is malformed."""
    return load(Table, Path(__file__).parent / "tables" / "sts.yaml")
