"""The servo plant: the torque of position servos. Shared by the simulated robot and the emulated bus.

A servo with a proportional position loop drives its motor with a voltage proportional to the error. For supply V,
nominal supply Vn, stall torque s, stiffness kp and back-EMF constant b = s / no-load speed:

    tau = clip(kp (goal - q), -s, s) V/Vn - b qd

bounded by the stall torque while it brakes (tau qd <= 0) and by the usable torque while it drives (tau qd > 0), both
times V/Vn. Friction and rotor inertia are part of the joint (MJCF `frictionloss`, `armature`; the catalogue's where the
MJCF has none).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.heat import AMBIENT
from flexmotion.configs.servo import Servo

Float = NDArray[np.float64]

DAMPED_SHARE = 0.1
"""Share to which position gain and voltage (PWM limit) are lowered while damped; back-EMF brakes the joints."""


class ServoFigures(Protocol):
    """What the plant is computed from: a `Robot`, or several candidates for one servo. Arrays are (n,)."""

    n: int
    servos: tuple[Servo, ...]
    kp: Float
    back_emf: Float
    stall_torque: Float
    usable_torque: Float
    nominal_voltage: Float


class ServoPlant:
    """All servos of a robot. Every array is (n,), in robot order, and filled in place.

    Attributes:
        goal: goal position in effect, quantised by the caller [rad].
        enabled: torque is on, bool.
        torque_bound: bound on the torque [N·m]; infinite: none.
        supply: voltage of the source at no current [V].
        resistance: of source and wiring [Ohm].
        torque: last torque [N·m].
        saturated: whether a limit reduced the last torque, bool.
        voltage: at the servos [V], one number.
        current: of the source [A], one number.
        temperature: of the windings [°C].
    """

    def __init__(
        self, robot: ServoFigures, *, kp_scale: float = 1.0, supply: float | None = None, resistance: float = 0.0
    ):
        """`supply` defaults to the lowest nominal voltage of the servos."""
        n = robot.n
        self.goal = np.zeros(n)
        self.enabled = np.zeros(n, np.bool_)
        self.torque_bound = np.full(n, np.inf)
        self.supply = float(robot.nominal_voltage.min()) if supply is None else supply
        self.resistance = resistance
        self.torque = np.zeros(n)
        self.saturated = np.zeros(n, np.bool_)
        self.voltage, self.current = self.supply, 0.0
        self.temperature = np.full(n, AMBIENT)

        self._robot = robot
        self._kp = robot.kp * kp_scale
        self._drive_share, self._gain_share = np.ones(n), 1.0
        servos = robot.servos
        self._rise = np.array([servo.stall_temperature_rise for servo in servos])
        self._time_constant = np.array([servo.thermal_time_constant for servo in servos])
        self._torque_constant = np.array(
            [servo.torque_constant or servo.stall_torque / servo.stall_current for servo in servos]
        )
        self._gain, self._drive_peak, self._least_drive = (np.zeros(n) for _ in range(3))
        self._peak, self._motoring_peak = np.zeros(n), np.zeros(n)
        self._asked, self._drive, self._pushed, self._limit, self._scratch = (np.zeros(n) for _ in range(5))
        self._flag = np.zeros(n, np.bool_)
        self._refresh()

    def set_supply(self, volts: float) -> None:
        """Set the voltage of the source [V]."""
        self.supply = volts
        self.voltage = volts - self.resistance * self.current
        self._refresh()

    def set_gain(self, kp: Float) -> None:
        """Set the stiffness at nominal supply, (n,) [N·m/rad]."""
        self._kp[:] = kp
        self._refresh()

    def set_drive_share(self, share: Float | float) -> None:
        """Set the share of the supply that may drive the motors (the PWM limit), (n,) or one number in [0, 1]."""
        self._drive_share[:] = share
        self._refresh()

    def damp(self) -> None:
        """Lower gain and PWM limit to `DAMPED_SHARE`, so that joints give way and mainly back-EMF brakes them."""
        self._gain_share = DAMPED_SHARE
        self.set_drive_share(DAMPED_SHARE)

    def stiffen(self) -> None:
        """Restore full gain and PWM limit."""
        self._gain_share = 1.0
        self.set_drive_share(1.0)

    def step(self, position: Float, velocity: Float) -> Float:
        """Torque at joint `position` [rad] and `velocity` [rad/s]; (n,) [N·m], overwritten by the next call."""
        torque, flag = self.driven(position, velocity), self._flag
        np.not_equal(self._drive, self._asked, out=self.saturated)
        np.not_equal(torque, self._pushed, out=flag)
        self.saturated |= flag

        torque *= self.enabled
        self.saturated &= self.enabled
        return torque

    def driven(self, position: Float, velocity: Float) -> Float:
        """As `step`, of joints that are all enabled and without `saturated`: a fit needs no more."""
        asked, drive, pushed, limit, scratch, flag, torque = (
            self._asked,
            self._drive,
            self._pushed,
            self._limit,
            self._scratch,
            self._flag,
            self.torque,
        )
        # PWM stage: proportional to the error, saturated at its limit.
        np.subtract(self.goal, position, out=asked)
        asked *= self._gain
        np.minimum(asked, self._drive_peak, out=drive)
        np.maximum(drive, self._least_drive, out=drive)

        # Motor: minus back-EMF, then the envelope.
        np.multiply(self._robot.back_emf, velocity, out=scratch)
        np.subtract(drive, scratch, out=pushed)
        np.multiply(pushed, velocity, out=scratch)
        np.greater(scratch, 0.0, out=flag)
        np.copyto(limit, self._peak)
        np.copyto(limit, self._motoring_peak, where=flag)
        np.minimum(limit, self.torque_bound, out=limit)
        np.minimum(pushed, limit, out=torque)
        np.negative(limit, out=limit)
        np.maximum(torque, limit, out=torque)
        return torque

    def draw(self, torque: Float, seconds: float) -> None:
        """Update temperature and supply voltage for `torque`, the mean over the last `seconds`, (n,) [N·m].

        Two first-order models, both assumptions: windings warm with (torque / stall)²; the source delivers each motor's
        current times its share of the supply, and its voltage drops by resistance times current.
        """
        robot, load = self._robot, self._scratch
        np.divide(torque, robot.stall_torque, out=load)
        load *= load
        load *= self._rise
        load -= self.temperature
        load += AMBIENT
        load /= self._time_constant
        load *= seconds
        self.temperature += load

        if self.resistance:
            np.divide(torque, self._torque_constant, out=load)
            load *= self._drive
            load /= robot.stall_torque
            np.maximum(load, 0.0, out=load)  # regenerated current is not counted
            self.current = float(load.sum())
            self.voltage = self.supply - self.resistance * self.current
            self._refresh()

    def _refresh(self) -> None:
        """Gain and limits at the present supply."""
        robot = self._robot
        np.divide(self.voltage, robot.nominal_voltage, out=self._scratch)
        np.multiply(robot.stall_torque, self._scratch, out=self._peak)
        np.multiply(robot.usable_torque, self._scratch, out=self._motoring_peak)
        np.multiply(self._peak, self._drive_share, out=self._drive_peak)
        np.negative(self._drive_peak, out=self._least_drive)
        np.multiply(self._kp, self._scratch, out=self._gain)
        self._gain *= self._gain_share
