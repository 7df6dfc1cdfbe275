"""`SumClient`: requests to single servos, with retries, for protocols whose packets end in a sum."""

from __future__ import annotations

from flexmotion.drivers.bus.attempts import attempts
from flexmotion.drivers.bus.packet import SumDecoder, SumFormat, SumPacket
from flexmotion.drivers.port import SerialPort

LATENCY_S = 0.02
"""Time that an answer may take in addition to its time on the wire [s]."""


class SumClient:
    """Sends a request and waits for the answer; not for the control cycle.

    Attributes:
        damaged: whether something came in answer to the last request, but no intact answer.
    """

    def __init__(self, port: SerialPort, form: SumFormat) -> None:
        self.port, self.form, self.damaged = port, form, False

    def ask(self, id_: int, code: int, params: bytes = b"", *, answer: int, once: bool = False) -> SumPacket | None:
        """A servo's answer, with `answer` params, to an instruction; None if none comes (`once`: one attempt)."""
        self.damaged = False
        for _ in attempts(self.port, once=once):
            self.port.receive()
            self.port.send(self.form.encode(id_, code, params))
            decoder = SumDecoder(self.form)
            patience = self.port.busy_until + self.port.seconds(answer + self.form.overhead) + LATENCY_S
            while (now := self.port.now()) < patience and self.port.lost is None:
                data = self.port.wait(patience - now)
                self.damaged |= bool(data)
                for packet in decoder.feed(data):
                    if packet.id == id_ and len(packet.params) == answer:
                        self.damaged = False
                        return packet
        return None
