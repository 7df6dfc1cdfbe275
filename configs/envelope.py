"""Torque limits of servos at a speed, and their heating over time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

AMBIENT = 25.0
"""Room temperature [°C]."""


def torque_limit(robot: Robot, torque: Float, speed: Float) -> Float:
    """Greatest torque of each servo at `speed`, in the direction of `torque`, (..., n) [N·m].

    Braking (torque against speed): stall torque. Driving: the smaller of usable torque and stall - b·|speed|, the
    torque that back-EMF leaves at nominal voltage, at least 0.
    """
    motoring = np.minimum(robot.usable_torque, robot.stall_torque - robot.back_emf * np.abs(speed))
    return np.where(torque * speed > 0, np.maximum(motoring, 0.0), robot.stall_torque)


def envelope(robot: Robot, joint: int) -> tuple[Float, Float]:
    """Corners of the region of `torque_limit` in the speed-torque plane: speeds [rad/s], torques [N·m], (10,) each."""
    stall, usable, fastest = robot.stall_torque[joint], robot.usable_torque[joint], robot.no_load_speed[joint]
    knee = (stall - usable) / robot.back_emf[joint]
    speed = np.array([0.0, knee, fastest, fastest, 0.0])
    torque = np.array([usable, usable, 0.0, -stall, -stall])
    return np.concatenate([speed, -speed]), np.concatenate([torque, -torque])


@dataclass(frozen=True)
class Endurance:
    """Heating of a servo at an RMS torque.

    Attributes:
        temperature: final temperature of the windings [°C].
        seconds: time until the servo's temperature limit [s]; None: never reached.
    """

    temperature: float
    seconds: float | None


def endurance(robot: Robot, joint: int, rms_torque: float) -> Endurance:
    """First-order heating from room temperature: rise at stall times (torque / stall)², as in the servo plant."""
    servo = robot.servos[joint]
    rise = servo.stall_temperature_rise * (rms_torque / servo.stall_torque) ** 2
    room = servo.temperature_limit - AMBIENT
    seconds = None if rise <= room else -servo.thermal_time_constant * math.log(1.0 - room / rise)
    return Endurance(AMBIENT + rise, seconds)
