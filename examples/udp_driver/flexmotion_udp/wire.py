"""The datagrams: a byte that says what it is, then float64 in network order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

GOALS, TORQUE, STATE = b"G", b"T", b"S"
"""To the robot: goals [rad] of every joint; torque off (0) or on (1). From it: see `pack_state`."""


def pack(kind: bytes, values: Float) -> bytes:
    """A datagram."""
    return kind + np.asarray(values).astype(">f8").tobytes()


def unpack(datagram: bytes) -> tuple[bytes, Float]:
    """Kind and values; no values where its length is none that a datagram can have."""
    if len(datagram) % 8 != 1:
        return b"", np.zeros(0)
    return datagram[:1], np.frombuffer(datagram, ">f8", offset=1).astype(np.float64)


def pack_state(torque: bool, position: Float, velocity: Float) -> bytes:
    """The state of a robot: whether torque is on, then positions [rad] and speeds [rad/s], (n,) each."""
    return pack(STATE, np.concatenate([[float(torque)], position, velocity]))
