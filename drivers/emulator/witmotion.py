"""`WitMotionLine`: an emulated inertial sensor that speaks the WIT standard protocol on a port of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot_file import Quaternion
from flexmotion.drivers.emulator.body import Body
from flexmotion.drivers.emulator.faults import Damage, Fault, FaultKind
from flexmotion.drivers.emulator.line import Line, Port
from flexmotion.drivers.emulator.wire import Reply, Wire
from flexmotion.drivers.imu.witmotion.protocol import (
    ACCEL_FULL_G,
    FULL,
    GYRO_FULL_DEG_S,
    KEY,
    RATES,
    CommandDecoder,
    Kind,
    Output,
    Register,
    frame,
)
from flexmotion.spatial.gravity import GRAVITY

TEMPERATURE = 2500
"""What it says of its temperature [0.01 °C]."""

UNLOCKED_S = 10.0
"""How long its registers may be written after the key came [s]."""

FACTORY_RATE_HZ = 10
"""Samples a second of one that was just switched on."""


class WitMotionLine(Line):
    """A sensor that sends samples unasked; output, rate and lock act, its low-pass is not emulated.

    Args:
        body: what it sits in.
        mount: the robot file's orientation of the sensor in the body, w x y z.
        baud: bit rate that it is set to; at another nobody understands the other.

    Attributes:
        samples: sent so far.
    """

    def __init__(
        self, name: str, body: Body, mount: Quaternion, baud: int, terminal: Port, wire: Wire, damage: Damage
    ) -> None:
        super().__init__(name, terminal, wire, damage)
        self.samples = 0
        self._body, self._baud = body, baud
        self._unmount = Rotation.from_quat(mount, scalar_first=True).as_matrix().T
        self._decoder = CommandDecoder()
        self._output, self._period = Output.ACCEL | Output.GYRO, 1.0 / FACTORY_RATE_HZ
        self._unlocked_until = -math.inf
        self._next = math.nan

    @property
    def due(self) -> float:
        """See `Line`."""
        return min(super().due, self._next if self._output else math.inf)

    def act(self, faults: Sequence[Fault]) -> None:
        """See `Line`; its cable is not the servos'."""
        self.damage.act(faults)
        self.cut = any(fault.kind is FaultKind.IMU for fault in faults)

    def receive(self, now: float) -> None:
        """See `Line`."""
        data = self.terminal.read()
        if self.cut or self.terminal.baud != self._baud:
            return
        for register, value in self._decoder.feed(self.damage.spoil(data)[0]):
            if register == Register.KEY:
                self._unlocked_until = now + UNLOCKED_S if value == KEY else -math.inf
            elif now >= self._unlocked_until:
                continue
            elif register == Register.OUTPUT:
                self._output = Output(value & (Output.ACCEL | Output.GYRO))
            elif register == Register.RATE:
                rates = {code: hertz for hertz, code in RATES.items()}
                self._period = 1.0 / rates[value] if value in rates else math.inf
                self._next = now + self._period

    def deliver(self, now: float) -> None:
        """See `Line`; and put the next sample on the wire."""
        if math.isnan(self._next):
            self._next = now
        if now >= self._next and self._output:
            # One that is kept from it does not hurry after it.
            self._next = max(self._next + self._period, now - self._period)
            self._send(now)
        super().deliver(now)

    def report(self, elapsed: float) -> dict[str, Any]:
        """See `Line`."""
        return {"samples": self.samples} | super().report(elapsed)

    def _send(self, now: float) -> None:
        body = self._body
        body.sense()
        accel = self._numbers(body.accel, ACCEL_FULL_G * GRAVITY)
        gyro = self._numbers(body.gyro, math.radians(GYRO_FULL_DEG_S))
        frames = []
        if Output.ACCEL in self._output:
            frames.append(frame(Kind.ACCEL, accel))
        if Output.GYRO in self._output:
            frames.append(frame(Kind.GYRO, gyro))
        self.samples += 1
        if self.terminal.baud == self._baud:
            self.wire.answer([(Reply(0, 0.0, each), *self.damage.spoil(each)) for each in frames], self._baud, now)

    def _numbers(self, vector: np.ndarray, full: float) -> tuple[int, int, int, int]:
        """In the sensor's frame, cut off at what it can tell."""
        raw = np.clip(np.rint(self._unmount @ vector * (FULL / full)), -FULL, FULL - 1)
        return int(raw[0]), int(raw[1]), int(raw[2]), TEMPERATURE
