"""Messages of plain numbers in the encoding of ROS 2: schema text (`ros2msg`) and little-endian CDR (`cdr`).

CDR aligns every number to its own size, counted from the end of a header of four bytes. A fixed array is its elements;
a sequence is a 32-bit count and its elements (OMG CORBA 3.3, part 2, 9.3).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmotion.configs.errors import ConfigError

ENCAPSULATION = b"\x00\x01\x00\x00"
"""Header of a little-endian CDR message."""
_KINDS = {"bool": "?", "int64": "<i8", "float32": "<f4", "float64": "<f8"}
_NAMES = {np.dtype(code): name for name, code in _KINDS.items()}
_LINE = re.compile(r"(?P<kind>\w+)(?P<array>\[(?P<size>\d*)\])?\s+(?P<name>\w+)\s*$")


@dataclass(frozen=True)
class Column:
    """One field of a message.

    Attributes:
        name: name of the field.
        kind: bool, int64, float32 or float64.
        size: elements of a fixed array; 1 for a single number; None for a sequence.
        unit: unit, a comment in the schema.
        constants: names of values of the field, constants in the schema before it.
    """

    name: str
    kind: str
    size: int | None = 1
    unit: str = ""
    constants: tuple[tuple[str, int], ...] = ()

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of one element."""
        return np.dtype(_KINDS[self.kind])


def columns_of(dtype: np.dtype[Any], units: Mapping[str, str]) -> list[Column]:
    """The fields of a structured row whose bytes, after the header, are the message.

    Raises:
        ConfigError: the layout has gaps, or CDR would need padding before a field.
    """
    columns, end = [], 0
    for name in dtype.names or ():
        field, offset = dtype.fields[name][:2]  # type: ignore[index]
        if offset != end or offset % field.base.itemsize:
            raise ConfigError(f"row: field {name} begins at byte {offset}, expected wider fields first and no gaps")
        end = offset + field.itemsize
        columns.append(Column(name, _NAMES[field.base], int(np.prod(field.shape, dtype=int)), units.get(name, "")))
    return columns


def schema_text(columns: Iterable[Column]) -> str:
    """The schema text, one field in each line."""
    lines = []
    for column in columns:
        array = "" if column.size == 1 else "[]" if column.size is None else f"[{column.size}]"
        lines += [f"{column.kind} {name}={value}" for name, value in column.constants]
        lines.append(f"{column.kind}{array} {column.name}" + (f"  # [{column.unit}]" if column.unit else ""))
    return "\n".join(lines) + "\n"


def parse_schema(text: str) -> list[Column]:
    """The fields of a schema of plain numbers, without constants and comments.

    Raises:
        ConfigError: a line is something else.
    """
    columns = []
    for line in text.splitlines():
        bare = line.partition("#")[0].strip()
        if not bare or "=" in bare:
            continue
        found = _LINE.match(bare)
        if found is None or found["kind"] not in _KINDS:
            raise ConfigError(f"schema: cannot read {bare!r}, expected a field of {', '.join(_KINDS)}")
        size = 1 if found["array"] is None else int(found["size"]) if found["size"] else None
        columns.append(Column(found["name"], found["kind"], size))
    return columns


def row_dtype(columns: Iterable[Column]) -> np.dtype[Any]:
    """The dtype of a message without sequences, after its header; the inverse of `columns_of`."""
    return np.dtype([(c.name, c.dtype) if c.size == 1 else (c.name, c.dtype, c.size) for c in columns])


def encode(columns: Sequence[Column], values: Mapping[str, Any]) -> bytes:
    """Encode a message; arrays of any shape are written row by row.

    Raises:
        ValueError: an array has another size than its column.
    """
    message = bytearray()
    for column in columns:
        array = np.asarray(values[column.name], column.dtype).reshape(-1)
        if column.size is None:
            _align(message, 4)
            message += len(array).to_bytes(4, "little")
        elif len(array) != column.size:
            raise ValueError(f"{column.name} has {len(array)} elements, expected {column.size}")
        if len(array):
            _align(message, column.dtype.itemsize)
            message += array.tobytes()
    return ENCAPSULATION + bytes(message)


def decode(columns: Sequence[Column], message: bytes) -> dict[str, Any]:
    """Decode a message of `encode`: a number, or an array (size,), by field.

    Raises:
        ValueError: the message is too short.
    """
    place = 0
    values: dict[str, Any] = {}
    body = memoryview(message)[len(ENCAPSULATION) :]
    for column in columns:
        size = column.size
        if size is None:
            place += -place % 4
            size = int.from_bytes(body[place : place + 4], "little")
            place += 4
        if size:
            place += -place % column.dtype.itemsize
        found = np.frombuffer(body, column.dtype, size, place)
        values[column.name] = found[0].item() if column.size == 1 else found
        place += size * column.dtype.itemsize
    return values


def _align(message: bytearray, size: int) -> None:
    message += bytes(-len(message) % size)
