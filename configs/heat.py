"""Heating of servos over time: first order, with the constants of the servo catalogue."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flexmotion.configs.robot import Robot

AMBIENT = 25.0
"""Room temperature, at which the catalogue's figures hold [°C]."""


@dataclass(frozen=True)
class Endurance:
    """Heating of a servo that goes on at an RMS torque from room temperature.

    Attributes:
        temperature: final temperature of the windings [°C].
        seconds: time until `limit` [s]; None: never reached.
        duty: share of the time for which it may go on without end, in (0, 1]; the rest is at rest.
        limit: the temperature that is counted as too hot [°C].
        rise: final rise above room temperature [K].
        time_constant: of the rise [s].
    """

    temperature: float
    seconds: float | None
    duty: float
    limit: float
    rise: float
    time_constant: float

    def after(self, seconds: float) -> float:
        """Temperature of the windings after a time [s], from room temperature [°C]."""
        return AMBIENT + self.rise * (1.0 - math.exp(-seconds / self.time_constant))


def endurance(robot: Robot, joint: int, rms_torque: float, margin: float = 0.0) -> Endurance:
    """First-order heating from room temperature: rise at stall times (torque / stall)², as in the servo plant.

    Args:
        rms_torque: [N·m].
        margin: below the servo's own shutdown that counts as too hot [K].
    """
    servo = robot.servos[joint]
    rise = servo.stall_temperature_rise * (rms_torque / servo.stall_torque) ** 2
    limit = servo.temperature_limit - margin
    room = limit - AMBIENT
    constant = servo.thermal_time_constant
    seconds = None if rise <= room else -constant * math.log(1.0 - room / rise)
    duty = 1.0 if rise <= room else room / rise
    return Endurance(AMBIENT + rise, seconds, duty, limit, rise, constant)
