"""The datagrams: one byte for the kind, then float64 in network order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

GOALS, TORQUE, STATE = b"G", b"T", b"S"
"""To the robot: goals of every joint [rad]; torque off (0) or on (1). From the robot: see `pack_state`."""


def pack(kind: bytes, values: Float) -> bytes:
    """The bytes of a datagram."""
    return kind + np.asarray(values).astype(">f8").tobytes()


def unpack(datagram: bytes) -> tuple[bytes, Float]:
    """Kind and values; empty if the length is not that of a datagram."""
    if len(datagram) % 8 != 1:
        return b"", np.zeros(0)
    return datagram[:1], np.frombuffer(datagram, ">f8", offset=1).astype(np.float64)


def pack_state(torque: bool, position: Float, velocity: Float) -> bytes:
    """The bytes of a robot's state: torque on (1) or off (0), then positions [rad] and speeds [rad/s], (n,) each."""
    return pack(STATE, np.concatenate([[float(torque)], position, velocity]))
