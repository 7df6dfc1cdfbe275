"""`Columns`: the data of several servos as they were received, by kind of value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.dynamixel.layout import ERROR, MOTION, REST_SIZE, SHIFT, SUPPLY, TICK, TORQUE, WATCHDOG


class Columns:
    """Rows of equal length, one a servo, that are replaced in every cycle.

    Single bytes are compared as bytes: for some tens of servos, numpy's calls take several times as long.

    Args:
        count: number of rows, k.
        size: bytes of a servo's data, by which its positions have two or four of them.
        head: bytes before the first row.
        before, after: bytes of a row before and after the servo's data; the first before them is the error byte.
        watchdog: whether the data begin with the watchdog.

    Attributes:
        position: (k,) [servo units].
        motion: velocity and current, (2, k) [servo units].
        supply: voltage and temperature, (2, k) [servo units].
    """

    def __init__(
        self, count: int, size: int, *, head: int = 0, before: int = 0, after: int = 0, watchdog: bool
    ) -> None:
        width = size - REST_SIZE
        step, first = before + size + after, head + before + (SHIFT if watchdog else 0)
        self._step, self._head, self._rest = step, head, first + width
        self._turn = head + before + WATCHDOG if watchdog else self._rest + TORQUE
        self._rows, self._held = b"", bytearray(head + count * step)
        # Views of the same bytes.
        self.position = np.ndarray(count, f"<i{width}", self._held, first, (step,))
        self.motion = np.ndarray((2, count), "<i2", self._held, self._rest + MOTION, (2, step))
        self.supply: NDArray[np.uint8] = np.ndarray((2, count), "u1", self._held, self._rest + SUPPLY, (1, step))

    def fill(self, rows: bytes) -> None:
        """Take the bytes of a cycle, as many as head and rows have together."""
        self._rows = self._held[:] = rows

    @property
    def voltages(self) -> bytes:
        """Supply of each servo [0.1 V]."""
        return self._rows[self._rest + SUPPLY :: self._step]

    @property
    def errors(self) -> bytes:
        """Hardware error status of each servo."""
        return self._rows[self._rest + ERROR :: self._step]

    @property
    def ticks(self) -> bytes:
        """Low byte of the millisecond counter of each servo."""
        return self._rows[self._rest + TICK :: self._step]

    @property
    def turn(self) -> bytes:
        """Watchdog of each servo if it was read, otherwise its torque switch."""
        return self._rows[self._turn :: self._step]

    @property
    def statuses(self) -> bytes:
        """Error byte before each servo's data; of no meaning where rows have none."""
        return self._rows[self._head :: self._step]
