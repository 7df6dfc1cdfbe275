"""What a cycle reads and writes, and how indirect addresses gather it into one run of bytes a servo.

Ten bytes and the torque switch are read. Of position and speed the two low bytes are enough: +-8 turns, +-7,500 rpm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmotion.drivers.dynamixel.registers import Table

READ = (
    ("present_position", 2),
    ("present_velocity", 2),
    ("present_current", 2),
    ("present_input_voltage", 1),
    ("present_temperature", 1),
    ("hardware_error_status", 1),
    ("realtime_tick", 1),
    ("torque_enable", 1),
)
"""Registers that a cycle reads, and how many of their low bytes."""

READ_SIZE = sum(size for _, size in READ)

ROW = np.dtype(
    [
        ("position", "<i2"),
        ("velocity", "<i2"),
        ("current", "<i2"),
        ("voltage", "u1"),
        ("temperature", "u1"),
        ("error", "u1"),
        ("tick", "u1"),
        ("torque", "u1"),
    ]
)
"""The same as it comes off the wire."""


FAST_ROW = np.dtype(
    [("error_byte", "u1"), ("id", "u1"), *[(name, ROW[name]) for name in ROW.names or ()], ("crc", "<u2")]
)
"""And as it comes in a fast reply."""


_GOAL_ROW, _BOUNDED_GOAL_ROW = (
    np.dtype([("id", "u1"), *bound, ("position", "<i4")]) for bound in ([], [("current", "<i2")])
)


def goal_row(*, bounded: bool) -> np.dtype[np.void]:
    """A servo's part of a sync write of goals."""
    return _BOUNDED_GOAL_ROW if bounded else _GOAL_ROW


@dataclass(frozen=True)
class Span:
    """A run of bytes in every servo's control table."""

    address: int
    size: int


@dataclass(frozen=True)
class Layout:
    """Where the cycle's bytes lie in a family of servos.

    Attributes:
        read, write: spans of a cycle.
        slots: indirect slot address -> the address that it must point at.
        bounded: goals carry a current before the position.
    """

    read: Span
    write: Span
    slots: tuple[tuple[int, int], ...]
    bounded: bool


def layout_of(table: Table, *, current_bound: bool) -> Layout:
    """The layout for a control table; the current bound only where the servo has one."""
    targets = [table[name].address + byte for name, size in READ for byte in range(size)]
    bounded = current_bound and "goal_current" in table
    run = table.indirect[0]
    goal = table["goal_position"]
    write = Span(goal.address, goal.size)
    if bounded:
        write = Span(run.data + len(targets), 6)
        for name in ("goal_current", "goal_position"):
            targets += range(table[name].address, table[name].end)
    slots = tuple((run.address + 2 * slot, target) for slot, target in enumerate(targets))
    return Layout(Span(run.data, READ_SIZE), write, slots, bounded)
