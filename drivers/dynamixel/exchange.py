"""`Exchange`: an instruction and its answers, taken byte by byte as they arrive."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Sequence

from flexmotion.drivers.dynamixel.layout import Span
from flexmotion.drivers.dynamixel.packet import (
    ALERT,
    BROADCAST,
    HEADER,
    MARK,
    Decoder,
    Instruction,
    crc16,
    encode,
    split_fast_status,
)

RETRY_CYCLES, MOST_RETRY_CYCLES = 1000, 100_000
"""Cycles after which fast reads that were given up are tried once more; doubled with every attempt that fails."""

STRIKES = 3
"""Consecutive fast reads without an answer, each followed by an answered sync read, before fast reads are given up."""

_STATUS_OVERHEAD, FAST_OVERHEAD, FAST_HEAD = 11, 4, 8
"""Bytes around a servo's data in a status packet and in a fast reply, and bytes before the first servo's data."""
_FAST_START = HEADER + bytes([BROADCAST])
"""Start of a fast reply. A late answer to a sync read may have the same length (with a stuffed byte) and a valid CRC at
the same place, but starts with its servo's id."""

log = logging.getLogger(__name__)


class Exchange(ABC):
    """An instruction with answers.

    Attributes:
        answers: id -> (error byte, data), received in this cycle.
        sizes: number of bytes of the instruction and of all answers.
        delays: number of return delays in the answers.
    """

    def __init__(self) -> None:
        self.answers: dict[int, tuple[int, bytes]] = {}
        self.sizes = (0, 0)
        self.delays = 1

    @abstractmethod
    def begin(self) -> bytes:
        """The bytes of the instruction; earlier answers are discarded."""

    @abstractmethod
    def take(self, data: bytes) -> bool:
        """Take received bytes; True if all answers are complete."""

    def forget(self) -> None:
        """Discard answers of an earlier cycle."""
        self.answers.clear()

    def end(self) -> None:  # noqa: B027 - optional
        """No more is received; evaluate what was."""


class ReadOne(Exchange):
    """A read of one device."""

    def __init__(self, id_: int, span: Span) -> None:
        super().__init__()
        self._id, self._size = id_, span.size
        params = span.address.to_bytes(2, "little") + span.size.to_bytes(2, "little")
        self._packet = encode(id_, Instruction.READ, params)
        self._decoder = Decoder()
        self.sizes = len(self._packet), self._size + _STATUS_OVERHEAD
        length = (self._size + 4).to_bytes(2, "little")
        self._head = HEADER + bytes([id_]) + length + bytes([Instruction.STATUS])

    def begin(self) -> bytes:
        """See `Exchange`."""
        self.answers.clear()
        self._decoder.clear()
        return self._packet

    def take(self, data: bytes) -> bool:
        """See `Exchange`."""
        head = len(self._head)
        if (
            len(data) == self.sizes[1]
            and data.startswith(self._head)
            and not self._decoder.waiting
            and MARK not in data[head:]
            and crc16(data[:-2]) == int.from_bytes(data[-2:], "little")
        ):
            # The usual answer: whole, alone, and without byte stuffing.
            self.answers[self._id] = data[head], data[head + 1 : -2]
            return True
        for packet in self._decoder.feed(data):
            if packet.intact and packet.id == self._id and len(packet.params) == self._size + 1:
                self.answers[packet.id] = packet.params[0], packet.params[1:]
        return bool(self.answers)


