"""Bench tools for Dynamixel servos."""

from __future__ import annotations

import time
from collections.abc import Iterator

from flexmotion.configs.errors import DriverError
from flexmotion.drivers.bus.tools import BusTools, Found, model_name
from flexmotion.drivers.dynamixel.registers import BAUD_RATES, open_cr, table_of
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.port import SerialPort

_REBOOT_S = 3.0
"""Longest restart of a servo [s]; some tenths are usual."""
_ANY = table_of("XM430-W350")
"""Id, torque and firmware version have the same address in every table of the X series."""


class DynamixelTools(BusTools):
    """Tools for Protocol 2.0."""

    protocol = "dynamixel2"
    baud_rates = BAUD_RATES[:-1]  # the SDK and most adapters do not support 4.5 M

    def __init__(self, port: SerialPort) -> None:
        super().__init__(port)
        self._client = Client(port)

    def scan_here(self) -> Iterator[Found]:
        """See `BusTools`."""
        for id_, (model, firmware) in sorted(self._client.find().items()):
            name = "OpenCR board" if model == open_cr().model_number else model_name(model)
            yield Found(self.port.baud, id_, name, firmware)

    def answers(self, id_: int) -> bool:
        """See `BusTools`."""
        return self._client.ping(id_) is not None

    def write_id(self, old: int, new: int) -> None:
        """See `BusTools`. Raises `DriverError` while torque is on."""
        if self._client.read(old, _ANY["torque_enable"]):
            raise DriverError(f"port {self.port.path}: id {old}: torque is on, which locks the id")
        self._client.write(old, _ANY["id"], new)

    def reboot(self, id_: int) -> None:
        """See `BusTools`. Returns once the servo answers again."""
        self._client.reboot(id_)
        end = time.monotonic() + _REBOOT_S
        while self._client.ping(id_, once=True) is None:
            if time.monotonic() > end:
                raise DriverError(f"port {self.port.path}: id {id_}: does not answer {_REBOOT_S:g} s after a reboot")
