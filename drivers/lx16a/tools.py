"""Bench tools for LX-16A servos."""

from __future__ import annotations

from collections.abc import Iterator

from flexmotion.drivers.bus.packet import MAX_ID
from flexmotion.drivers.bus.sum_client import SumClient
from flexmotion.drivers.bus.tools import BusTools, Found
from flexmotion.drivers.lx16a.protocol import ANSWER_SIZE, BAUD, FORMAT, Command
from flexmotion.drivers.port import SerialPort


class Lx16aTools(BusTools):
    """Tools for LX-16A and compatible servos, which report no model."""

    protocol = "lx16a"
    baud_rates = (BAUD,)

    def __init__(self, port: SerialPort) -> None:
        super().__init__(port)
        self._client = SumClient(port, FORMAT)

    def scan_here(self) -> Iterator[Found]:
        """See `BusTools`. Every id is asked once."""
        for id_ in range(MAX_ID + 1):
            if self._ask(id_, once=True):
                yield Found(self.port.baud, id_, "LX-16A")

    def answers(self, id_: int) -> bool:
        """See `BusTools`."""
        return self._ask(id_)

    def write_id(self, old: int, new: int) -> None:
        """See `BusTools`."""
        self.port.send(FORMAT.encode(old, Command.SET_ID, bytes([new])))

    def _ask(self, id_: int, *, once: bool = False) -> bool:
        answer = self._client.ask(id_, Command.READ_ID, answer=ANSWER_SIZE[Command.READ_ID], once=once)
        return answer is not None
