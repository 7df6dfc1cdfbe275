"""Commands of the LewanSoul / Hiwonder LX-16A bus (vendor's "Bus Servo Communication Protocol")."""

from __future__ import annotations

from enum import IntEnum

from flexmotion.drivers.bus.packet import SumFormat

FORMAT = SumFormat(header=0x55, counted=3)
BAUD = 115_200

MILLIVOLT = 0.001
"""One unit of voltage [V]."""


class Command(IntEnum):
    """Command codes; an answer has the code of its command."""

    MOVE = 1
    MOVE_STOP = 12
    SET_ID = 13
    READ_ID = 14
    READ_LIMITS = 21
    READ_TEMPERATURE = 26
    READ_VOLTAGE = 27
    READ_POSITION = 28
    LOAD = 31
    READ_LOAD = 32


ANSWER_SIZE = {
    Command.READ_ID: 1,
    Command.READ_LIMITS: 4,
    Command.READ_TEMPERATURE: 1,
    Command.READ_VOLTAGE: 2,
    Command.READ_POSITION: 2,
    Command.READ_LOAD: 1,
}
"""Number of params in each answer."""
