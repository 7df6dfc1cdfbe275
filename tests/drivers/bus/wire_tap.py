"""Records what a host sends to emulated servos, and counts the writes in it."""

from __future__ import annotations

from collections import Counter

from flexmotion.drivers.bus.packet import SumDecoder
from flexmotion.drivers.dynamixel.packet import Decoder, Instruction
from flexmotion.drivers.emulator.loopback import Loopback, LoopbackPort
from flexmotion.drivers.feetech.registers import FORMAT as STS
from flexmotion.drivers.lx16a.protocol import FORMAT as LX
from flexmotion.drivers.lx16a.protocol import Command

_READS = {
    *(Instruction.PING, Instruction.READ, Instruction.SYNC_READ, Instruction.FAST_SYNC_READ),
    *(Instruction.BULK_READ, Instruction.FAST_BULK_READ),
}
_LX_READS = {Command.READ_ID, Command.READ_LIMITS, Command.READ_TEMPERATURE, Command.READ_VOLTAGE}
_LX_READS |= {Command.READ_POSITION, Command.READ_LOAD}
_STS_READS = {0x01, 0x02, 0x82}


class WireTap:
    """Every byte that ports of a `Loopback` send from now on.

    Attributes:
        sent: the bytes.
    """

    def __init__(self, world: Loopback) -> None:
        self.sent = bytearray()
        self._open = world.open_port
        world.open_port = self._tapped  # type: ignore[method-assign]

    def _tapped(self, name: str, baud: int) -> LoopbackPort:
        port = self._open(name, baud)
        send = port.send

        def tapped(data: bytes) -> None:
            self.sent += data
            send(data)

        port.send = tapped  # type: ignore[method-assign]
        return port

    def writes(self, protocol: str) -> Counter[tuple[int, int]]:
        """Number of instructions that are not reads, by (instruction, first address); -1: it has none."""
        if protocol == "dynamixel2":
            packets = [(p.instruction, p.params) for p in Decoder().feed(bytes(self.sent))]
            return Counter(
                (code, int.from_bytes(params[:2], "little") if len(params) > 1 else -1)
                for code, params in packets
                if code not in _READS
            )
        form, reads = (STS, _STS_READS) if protocol == "feetech" else (LX, _LX_READS)
        return Counter(
            (p.code, p.params[0] if p.params else -1)
            for p in SumDecoder(form).feed(bytes(self.sent))
            if p.code not in reads
        )

    def clear(self) -> None:
        """Forget what was sent."""
        self.sent.clear()
