"""The WIT standard protocol in bytes (WitMotion, "WIT Standard Communication Protocol").

    frame    55 | kind | four numbers of 2 bytes | sum of all bytes before        sent by the sensor, unasked
    command  FF AA | register | value, 2 bytes                                    taken for ten seconds after the key

Low byte first; numbers are signed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from enum import IntEnum, IntFlag

FRAME_SIZE = 11
KEY = 0xB588
"""Value of register `KEY` that unlocks the other registers."""

ACCEL_FULL_G = 16.0
GYRO_FULL_DEG_S = 2000.0
FULL = 32768
"""Full scale: acceleration and angular velocity of the number `FULL`, fixed by the protocol for every sensor."""

RATES = {10: 0x06, 20: 0x07, 50: 0x08, 100: 0x09, 200: 0x0B}
"""Samples per second -> value of register `RATE`."""

BANDWIDTHS = {256: 0, 184: 1, 94: 2, 44: 3, 21: 4, 10: 5, 5: 6}
"""Bandwidth of the sensor's low-pass [Hz] -> value of register `BANDWIDTH`."""

_HEADER, _COMMAND = 0x55, b"\xff\xaa"
_NUMBERS = struct.Struct("<4h")


class Kind(IntEnum):
    """Content of a frame: three axes and a fourth number (temperature, voltage)."""

    ACCEL = 0x51
    GYRO = 0x52


KINDS = range(0x50, 0x60)
"""All kinds of frames that a sensor may send."""


class Register(IntEnum):
    """Register of a command."""

    SAVE = 0x00
    OUTPUT = 0x02
    RATE = 0x03
    BANDWIDTH = 0x1F
    KEY = 0x69


class Output(IntFlag):
    """Bits of register `OUTPUT`: the frames of a sample."""

    ACCEL = 0x02
    GYRO = 0x04


def command(register: Register, value: int) -> bytes:
    """The bytes of a command that writes a register."""
    return _COMMAND + bytes([register]) + value.to_bytes(2, "little")


def frame(kind: int, numbers: tuple[int, int, int, int]) -> bytes:
    """The bytes of a frame."""
    body = bytes([_HEADER, kind]) + _NUMBERS.pack(*numbers)
    return body + bytes([sum(body) & 0xFF])


class FrameDecoder:
    """Splits a stream of bytes into frames and skips everything else.

    Attributes:
        good, bad: number of frames so far, and of frames with a wrong sum.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.good = self.bad = 0

    def feed(self, data: bytes) -> Iterator[tuple[int, tuple[int, int, int, int]]]:
        """Append bytes; yields kind and numbers of every frame that they complete."""
        buffer = self._buffer
        buffer += data
        while True:
            start = buffer.find(_HEADER)
            del buffer[: start if start >= 0 else len(buffer)]
            if len(buffer) < FRAME_SIZE:
                return
            if buffer[1] not in KINDS:
                del buffer[:1]
            elif sum(buffer[: FRAME_SIZE - 1]) & 0xFF != buffer[FRAME_SIZE - 1]:
                self.bad += 1
                del buffer[:1]
            else:
                content = buffer[1], _NUMBERS.unpack_from(buffer, 2)
                del buffer[:FRAME_SIZE]
                self.good += 1
                yield content


class CommandDecoder:
    """The sensor's side: splits a stream of bytes into commands."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[tuple[int, int]]:
        """Append bytes; yields register and value of every command that they complete."""
        buffer = self._buffer
        buffer += data
        while True:
            start = buffer.find(_COMMAND)
            if start < 0:
                del buffer[: max(len(buffer) - 1, 0)]
                return
            del buffer[:start]
            if len(buffer) < 5:
                return
            content = buffer[2], int.from_bytes(buffer[3:5], "little")
            del buffer[:5]
            yield content
