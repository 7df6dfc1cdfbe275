"""Fault injection for emulated buses."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from flexmotion.configs.errors import ConfigError


class FaultKind(StrEnum):
    """The kinds of faults."""

    LOST = "lost"
    CORRUPT = "corrupt"
    LATE = "late"
    DUPLICATED = "duplicated"
    TRUNCATED = "truncated"
    DEAD = "dead"
    OVERHEAT = "overheat"
    VOLTAGE = "voltage"
    RESET = "reset"
    CABLE = "cable"
    PORT = "port"
    IMU = "imu"
    ECHO = "echo"
    BLOCKED = "blocked"
    TRIPPED = "tripped"
    FALSE_POSITION = "false_position"
    FALSE_SPEED = "false_speed"
    FALSE_TORQUE = "false_torque"
    FALSE_VOLTAGE = "false_voltage"
    FALSE_TEMPERATURE = "false_temperature"
    FALSE_GYRO = "false_gyro"
    FALSE_ACCEL = "false_accel"


PACKET_FAULTS = (
    FaultKind.LOST,
    FaultKind.CORRUPT,
    FaultKind.LATE,
    FaultKind.DUPLICATED,
    FaultKind.TRUNCATED,
)
"""Faults of one packet, in either direction."""

FALSE_OF_SERVO = (
    FaultKind.FALSE_POSITION,
    FaultKind.FALSE_SPEED,
    FaultKind.FALSE_TORQUE,
    FaultKind.FALSE_VOLTAGE,
    FaultKind.FALSE_TEMPERATURE,
)
FALSE_OF_IMU = (FaultKind.FALSE_GYRO, FaultKind.FALSE_ACCEL)
"""False readings of a servo, and of an inertial sensor (`flexmotion.drivers.emulator.false_readings`)."""

MEANING = {
    FaultKind.LOST: "every packet is lost",
    FaultKind.CORRUPT: "every packet has one bit wrong",
    FaultKind.LATE: "every reply is late by ARGUMENT [s], default 0.02",
    FaultKind.DUPLICATED: "every packet is sent twice",
    FaultKind.TRUNCATED: "every packet is cut short",
    FaultKind.DEAD: "the device with id ARGUMENT does not answer",
    FaultKind.OVERHEAT: "the servo with id ARGUMENT is too hot",
    FaultKind.VOLTAGE: "the supply is at ARGUMENT [V]",
    FaultKind.RESET: "the servo with id ARGUMENT loses power for a moment",
    FaultKind.CABLE: "the cable to the servos is pulled: no byte passes",
    FaultKind.PORT: "the adapter is unplugged: the port is gone",
    FaultKind.IMU: "the inertial sensor is silent",
    FaultKind.ECHO: "the adapter returns what the host sends, as one without a direction switch does",
    FaultKind.BLOCKED: "the joint of the servo with id ARGUMENT does not move",
    FaultKind.TRIPPED: "the bus watchdog of the servo with id ARGUMENT trips, once",
    FaultKind.FALSE_POSITION: "the servo with id ARGUMENT reports its position plus VALUE [servo units]",
    FaultKind.FALSE_SPEED: "the servo with id ARGUMENT reports its speed plus VALUE [rad/s]",
    FaultKind.FALSE_TORQUE: "the servo with id ARGUMENT reports its torque plus VALUE [N·m]",
    FaultKind.FALSE_VOLTAGE: "the servo with id ARGUMENT reports its supply plus VALUE [V]",
    FaultKind.FALSE_TEMPERATURE: "the servo with id ARGUMENT reports its temperature plus VALUE [°C]",
    FaultKind.FALSE_GYRO: "the inertial sensor reports ARGUMENT more on every axis of its gyroscope [rad/s]",
    FaultKind.FALSE_ACCEL: "the inertial sensor reports ARGUMENT more on every axis of its accelerometer [m/s²]",
}

OF_SERVO = {
    *(FaultKind.DEAD, FaultKind.OVERHEAT, FaultKind.RESET, FaultKind.BLOCKED, FaultKind.TRIPPED, *FALSE_OF_SERVO),
}
"""Kinds whose argument is the id of a servo."""
_WITH_ARGUMENT = OF_SERVO | {FaultKind.VOLTAGE, *FALSE_OF_IMU}
_FORM = "KIND[:ARGUMENT[:VALUE]][@SECONDS[+DURATION|+once]]"
_TEXT = re.compile(
    r"(?P<kind>[a-z_]+)(:(?P<argument>-?[\d.]+)(:(?P<value>-?[\d.]+))?)?"
    r"(@(?P<at>[\d.]+)(\+((?P<seconds>[\d.]+)|(?P<once>once)))?)?"
)


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        kind: of the fault.
        argument: id, voltage [V] or time [s], depending on the kind; NaN: none.
        at: start, counted from the time that torque first goes on [s]; negative: from the start of the emulation.
        seconds: duration [s].
        value: error of a servo's false readings, in the unit of `MEANING`; NaN: none.
        once: whether a single reading is false, the next one after `at`.
    """

    kind: FaultKind
    argument: float = math.nan
    at: float = -math.inf
    seconds: float = math.inf
    value: float = math.nan
    once: bool = False

    @classmethod
    def parse(cls, text: str) -> Fault:
        """`KIND[:ARGUMENT[:VALUE]][@SECONDS[+DURATION|+once]]`, as on the command line. Raises `ConfigError`."""
        match = _TEXT.fullmatch(text)
        kinds = ", ".join(FaultKind)
        if match is None or match["kind"] not in set(FaultKind):
            raise ConfigError(f"fault {text!r}: expected {_FORM}, KIND one of: {kinds}")
        kind, false = FaultKind(match["kind"]), match["kind"] in {*FALSE_OF_SERVO, *FALSE_OF_IMU}
        if kind in _WITH_ARGUMENT and match["argument"] is None:
            raise ConfigError(f"fault {text!r}: {kind} needs an argument: {MEANING[kind]}")
        if (kind in FALSE_OF_SERVO) != (match["value"] is not None):
            raise ConfigError(
                f"fault {text!r}: {'needs a' if kind in FALSE_OF_SERVO else 'has no'} VALUE: {MEANING[kind]}"
            )
        if match["once"] and not false:
            raise ConfigError(f"fault {text!r}: only a false reading can be for once")
        try:
            argument = float(match["argument"] or "nan")
            at = float(match["at"] or "-inf")
            seconds = float(match["seconds"] or "inf")
            value = float(match["value"] or "nan")
        except ValueError as error:
            raise ConfigError(f"fault {text!r}: {error}") from error
        return cls(kind, argument, at, seconds, value, once=match["once"] is not None)

    def active(self, since_torque: float) -> bool:
        """Whether it is active; `since_torque` is the time since torque first went on [s], negative before."""
        return self.at <= since_torque < self.at + self.seconds or (self.at < 0 and math.isinf(self.seconds))


