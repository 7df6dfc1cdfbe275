"""`read_registers`: the same registers of all servos of a bus, which may have different control tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.dynamixel.exchange import ReadMany
from flexmotion.drivers.dynamixel.layout import Span
from flexmotion.drivers.dynamixel.read_cycle import ReadCycle
from flexmotion.drivers.dynamixel.registers import Table
from flexmotion.drivers.port import SerialPort


def read_registers(
    cycle: ReadCycle,
    port: SerialPort,
    ids: Sequence[int],
    tables: Sequence[Table],
    names: Sequence[str],
    slack: float,
) -> NDArray[np.float64]:
    """Read registers of m servos, from the first named to the last, blocking: one sync read for each control table.

    Args:
        cycle: knows how long answers take.
        tables: of the servos, m.
        slack: time beyond that on the wire that the answers may take [s].

    Returns:
        (m, names), NaN without an answer.
    """
    values = np.full((len(ids), len(names)), np.nan)
    groups: dict[Span, list[int]] = {}
    for slot, table in enumerate(tables):
        first = table[names[0]].address
        groups.setdefault(Span(first, table[names[-1]].end - first), []).append(slot)
    for span, slots in groups.items():
        slot_of = {ids[slot]: slot for slot in slots}
        exchange = ReadMany(list(slot_of), span, fast=False, where=port.path)
        port.receive()
        port.send(exchange.begin())
        patience = cycle.answered_by(exchange, slack)
        while (now := port.now()) < patience and port.lost is None:
            if exchange.take(port.wait(patience - now)):
                break
        registers = [tables[slots[0]][name] for name in names]
        for id_, (_, data) in exchange.answers.items():
            values[slot_of[id_]] = [
                register.unpack(data[register.address - span.address : register.end - span.address])
                for register in registers
            ]
    return values