class ReadMany(Exchange):
    """A sync read of servos with the same layout; a fast one if they support it.

    The first servo that does not answer is asked last from the next cycle on: those after it may be silent because of
    it. A fast read without any answer is followed by a sync read. If that is answered, three times in a row, fast reads
    do not work on this bus; otherwise the bus was silent. Then sync reads are used, and a fast read is tried again
    after a while.

    Attributes:
        fast: whether it is a fast sync read.
        order, asked: ids in the order asked, as a list and as bytes.
        whole: a complete fast reply: header, then error, id, data and CRC of each servo in that order; `answers` is
            empty then. None without a complete one.
    """

    def __init__(self, ids: Sequence[int], span: Span, *, fast: bool, where: str) -> None:
        """`where` names the bus in messages."""
        super().__init__()
        self.ids, self.span, self.fast = list(ids), span, fast
        self._where, self._known = where, frozenset(ids)
        self.order = list(ids)
        self._decoder = Decoder()
        self._reply = b""
        self._strikes, self._doubted = 0, False
        self._given_up, self._retry_cycles = 0, RETRY_CYCLES  # cycles since, and until the next attempt
        self.whole: bytes | None = None
        self._packets: dict[int, bytes] = {}  # by address
        self._encode()

    def aim(self, span: Span) -> None:
        """Read another span of the same size from the next cycle on."""
        self.span = span

    def begin(self) -> bytes:
        """See `Exchange`."""
        self.forget()
        if self._decoder.waiting:
            self._decoder.clear()
        packet = self._packets.get(self.span.address)
        return self._encode() if packet is None else packet

    def forget(self) -> None:
        """See `Exchange`."""
        self.answers.clear()
        self._reply, self.whole = b"", None

    def take(self, data: bytes) -> bool:
        """See `Exchange`."""
        if self._asks_fast:
            reply = self._reply = self._reply + data if self._reply else data
            if len(reply) < self.sizes[1] or reply.startswith(_FAST_START):
                return len(reply) >= self.sizes[1]
            start = reply.find(_FAST_START)
            return start >= 0 and len(reply) - start >= self.sizes[1]
        for packet in self._decoder.feed(data):
            if not packet.intact or packet.id not in self._known or len(packet.params) != self.span.size + 1:
                continue
            if not packet.params[0] & ~ALERT:  # an error of the read: there are no data
                self.answers[packet.id] = packet.params[0], packet.params[1:]
        return len(self.answers) == len(self.ids)

    def end(self) -> None:
        """See `Exchange`."""
        if self._asks_fast and self._split():
            if self._given_up:
                log.warning("%s: fast sync reads are answered again", self._where)
                self._given_up, self._retry_cycles = 0, RETRY_CYCLES
            self._strikes = 0
            return
        order = self.order
        missing = [id_ for id_ in order if id_ not in self.answers]
        if missing and self.answers:
            # Only the first missing servo is known to be silent.
            order = [id_ for id_ in order if id_ != missing[0]] + missing[:1]
        doubted = self._doubt()
        if order != self.order or doubted != self._doubted:
            self.order, self._doubted = order, doubted
            self._packets.clear()
            self._encode()

    def _doubt(self) -> bool:
        """Whether the next read is a sync read to test if fast reads work."""
        if not self.fast:
            return False
        if self._retrying and self.answers:
            self._given_up = 0
        if self._retrying:
            self._retry_cycles = min(2 * self._retry_cycles, MOST_RETRY_CYCLES)
            self._given_up = 1
            return True
        if self._given_up:
            self._given_up += 1
            return self._given_up < self._retry_cycles
        if not self._doubted:
            self._strikes = 0 if self.answers else self._strikes
            return not self.answers
        if self.answers:
            self._strikes += 1
            if self._strikes == STRIKES:
                log.warning("%s: fast sync reads are not answered: sync reads from now on", self._where)
                self._given_up = 1
                return True
        return False

    @property
    def _retrying(self) -> bool:
        """Whether fast reads were given up and this is an attempt."""
        return self._given_up > 0 and not self._doubted

    def _encode(self) -> bytes:
        """Make the packet for the present span and order, and keep it; packets of another order must be forgotten."""
        address, size, many = self.span.address, self.span.size, len(self.ids)
        self._asks_fast = self.fast and not self._doubted
        self.asked = bytes(self.order)
        params = address.to_bytes(2, "little") + size.to_bytes(2, "little") + self.asked
        kind = Instruction.FAST_SYNC_READ if self._asks_fast else Instruction.SYNC_READ
        packet = self._packets[address] = encode(BROADCAST, kind, params)
        # In a sync read every servo has its own return delay.
        self.delays = 1 if self._asks_fast else many
        answers = FAST_HEAD + many * (size + FAST_OVERHEAD) if self._asks_fast else many * (size + _STATUS_OVERHEAD)
        self.sizes = len(packet), answers
        return packet

    def _split(self) -> bool:
        """Decode a fast reply; whether it is complete."""
        reply, size = self._reply, self.sizes[1]
        if len(reply) != size or not reply.startswith(_FAST_START):
            start = reply.find(_FAST_START)
            if start < 0:
                return False
            reply = reply[start : start + size]
        # Every CRC covers all bytes before it: if the last one is right, all are.
        whole = len(reply) == size and crc16(reply[:-2]) == int.from_bytes(reply[-2:], "little")
        if whole and reply[FAST_HEAD + 1 :: self.span.size + FAST_OVERHEAD] == self.asked:
            self.whole = reply
            return True
        for error, id_, data in split_fast_status(reply, self.span.size):
            if id_ in self._known and not error & ~ALERT:
                self.answers[id_] = error, data
        return False
