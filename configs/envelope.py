"""`Envelope`: what servos can give at a speed, a supply and a temperature.

Plans, checks, reports and the page all take it from here. The simulated servos (`drivers/plant.py`) and the receiver's
count of violations (`drivers/receiver.py`) compute theirs on their own on purpose: this is tested against them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.heat import AMBIENT
from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

COPPER = 0.00393
"""Rise of the windings' resistance with temperature [1/K]: annealed copper at 20 °C, IEC 60028. At a given voltage it
takes current, and with it stall torque and back-EMF braking, while the no-load speed stays."""


@dataclass(frozen=True)
class Envelope:
    """The region of torque and speed that servos can give. Arrays over joints, (n,) or (..., n).

    A motor at supply share v makes at most v·stall - b·speed; its gears and its current allow usable torque while it
    drives its load (torque and speed of one sign), and stall torque while it brakes.

    Attributes:
        stall, usable: [N·m].
        back_emf: torque lost per speed [N·m·s/rad].
        nominal_voltage: supply at which the catalogue's figures hold [V].
        temperature_limit: of the servo's own shutdown [°C].
        cap: greatest torque that is asked for, in either direction and at any speed [N·m]; infinite: what the servo can
            give. It raises nothing.
    """

    stall: Float
    usable: Float
    back_emf: Float
    nominal_voltage: Float
    temperature_limit: Float
    cap: Float

    @classmethod
    def of(cls, robot: Robot) -> Envelope:
        """The robot's servos at nominal supply and room temperature, at which the catalogue's figures hold."""
        return cls(
            stall=robot.stall_torque,
            usable=robot.usable_torque,
            back_emf=robot.back_emf,
            nominal_voltage=robot.nominal_voltage,
            temperature_limit=np.array([servo.temperature_limit for servo in robot.servos]),
            cap=np.full(robot.n, np.inf),
        )

    def capped(self, cap: Float) -> Envelope:
        """The envelope of which no more than a torque is asked, (n,) [N·m]; infinite: all of it."""
        return replace(self, cap=np.minimum(self.cap, cap))

    def at(self, voltage: Float | float | None = None, temperature: Float | float | None = None) -> Envelope:
        """The envelope at a supply [V] and a temperature of the windings [°C], (..., n) or one number each.

        Both torques scale with the supply, as in the servo plant. A servo at its temperature limit gives none. Unknown
        values (None, NaN) are nominal.
        """
        share, hot = np.ones_like(self.stall), np.ones_like(self.stall)
        shut = np.zeros_like(self.stall, np.bool_)
        if voltage is not None:
            volts = np.asarray(voltage, dtype=float)
            share = np.where(np.isfinite(volts), volts / self.nominal_voltage, 1.0)
        if temperature is not None:
            warm = np.asarray(temperature, dtype=float)
            warm = np.where(np.isfinite(warm), warm, AMBIENT)
            hot = np.maximum(1.0 + COPPER * (warm - AMBIENT), 1.0)
            shut = warm >= self.temperature_limit
        stall = np.where(shut, 0.0, self.stall * share / hot)
        return replace(self, stall=stall, usable=np.minimum(self.usable * share, stall), back_emf=self.back_emf / hot)

    def bounds(self, speed: Float) -> tuple[Float, Float]:
        """Lowest and highest torque at a speed, (..., n) [N·m, rad/s].

        Beyond the no-load speed the highest is below 0: a servo there cannot but brake.
        """
        drag = self.back_emf * speed
        highest = np.minimum(np.where(speed > 0, self.usable, self.stall), self.stall - drag)
        lowest = np.maximum(-np.where(speed < 0, self.usable, self.stall), -self.stall - drag)
        return np.maximum(lowest, -self.cap), np.minimum(highest, self.cap)

    def limit(self, torque: Float, speed: Float) -> Float:
        """Greatest torque at `speed` in the direction of `torque`, (..., n) [N·m]; 0 where there is none."""
        lowest, highest = self.bounds(speed)
        return np.maximum(np.where(torque > 0, highest, -lowest), 0.0)

    def load(self, torque: Float, speed: Float) -> Float:
        """Share of the envelope that a torque needs, (..., n): 1 on its border, above 1 outside; NaN stays.

        The largest of torque over what gears and current allow, voltage over the supply, and torque over the cap.
        """
        most = np.where(torque * speed > 0, self.usable, self.stall)
        with np.errstate(divide="ignore", invalid="ignore"):
            load = np.maximum(np.abs(torque) / most, np.abs(torque + self.back_emf * speed) / self.stall)
            load = np.maximum(load, np.abs(torque) / self.cap)
        return np.where((torque == 0) & (most == 0), 0.0, load)

    def corners(self, joint: int) -> tuple[Float, Float]:
        """Corners of one joint's region between its no-load speeds: speeds [rad/s], torques [N·m], (10,) each."""
        stall, usable = float(self.stall[joint]), float(self.usable[joint])
        fastest = stall / float(self.back_emf[joint])
        knee = (stall - usable) / float(self.back_emf[joint])
        speed = np.array([0.0, knee, fastest, fastest, 0.0])
        torque = np.array([usable, usable, 0.0, -stall, -stall])
        return np.concatenate([speed, -speed]), np.concatenate([torque, -torque])