class Damage:
    """Damages packets on one bus: active faults, and a share of random ones.

    Args:
        bad_packets: share of packets that are lost, corrupted, late, duplicated or cut short at random.
        seed: of the random damage.

    Attributes:
        spoilt: number of damaged packets so far, by kind.
    """

    def __init__(self, bad_packets: float = 0.0, seed: int = 0) -> None:
        self.bad_packets = bad_packets
        self.spoilt = dict.fromkeys(PACKET_FAULTS, 0)
        self._random = np.random.default_rng(seed)
        self._acting: Sequence[Fault] = ()

    def act(self, faults: Iterable[Fault]) -> None:
        """Set the active faults; they apply to every packet, in addition to random damage."""
        self._acting = [fault for fault in faults if fault.kind in PACKET_FAULTS]

    def spoil(self, packet: bytes) -> tuple[bytes, float]:
        """The damaged packet, and its extra delay [s]."""
        delay = 0.0
        for fault in self._acting:
            packet, later = self._apply(fault.kind, packet, fault.argument)
            delay += later
        if self.bad_packets and self._random.random() < self.bad_packets:
            kind = PACKET_FAULTS[self._random.integers(len(PACKET_FAULTS))]
            packet, later = self._apply(kind, packet, math.nan)
            delay += later
        return packet, delay

    def _apply(self, kind: FaultKind, packet: bytes, argument: float) -> tuple[bytes, float]:
        self.spoilt[kind] += 1
        if kind is FaultKind.LOST or not packet:
            return b"", 0.0
        if kind is FaultKind.LATE:
            return packet, 0.02 if math.isnan(argument) else argument
        if kind is FaultKind.DUPLICATED:
            return packet + packet, 0.0
        at = int(self._random.integers(len(packet)))
        if kind is FaultKind.TRUNCATED:
            return packet[:at], 0.0
        wrong = bytearray(packet)
        wrong[at] ^= 1 << int(self._random.integers(8))
        return bytes(wrong), 0.0
