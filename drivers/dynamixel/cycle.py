"""One exchange of a cycle: an instruction and the answers to it, taken byte by byte as they come."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Sequence

from drivers.bus.port import SerialPort
from drivers.dynamixel.layout import Span
from drivers.dynamixel.packet import BROADCAST, HEADER, Decoder, Instruction, encode, split_fast_status

FAST_FAILURES = 3
"""Fast reads in a row without one servo's answer before sync read takes over for good."""

_STATUS_OVERHEAD, _FAST_OVERHEAD = 11, 4
"""Bytes around a servo's data in a status packet, and in a fast reply, which has 8 more once."""

log = logging.getLogger(__name__)


class Exchange(ABC):
    """An instruction with answers.

    Attributes:
        answers: id -> (error byte, data) of what came in this cycle.
    """

    def __init__(self) -> None:
        self.answers: dict[int, tuple[int, bytes]] = {}

    @abstractmethod
    def begin(self) -> bytes:
        """The instruction; what came before is forgotten."""

    @abstractmethod
    def take(self, data: bytes) -> bool:
        """Bytes that came; whether all are there."""

    def end(self) -> None:  # noqa: B027 - most have nothing to learn from a cycle
        """The cycle is over, whatever came."""

    @property
    @abstractmethod
    def sizes(self) -> tuple[int, int]:
        """Bytes of the instruction and of all answers."""

    def seconds(self, port: SerialPort, return_delay: float) -> float:
        """Time on the wire when all goes well [s]."""
        return port.seconds(sum(self.sizes)) + return_delay


class ReadOne(Exchange):
    """A read of one device."""

    def __init__(self, id_: int, span: Span) -> None:
        super().__init__()
        self._id, self._size = id_, span.size
        params = span.address.to_bytes(2, "little") + span.size.to_bytes(2, "little")
        self._packet = encode(id_, Instruction.READ, params)
        self._decoder = Decoder()

    def begin(self) -> bytes:
        """See `Exchange`."""
        self.answers.clear()
        self._decoder.clear()
        return self._packet

    def take(self, data: bytes) -> bool:
        """See `Exchange`."""
        for packet in self._decoder.feed(data):
            if packet.intact and packet.id == self._id and len(packet.params) == self._size + 1:
                self.answers[packet.id] = packet.params[0], packet.params[1:]
        return bool(self.answers)

    @property
    def sizes(self) -> tuple[int, int]:
        """See `Exchange`."""
        return len(self._packet), self._size + _STATUS_OVERHEAD


class ReadMany(Exchange):
    """A sync read of servos that keep the same things at the same place; fast where they can.

    A servo that does not answer is asked last from then on: in a fast reply nobody speaks after it, and in a sync read
    the others would wait for it.

    Attributes:
        fast: whether it is a fast sync read.
    """

    def __init__(self, ids: Sequence[int], span: Span, *, fast: bool, where: str) -> None:
        """`where` names the bus in messages."""
        super().__init__()
        self.ids, self.span, self.fast = list(ids), span, fast
        self._where = where
        self._order = list(ids)
        self._decoder = Decoder()
        self._reply = bytearray()
        self._failures = 0
        self._encode()

    def begin(self) -> bytes:
        """See `Exchange`."""
        self.answers.clear()
        self._decoder.clear()
        self._reply.clear()
        return self._packet

    def take(self, data: bytes) -> bool:
        """See `Exchange`."""
        if self.fast:
            self._reply += data
            start = self._reply.find(HEADER)
            return start >= 0 and len(self._reply) - start >= self._fast_size
        known = set(self.ids)
        for packet in self._decoder.feed(data):
            if packet.intact and packet.id in known and len(packet.params) == self.span.size + 1:
                self.answers[packet.id] = packet.params[0], packet.params[1:]
        return len(self.answers) == len(self.ids)

    def end(self) -> None:
        """See `Exchange`."""
        if self.fast:
            self._split()
        missing = [id_ for id_ in self._order if id_ not in self.answers]
        if self.fast:
            self._failures = self._failures + 1 if len(missing) == len(self.ids) else 0
            if self._failures >= FAST_FAILURES:
                log.warning("%s: no answer to %d fast sync reads: sync read from now on", self._where, FAST_FAILURES)
                self.fast = False
                self._encode()
        if missing and len(missing) < len(self.ids):
            # After a gap in a fast reply only the first one missing is to blame.
            last = missing[:1] if self.fast else missing
            order = [id_ for id_ in self._order if id_ not in last] + last
            if order != self._order:
                self._order = order
                self._encode()

    @property
    def sizes(self) -> tuple[int, int]:
        """See `Exchange`."""
        many = len(self.ids)
        answers = self._fast_size if self.fast else many * (self.span.size + _STATUS_OVERHEAD)
        return len(self._packet), answers

    def seconds(self, port: SerialPort, return_delay: float) -> float:
        """See `Exchange`; in a sync read every servo waits its return delay."""
        return super().seconds(port, return_delay * (1 if self.fast else len(self.ids)))

    def _encode(self) -> None:
        address, size = self.span.address, self.span.size
        params = address.to_bytes(2, "little") + size.to_bytes(2, "little") + bytes(self._order)
        kind = Instruction.FAST_SYNC_READ if self.fast else Instruction.SYNC_READ
        self._packet = encode(BROADCAST, kind, params)
        self._fast_size = 8 + len(self.ids) * (size + _FAST_OVERHEAD)

    def _split(self) -> None:
        start = self._reply.find(HEADER)
        if start < 0:
            return
        known = set(self.ids)
        for error, id_, data in split_fast_status(bytes(self._reply[start:]), self.span.size):
            if id_ in known:
                self.answers[id_] = error, data
