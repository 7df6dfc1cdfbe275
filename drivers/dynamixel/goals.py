"""`GoalPacket`: the sync write of goals to the servos of one layout."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.dynamixel.layout import Layout, Span, goal_row
from flexmotion.drivers.dynamixel.packet import BROADCAST, Instruction, encode, sync_write_rows

Float = NDArray[np.float64]
Slots = NDArray[np.int64]


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
        self._span, self._slots = layout.write, slots
        self._rows = np.zeros(len(slots), goal_row(bounded=layout.bounded))
        self._rows["id"] = [ids[slot] for slot in slots]
        self._unit = torque_per_unit[slots]
        self.bounded = layout.bounded

    def encode(self, ticks: Float, bound: Float, current_limit: Float) -> bytes:
        """The packet for goals of the whole bus, (m,) each.

        Args:
            ticks: goal positions [servo units].
            bound: torque bounds [N·m]; NaN: the servo's own limit.
            current_limit: greatest goal current of each servo [servo units].
        """
        self._rows["position"] = ticks[self._slots]
        if self.bounded:
            most = current_limit[self._slots]
            units = np.minimum(bound[self._slots] / self._unit, most)
            self._rows["current"] = np.where(np.isnan(units), most, units)
        return sync_write(self._span, self._rows.tobytes())

    def decode(self, packet: bytes) -> NDArray[np.void]:
        """The goals in the bytes of a packet, structured as `goal_row`, (k,)."""
        return np.frombuffer(sync_write_rows(packet), goal_row(bounded=self.bounded))


def sync_write(span: Span, rows: bytes) -> bytes:
    """A sync write of `span`; `rows` holds id and data of each servo."""
    params = span.address.to_bytes(2, "little") + span.size.to_bytes(2, "little") + rows
    return encode(BROADCAST, Instruction.SYNC_WRITE, params)
