"""`GoalPacket`: the sync write of goals to the servos of one layout."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.dynamixel.layout import Layout, Span, goal_row
from flexmotion.drivers.dynamixel.packet import BROADCAST, HEADER, MARK, Instruction, crc16, encode, sync_write_rows

Float = NDArray[np.float64]
Slots = NDArray[np.int64]

Decoded = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
"""Slots, goal positions and goal currents (none if they are not sent) in the bytes of a packet, k each."""


class GoalPacket:
    """Encodes goals of some of the m servos of a bus.

    Args:
        layout: of these servos.
        slots: their places among the servos of the bus, (k,).
        ids: of all servos of the bus, m.
        torque_per_unit: torque of one unit of current, of all servos of the bus, (m,) [N·m].

    Attributes:
        bounded: whether a goal current is sent with every goal position.
    """

    def __init__(self, layout: Layout, slots: Slots, ids: Sequence[int], torque_per_unit: Float) -> None:
        self._span, self.bounded = layout.write, layout.bounded
        self._slots: Slots | slice = slice(None) if np.array_equal(slots, np.arange(len(ids))) else slots
        self._unit = torque_per_unit[slots]
        self._slot = {id_: slot for slot, id_ in enumerate(ids)}
        self._seen: tuple[tuple[int, ...], tuple[int, ...]] = (), ()  # ids in the last packet, and their slots
        row = goal_row(bounded=layout.bounded)
        blank = sync_write(self._span, bytes(len(slots) * row.itemsize))[:-2]
        self._first = len(blank) - len(slots) * row.itemsize
        # Header, rows without byte stuffing; filled in place.
        self._packet = bytearray(blank)
        rows = np.ndarray(len(slots), row, self._packet, self._first)
        rows["id"] = [ids[slot] for slot in slots]
        self._position, self._current = rows["position"], rows["current"] if self.bounded else None
        self._unpack = struct.Struct("<" + ("Bhi" if self.bounded else "Bi") * len(slots)).unpack

    def encode(self, ticks: Float, bound: Float, current_limit: Float) -> bytes:
        """The packet for goals of the whole bus, (m,) each.

        Args:
            ticks: goal positions [servo units].
            bound: torque bounds [N·m]; NaN: the servo's own limit.
            current_limit: greatest goal current of each servo [servo units].
        """
        self._position[:] = ticks[self._slots]
        if self._current is not None:
            most = current_limit[self._slots]
            units = np.minimum(bound[self._slots] / self._unit, most)
            self._current[:] = np.where(np.isnan(units), most, units)
        packet = bytes(self._packet)
        if packet.find(MARK, len(HEADER) + 3) >= 0:
            return sync_write(self._span, packet[self._first :])
        return packet + crc16(packet).to_bytes(2, "little")

    def decode(self, packet: bytes) -> Decoded:
        """What the bytes of a packet command."""
        values, fields = self._unpack(sync_write_rows(packet)), 3 if self.bounded else 2
        ids = values[::fields]
        if ids != self._seen[0]:
            self._seen = ids, tuple(self._slot[id_] for id_ in ids)
        return self._seen[1], values[fields - 1 :: fields], values[1::3] if self.bounded else ()


def sync_write(span: Span, rows: bytes) -> bytes:
    """A sync write of `span`; `rows` holds id and data of each servo."""
    params = span.address.to_bytes(2, "little") + span.size.to_bytes(2, "little") + rows
    return encode(BROADCAST, Instruction.SYNC_WRITE, params)
