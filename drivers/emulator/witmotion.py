"""`WitMotionLine`: an emulated inertial sensor with the WIT standard protocol on a port of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot_file import Quaternion
from flexmotion.drivers.emulator.body import Body
from flexmotion.drivers.emulator.false_readings import FalseReadings
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
from flexmotion.drivers.random_errors import ImuError
from flexmotion.spatial.gravity import GRAVITY

TEMPERATURE = 2500
"""Its temperature [0.01 °C]."""

UNLOCKED_S = 10.0
"""Time after the key in which registers can be written [s]."""

FACTORY_RATE_HZ = 10
"""Rate after power-up [samples/s]."""


class WitMotionLine(Line):
    """A sensor that sends samples unasked. Output, rate and lock are emulated, the low-pass is not.

    Args:
        body: that carries it.
        mount: orientation of the sensor in the body, as in the robot file, w x y z.
        baud: its bit rate; at another one neither side can decode the other's bytes.
        false_readings: what it reports wrongly.

    Attributes:
        samples: number of samples sent so far.
    """

    def __init__(
        self,
        name: str,
        body: Body,
        mount: Quaternion,
        baud: int,
        terminal: Port,
        wire: Wire,
        damage: Damage,
        false_readings: FalseReadings,
    ) -> None:
        super().__init__(name, terminal, wire, damage)
        self._false = false_readings
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
        """See `Line`. Its cable is separate from the servos'."""
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
        """See `Line`. A sample that is due is put on the wire."""
        if math.isnan(self._next):
            self._next = now
        if now >= self._next and self._output:
            # A late sensor skips samples: it does not make up for them.
            self._next = max(self._next + self._period, now - self._period)
            self._send(now)
        super().deliver(now)

    def report(self, elapsed: float) -> dict[str, Any]:
        """See `Line`."""
        return {"samples": self.samples} | super().report(elapsed)

    def _send(self, now: float) -> None:
        body = self._body
        body.sense()
        error = self._false.of_imu() or ImuError()
        accel = self._numbers(body.accel + error.accel, ACCEL_FULL_G * GRAVITY)
        gyro = self._numbers(body.gyro + error.gyro, math.radians(GYRO_FULL_DEG_S))
        frames = []
        if Output.ACCEL in self._output:
            frames.append(frame(Kind.ACCEL, accel))
        if Output.GYRO in self._output:
            frames.append(frame(Kind.GYRO, gyro))
        self.samples += 1
        if self.terminal.baud == self._baud:
            self.wire.answer([(Reply(0, 0.0, each), *self.damage.spoil(each)) for each in frames], self._baud, now)

    def _numbers(self, vector: np.ndarray, full: float) -> tuple[int, int, int, int]:
        """The numbers of a frame, in the sensor's frame, clipped to the range."""
        raw = np.clip(np.rint(self._unmount @ vector * (FULL / full)), -FULL, FULL - 1)
        return int(raw[0]), int(raw[1]), int(raw[2]), TEMPERATURE
