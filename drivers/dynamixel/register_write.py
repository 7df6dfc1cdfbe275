"""`write_registers`: a register of several servos, by sync write."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.dynamixel.goals import sync_write
from flexmotion.drivers.dynamixel.layout import Span
from flexmotion.drivers.dynamixel.registers import Table
from flexmotion.drivers.port import SerialPort


def write_registers(
    port: SerialPort,
    ids: Sequence[int],
    tables: Sequence[Table],
    name: str,
    value: int | NDArray[np.int64],
    which: NDArray[np.bool_] | None = None,
) -> None:
    """Set a register; one packet for each address that it has in these tables. Not acknowledged.

    Args:
        ids, tables: of the servos, m each.
        value: of all servos, or of each, (m,) [servo units].
        which: of them, (m,); None: all.
    """
    values = np.broadcast_to(value, len(ids)).tolist()
    rows: dict[Span, bytearray] = {}
    for slot, (id_, table) in enumerate(zip(ids, tables, strict=True)):
        if which is None or which[slot]:
            register = table[name]
            row = rows.setdefault(Span(register.address, register.size), bytearray())
            row += bytes([id_]) + register.pack(values[slot])
    for span, content in rows.items():
        port.send(sync_write(span, bytes(content)))
