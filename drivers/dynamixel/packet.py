"""Packets of Dynamixel Protocol 2.0 in bytes: framing, byte stuffing, CRC-16, and a decoder for a stream of them.

    FF FF FD 00 | id | length, 2 bytes | instruction | params ... | CRC, 2 bytes

Low byte first; length counts params + 3; length and CRC are taken after stuffing (ROBOTIS e-Manual, Protocol 2.0).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum

import fastcrc

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 0xFE
MAX_ID = 0xFC
OVERHEAD = 10
"""Bytes of an instruction packet without params; a status packet has one more, its error byte."""
MAX_LENGTH = 1024
"""Largest length field that is accepted; a greater one is noise that looks like a header."""
ALERT = 0x80
"""Bit of the error byte: the hardware error status is not 0."""

MARK, _STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"
"""Start of every packet. Where it occurs later in a packet, a byte is stuffed after it."""


class Instruction(IntEnum):
    """Instruction codes."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class Error(IntEnum):
    """Low seven bits of a status packet's error byte."""

    NONE = 0
    RESULT = 1
    INSTRUCTION = 2
    CRC = 3
    RANGE = 4
    LENGTH = 5
    LIMIT = 6
    ACCESS = 7


@dataclass(frozen=True)
class Packet:
    """One received packet. `params` are without byte stuffing; `intact` is False if the CRC is wrong."""

    id: int
    instruction: int
    params: bytes
    size: int
    intact: bool = True


def crc16(data: bytes | bytearray | memoryview, crc: int = 0) -> int:
    """CRC-16, polynomial 0x8005, most significant bit first ("UMTS"); `crc` is that of the bytes before `data`."""
    return fastcrc.crc16.umts(data, crc)


def encode(id_: int, instruction: int, params: bytes = b"") -> bytes:
    """The bytes of an instruction packet, with byte stuffing and CRC."""
    body = (bytes([instruction]) + params).replace(MARK, _STUFFED)
    head = HEADER + bytes([id_]) + (len(body) + 2).to_bytes(2, "little")
    packet = head + body
    return packet + crc16(packet).to_bytes(2, "little")


def encode_status(id_: int, error: int, params: bytes = b"") -> bytes:
    """The bytes of a status packet."""
    return encode(id_, Instruction.STATUS, bytes([error]) + params)


def encode_fast_status(rows: Sequence[tuple[int, int, bytes]]) -> bytes:
    """The bytes of the reply to a fast read: (error, id, data) of each servo, in the order asked; no byte stuffing.

    The CRC after each servo's data covers all bytes before it, including the CRCs of the servos before.
    """
    length = 1 + sum(len(data) + 4 for _, _, data in rows)
    packet = bytearray(HEADER + bytes([BROADCAST]) + length.to_bytes(2, "little") + bytes([Instruction.STATUS]))
    crc = crc16(packet)
    for error, id_, data in rows:
        block = bytes([error, id_]) + data
        crc = crc16(block, crc)
        tail = crc.to_bytes(2, "little")
        crc = crc16(tail, crc)
        packet += block + tail
    return bytes(packet)


def split_fast_status(reply: bytes, size: int) -> Iterator[tuple[int, int, bytes]]:
    """(error, id, data of `size` bytes) of every servo up to the first wrong CRC.

    `reply` starts at the header and may be cut short.
    """
    start = len(HEADER) + 4
    crc, step = crc16(reply[:start]), size + 4
    for at in range(start, len(reply) - step + 1, step):
        crc = crc16(reply[at : at + size + 2], crc)
        tail = reply[at + size + 2 : at + step]
        if int.from_bytes(tail, "little") != crc:
            return
        crc = crc16(tail, crc)
        yield reply[at], reply[at + 1], reply[at + 2 : at + size + 2]


def sync_write_rows(packet: bytes) -> bytes:
    """Id and data of each servo in the bytes of a sync write, without byte stuffing."""
    return packet[len(HEADER) + 4 : -2].replace(_STUFFED, MARK)[4:]


class Decoder:
    """Splits a stream of bytes into packets and skips everything else.

    Attributes:
        skipped: bytes that are not part of a packet.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.skipped = 0

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Append bytes; yields every packet that they complete, including those with a wrong CRC."""
        buffer = self._buffer
        buffer += data
        while True:
            start = _find_header(buffer)
            self.skipped += start
            del buffer[:start]
            if len(buffer) < 7:
                return
            length = int.from_bytes(buffer[5:7], "little")
            if not 3 <= length <= MAX_LENGTH:
                self._skip(4)
                continue
            size = length + 7
            if len(buffer) < size:
                return
            crc = int.from_bytes(buffer[size - 2 : size], "little")
            intact = crc16(memoryview(buffer)[: size - 2]) == crc
            body = bytes(buffer[7 : size - 2]).replace(_STUFFED, MARK)
            packet = Packet(buffer[4], body[0], body[1:], size, intact)
            if intact:
                del buffer[:size]
            else:
                # The length itself may be wrong: look for a header inside.
                self._skip(4)
            yield packet

    def clear(self) -> None:
        """Discard an incomplete packet."""
        self.skipped += len(self._buffer)
        self._buffer.clear()

    @property
    def waiting(self) -> int:
        """Number of bytes of an incomplete packet."""
        return len(self._buffer)

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._buffer[:count]


def _find_header(buffer: bytearray) -> int:
    """Start of the next header, or the number of leading bytes that cannot belong to one."""
    start = buffer.find(HEADER)
    if start >= 0:
        return start
    for tail in (3, 2, 1):
        if buffer.endswith(HEADER[:tail]):
            return len(buffer) - tail
    return len(buffer)
