"""`DynamixelDriver`: robots with ROBOTIS Dynamixel servos of Protocol 2.0."""

from __future__ import annotations

from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.dynamixel.bus import DynamixelBus


class DynamixelDriver(BusDriver):
    """ROBOTIS Dynamixel X servos, Protocol 2.0, with or without OP3's OpenCR board."""

    name = "dynamixel"
    Bus = DynamixelBus
