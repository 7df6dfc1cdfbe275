"""`FeetechDriver`: robots with Feetech's serial bus servos."""

from __future__ import annotations

from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.feetech.bus import FeetechBus


class FeetechDriver(BusDriver):
    """Feetech STS servos (STS3215 and relatives)."""

    name = "feetech"
    Bus = FeetechBus
