"""`Lx16aDriver`: robots with LX-16A servos."""

from __future__ import annotations

from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.lx16a.bus import Lx16aBus


class Lx16aDriver(BusDriver):
    """Hiwonder / LewanSoul LX-16A servos: one packet per servo, no current measurement."""

    name = "lx16a"
    Bus = Lx16aBus
