"""Faults on demand: what an emulated bus does wrong, and when."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from flexmotion.configs.errors import ConfigError


class FaultKind(StrEnum):
    """Every fault; those with an argument are written `kind:argument`."""

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


PACKET_FAULTS = (
    FaultKind.LOST,
    FaultKind.CORRUPT,
    FaultKind.LATE,
    FaultKind.DUPLICATED,
    FaultKind.TRUNCATED,
)
"""Faults of one packet, in either direction."""

MEANING = {
    FaultKind.LOST: "every packet is lost",
    FaultKind.CORRUPT: "every packet has one bit wrong",
    FaultKind.LATE: "every reply comes late by the argument [s], 0.02 if not given",
    FaultKind.DUPLICATED: "every packet comes twice",
    FaultKind.TRUNCATED: "every packet is cut short",
    FaultKind.DEAD: "the device with id ARGUMENT says nothing",
    FaultKind.OVERHEAT: "the servo with id ARGUMENT is too hot",
    FaultKind.VOLTAGE: "the supply is at ARGUMENT [V]",
    FaultKind.RESET: "the servo with id ARGUMENT loses power for a moment",
    FaultKind.CABLE: "the cable to the servos is pulled: nothing gets through",
    FaultKind.PORT: "the adapter is unplugged: the port is gone",
    FaultKind.IMU: "the inertial sensor says nothing",
}

_WITH_ARGUMENT = {FaultKind.DEAD, FaultKind.OVERHEAT, FaultKind.VOLTAGE, FaultKind.RESET}
_TEXT = re.compile(r"(?P<kind>[a-z]+)(:(?P<argument>[\d.]+))?(@(?P<at>[\d.]+)(\+(?P<seconds>[\d.]+))?)?")


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        kind: which.
        argument: an id, volts or seconds, as the kind demands; NaN where there is none.
        at: when it begins, from the moment that torque first goes on [s]; negative: from the start.
        seconds: how long it lasts [s].
    """

    kind: FaultKind
    argument: float = math.nan
    at: float = -math.inf
    seconds: float = math.inf

    @classmethod
    def parse(cls, text: str) -> Fault:
        """`KIND[:ARGUMENT][@SECONDS[+DURATION]]`, as on the command line. Raises `ConfigError`."""
        match = _TEXT.fullmatch(text)
        kinds = ", ".join(FaultKind)
        if match is None or match["kind"] not in set(FaultKind):
            raise ConfigError(f"fault {text!r}: expected KIND[:ARGUMENT][@SECONDS[+DURATION]], KIND one of: {kinds}")
        kind = FaultKind(match["kind"])
        if kind in _WITH_ARGUMENT and match["argument"] is None:
            raise ConfigError(f"fault {text!r}: {kind} needs an argument: {MEANING[kind]}")
        try:
            argument = float(match["argument"] or "nan")
            at = float(match["at"] or "-inf")
            seconds = float(match["seconds"] or "inf")
        except ValueError as error:
            raise ConfigError(f"fault {text!r}: {error}") from error
        return cls(kind, argument, at, seconds)

    def active(self, since_torque: float) -> bool:
        """Whether it acts now; `since_torque` is the time since torque first went on, negative before that [s]."""
        return self.at <= since_torque < self.at + self.seconds or (self.at < 0 and math.isinf(self.seconds))


class Damage:
    """What happens to packets on one bus: faults that act now, and a share of random ones.

    Args:
        bad_packets: share of packets that are lost, corrupted, late, duplicated or cut short at random.
        seed: of those.

    Attributes:
        spoilt: packets damaged so far, by kind.
    """

    def __init__(self, bad_packets: float = 0.0, seed: int = 0) -> None:
        self.bad_packets = bad_packets
        self.spoilt = dict.fromkeys(PACKET_FAULTS, 0)
        self._random = np.random.default_rng(seed)
        self._acting: Sequence[Fault] = ()

    def act(self, faults: Iterable[Fault]) -> None:
        """From now on these faults act on every packet, beside the random ones."""
        self._acting = [fault for fault in faults if fault.kind in PACKET_FAULTS]

    def spoil(self, packet: bytes) -> tuple[bytes, float]:
        """What is left of a packet, and how much later it comes [s]."""
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
