"""Registers that a cycle reads and writes, and how indirect addresses gather them into one run of bytes per servo.

The low bytes of position and speed are enough: +-8 turns, +-7,500 rpm (P series: all of the position, +-327 rpm).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmotion.drivers.dynamixel.registers import Table

_READ = (
    ("present_velocity", 2),
    ("present_current", 2),
    ("present_input_voltage", 1),
    ("present_temperature", 1),
    ("hardware_error_status", 1),
    ("realtime_tick", 1),
    ("torque_enable", 1),
)
"""Registers that a cycle reads after the position, and the number of low bytes of each."""

REST_SIZE = sum(size for _, size in _READ)
"""Bytes of a servo's data after the position."""

INSTEAD = "bus_watchdog"
"""One byte before the position. A read that begins one byte earlier has the watchdog in the place of the torque switch:
both are read in turns, at no cost on the wire."""

MOTION, SUPPLY, ERROR, TICK, TORQUE = 0, 4, 6, 7, 8
"""Places of velocity and current, of voltage and temperature, and of single bytes among the data after the position."""

WATCHDOG, SHIFT = 0, 1
"""Place of the watchdog in a read that has it, and how much later all others come there."""

CURRENT_POSITION_MODE = 5
"""Operating mode in which the goal current bounds the current of a position."""

_GOAL_ROW, _BOUNDED_GOAL_ROW = (
    np.dtype([("id", "u1"), *bound, ("position", "<i4")]) for bound in ([], [("current", "<i2")])
)


def goal_row(*, bounded: bool) -> np.dtype[np.void]:
    """A servo's bytes in a sync write of goals."""
    return _BOUNDED_GOAL_ROW if bounded else _GOAL_ROW


@dataclass(frozen=True)
class Span:
    """A run of bytes in every servo's control table."""

    address: int
    size: int


@dataclass(frozen=True)
class Layout:
    """Addresses of the cycle's bytes in the servos with one control table.

    Attributes:
        read, write: spans of a cycle; a read with the watchdog begins one byte before `read`.
        slots: (address of an indirect address register, value that it must have).
        bounded: whether a goal current is written before the goal position.
    """

    read: Span
    write: Span
    slots: tuple[tuple[int, int], ...]
    bounded: bool


def bounds_current(table: Table) -> bool:
    """Whether a servo holds positions with a bounded current."""
    return "goal_current" in table and CURRENT_POSITION_MODE in table.modes


def layout_of(table: Table, *, current_bound: bool) -> Layout:
    """The layout for a control table; with `current_bound`, goal currents are written if the servo supports them."""
    read = (("present_position", table.position_bytes), *_READ)
    targets = [table[INSTEAD].address]
    targets += [table[name].address + byte for name, size in read for byte in range(size)]
    bounded = current_bound and bounds_current(table)
    run = table.indirect[0]
    goal = table["goal_position"]
    write = Span(goal.address, goal.size)
    if bounded:
        write = Span(run.data + len(targets), 6)
        for name in ("goal_current", "goal_position"):
            targets += range(table[name].address, table[name].end)
    slots = tuple((run.address + 2 * slot, target) for slot, target in enumerate(targets))
    return Layout(Span(run.data + 1, table.position_bytes + REST_SIZE), write, slots, bounded)
