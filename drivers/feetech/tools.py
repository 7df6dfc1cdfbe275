"""Bench tools for Feetech servos."""

from __future__ import annotations

from collections.abc import Iterator

from flexmotion.drivers.bus.packet import MAX_ID
from flexmotion.drivers.bus.sum_client import SumClient
from flexmotion.drivers.bus.tools import BusTools, Found, model_name
from flexmotion.drivers.feetech.registers import BAUD_RATES, FORMAT, Instruction, sts
from flexmotion.drivers.port import SerialPort


class FeetechTools(BusTools):
    """Tools for the STS series."""

    protocol = "feetech"
    baud_rates = BAUD_RATES

    def __init__(self, port: SerialPort) -> None:
        super().__init__(port)
        self._client = SumClient(port, FORMAT)

    def scan_here(self) -> Iterator[Found]:
        """See `BusTools`. Every id is asked once."""
        model = sts()["model_number"]
        for id_ in range(MAX_ID + 1):
            params = bytes([model.address, model.size])
            answer = self._client.ask(id_, Instruction.READ, params, answer=model.size, once=True)
            if answer is not None:
                yield Found(self.port.baud, id_, model_name(model.unpack(answer.params)))

    def answers(self, id_: int) -> bool:
        """See `BusTools`."""
        return self._client.ask(id_, Instruction.PING, answer=0) is not None

    def write_id(self, old: int, new: int) -> None:
        """See `BusTools`."""
        lock, address = sts()["lock"].address, sts()["id"].address
        self._client.ask(old, Instruction.WRITE, bytes([lock, 0]), answer=0)
        self._client.ask(old, Instruction.WRITE, bytes([address, new]), answer=0, once=True)
        self._client.ask(new, Instruction.WRITE, bytes([lock, 1]), answer=0)
