"""Packets that end in an inverted sum, of Feetech's and LewanSoul's servos; header and length field differ.

header, header | id | length | code | params ... | sum        sum = ~(id + length + code + params) & 0xFF
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

BROADCAST = 0xFE
MAX_ID = 0xFD


@dataclass(frozen=True)
class SumPacket:
    """One received packet; `code` is its instruction or, in an answer, its error byte or command."""

    id: int
    code: int
    params: bytes
    size: int


@dataclass(frozen=True)
class SumFormat:
    """A protocol's framing.

    Attributes:
        header: the byte that occurs twice at the start.
        counted: what the length field counts in addition to the params.
    """

    header: int
    counted: int

    @property
    def overhead(self) -> int:
        """Bytes of a packet without params."""
        return 6

    def encode(self, id_: int, code: int, params: bytes = b"") -> bytes:
        """The bytes of a packet."""
        body = bytes([id_, len(params) + self.counted, code]) + params
        return bytes([self.header, self.header]) + body + bytes([~sum(body) & 0xFF])


class SumDecoder:
    """Splits a stream of bytes into packets and skips everything else.

    Attributes:
        bad: packets whose sum was wrong.
    """

    def __init__(self, form: SumFormat) -> None:
        self._form, self._mark = form, bytes([form.header] * 2)
        self._buffer = bytearray()
        self.bad = 0

    def feed(self, data: bytes) -> Iterator[SumPacket]:
        """Append bytes; yields every packet that they complete."""
        buffer = self._buffer
        buffer += data
        while True:
            start = buffer.find(self._mark)
            if start < 0:
                del buffer[: max(len(buffer) - 1, 0)]
                return
            del buffer[:start]
            if len(buffer) < 4:
                return
            params = buffer[3] - self._form.counted
            if buffer[2] == self._form.header or params < 0:
                del buffer[:1]  # three header bytes, or noise that looks like one
                continue
            size = params + self._form.overhead
            if len(buffer) < size:
                return
            if ~sum(buffer[2 : size - 1]) & 0xFF != buffer[size - 1]:
                self.bad += 1
                del buffer[:2]
                continue
            packet = SumPacket(buffer[2], buffer[4], bytes(buffer[5 : size - 1]), size)
            del buffer[:size]
            yield packet

    def clear(self) -> None:
        """Discard an incomplete packet."""
        self._buffer.clear()


def to_sign_magnitude(value: int, sign_bit: int) -> int:
    """Encode a signed number as magnitude with a sign bit."""
    return value if value >= 0 else -value | 1 << sign_bit


def from_sign_magnitude(raw: int, sign_bit: int) -> int:
    """Decode magnitude and sign bit."""
    return -(raw & ~(1 << sign_bit)) if raw >> sign_bit & 1 else raw
