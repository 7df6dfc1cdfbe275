"""`WitMotion`: inertial sensors with the WIT standard protocol on a serial port (WT901, JY901, HWT901B)."""

from __future__ import annotations

import logging
import math
from collections import deque

from pydantic import Field

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot_file import Imu as ImuConfig
from flexmotion.configs.schema import Strict
from flexmotion.drivers.imu.interface import OpenPort, StandaloneImu
from flexmotion.drivers.imu.witmotion.protocol import (
    ACCEL_FULL_G,
    BANDWIDTHS,
    FRAME_SIZE,
    FULL,
    GYRO_FULL_DEG_S,
    KEY,
    RATES,
    FrameDecoder,
    Kind,
    Output,
    Register,
    command,
)
from flexmotion.drivers.port import BITS_A_BYTE, SerialPort
from flexmotion.spatial.gravity import GRAVITY

SAMPLE_SIZE = 2 * FRAME_SIZE
"""Bytes of a sample: a frame of acceleration and one of angular velocity."""

COMMAND_GAP_S = 0.1
"""Time that the sensor needs between commands (as in the vendor's examples) [s]."""

LISTEN_S = 0.3
"""Time in which `open` counts samples [s]."""

FRESH_SAMPLES = 1.5
"""Age up to which a sample is fresh [sample periods]."""

ENOUGH = 0.8
"""Smallest share of the expected samples that must arrive."""

WINDOW_S = 0.1
"""Window in which samples are counted [s]."""

WINDOW_READS = 256
"""Largest number of reads in the window; a loop that reads more often has a shorter one."""

BAD_SHARE = 0.001
"""Share of broken frames above which `close` warns."""

log = logging.getLogger(__name__)


class WitOptions(Strict):
    """Serial port of the sensor, and the bit rate that it is set to (factory setting: 9600 or 115200)."""

    port: str
    baud: int = Field(default=115_200, gt=0)


class WitMotion(StandaloneImu):
    """WitMotion's sensors with the WIT standard protocol, on a serial port of their own.

    They send samples unasked. Content, rate and bandwidth are set at `open` and not saved: the sensor returns to its
    own settings when its power goes off.
    """

    name = "witmotion"
    Options = WitOptions

    def __init__(self, config: ImuConfig, *, options: Strict | None = None) -> None:
        super().__init__(config, options=options)
        if not isinstance(self.options, WitOptions):
            raise TypeError(f"{type(self).__name__} takes WitOptions, not {type(self.options).__name__}")
        self._path, self._baud = self.options.port, self.options.baud
        self._port: SerialPort | None = None
        self._decoder = FrameDecoder()
        self._to_accel = self.mount * (ACCEL_FULL_G * GRAVITY / FULL)
        self._to_gyro = self.mount * (math.radians(GYRO_FULL_DEG_S) / FULL)
        self._pending: tuple[int, int, int] | None = None
        self._samples, self._looked_at, self._fresh_until = 0, 0.0, 0.0
        self._window: deque[tuple[float, int]] = deque(maxlen=WINDOW_READS)

    def open(self, open_port: OpenPort, rate_hz: float) -> None:
        """See `StandaloneImu`. Takes about a second. Raises `DriverError` if too few samples arrive."""
        samples = min((rate for rate in RATES if rate >= rate_hz), default=max(RATES))
        needed = samples * SAMPLE_SIZE * BITS_A_BYTE
        where = f"IMU {self.name} on {self._path}"
        if needed > self._baud:
            raise DriverError(f"{where}: {samples} samples a second need more than {needed} baud, it has {self._baud}")
        self._samples = samples
        self._port = open_port(self._path, self._baud)
        try:
            self._set_up(self._port, samples)
            came = self._listen(self._port)
            if came < ENOUGH * LISTEN_S * samples:
                found = f"{came / LISTEN_S:.0f} samples a second, {samples} were asked for" if came else "no sample"
                raise DriverError(f"{where}: {found} at {self._baud} baud")
        except BaseException:
            self.close()
            raise

    def read(self, now: float) -> bool:
        """See `Imu`."""
        came, since = self._take_all(), self._looked_at
        self._looked_at = now
        # Bytes have no time stamps. If many fewer samples arrived than were due, the stream was interrupted, and the
        # last sample may be as old as the pause of the loop.
        unbroken = came > max(ENOUGH * (now - since) * self._samples - 2, 0)
        if not self._keeps_up(since, now, came):
            self._fresh_until = now
        elif unbroken:
            self._fresh_until = now + FRESH_SAMPLES / self._samples
        return now < self._fresh_until

    def close(self) -> None:
        """See `StandaloneImu`."""
        if self._port is None:
            return
        self._port.close()
        self._port = None
        if self.bad > BAD_SHARE * self._decoder.good:
            log.warning("IMU %s on %s: %d broken frames: check its cable", self.name, self._path, self.bad)

    @property
    def bad(self) -> int:
        """Number of broken frames so far."""
        return self._decoder.bad

    def _keeps_up(self, since: float, now: float, came: int) -> bool:
        """Whether enough samples arrived in the window that ends now; `open` fills the first window.

        A sensor whose supply dipped falls back to its own rate: each sample is new, but they are too few to integrate.
        """
        window = self._window
        window.append((since, came))
        while len(window) > 1 and window[1][0] <= now - WINDOW_S:
            window.popleft()
        due = (now - window[0][0]) * self._samples
        return sum(samples for _, samples in window) >= ENOUGH * due

    def _set_up(self, port: SerialPort, samples: int) -> None:
        # The widest below half the sampling rate: a low-pass adds delay.
        bandwidth = max(hz for hz in BANDWIDTHS if hz <= samples / 2)
        for register, value in (
            (Register.OUTPUT, Output.ACCEL | Output.GYRO),
            (Register.BANDWIDTH, BANDWIDTHS[bandwidth]),
            (Register.RATE, RATES[samples]),
        ):
            for packet in (command(Register.KEY, KEY), command(register, value)):
                port.send(packet)
                port.sleep(COMMAND_GAP_S)

    def _listen(self, port: SerialPort) -> int:
        """Number of samples that arrive in `LISTEN_S`."""
        self._take_all()
        came, begin = 0, port.now()
        end = begin + LISTEN_S
        while port.lost is None and (now := port.now()) < end:
            port.wait_any([port], end - now)
            came += self._take_all()
        self._looked_at = port.now()
        self._window.clear()
        self._window.append((begin, came))
        return came

    def _take_all(self) -> int:
        """Take all received bytes; the number of samples that they complete. `gyro` and `accel` are the last one."""
        samples = 0
        while self._port is not None and (data := self._port.receive()):
            for kind, numbers in self._decoder.feed(data):
                if kind == Kind.ACCEL:
                    self._pending = numbers[:3]
                elif kind == Kind.GYRO and self._pending is not None:
                    self._to_accel.dot(self._pending, out=self.accel)
                    self._to_gyro.dot(numbers[:3], out=self.gyro)
                    self._pending = None
                    samples += 1
        return samples
