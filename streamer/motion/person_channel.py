"""`PersonChannel`: poses of the person who is mirrored, from the process that receives them to planner and log."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.human.body import Body, Segments
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.records import Float, Int, Record, column

FPS = 30.0
"""Poses a second."""
_KEPT = 128
_SIZES = len(fields(Segments))


class PersonRow(Record):
    """A pose of the person."""

    stream: Int = column("i8")
    """Number of the unbroken stream that it belongs to, from 1."""
    time_s: Float = column("f8")
    """Of the pose, a multiple of 1 / `FPS` [s]; `perf_counter`, in lockstep the time of the loop's ticks."""
    arrived_s: Float = column("f8")
    """Arrival of the frame that completed it, on the same clock [s]."""
    height: Float = column("f8")
    """Of the person [m]; `mass`: its guess [kg]; `segments`: the `Segments`, in their order."""
    mass: Float = column("f8")
    segments: Float = column("f8", _SIZES)
    root_position: Float = column("f8", 3)
    """See `Motion`; here on the floor z = 0, wherever the sender's origin is."""
    root_quaternion: Float = column("f8", 4)
    joints: Float = column("f8", len(JOINTS))


@dataclass(frozen=True)
class PersonPose:
    """A pose of the person; see `PersonRow`.

    Attributes:
        motion: one frame.
    """

    stream: int
    time_s: float
    arrived_s: float
    motion: Motion


class PersonChannel:
    """Poses in shared memory: one writer, any number of readers."""

    def __init__(self) -> None:
        self._ring = Ring(PersonRow.dtype(), _KEPT)
        self._row = PersonRow(np.zeros((), PersonRow.dtype()))

    def publish(self, pose: PersonPose) -> None:
        """Append a pose."""
        row, motion = self._row, pose.motion
        row.stream[...], row.time_s[...], row.arrived_s[...] = pose.stream, pose.time_s, pose.arrived_s
        row.height[...], row.mass[...] = motion.body.height, motion.body.mass
        row.segments[...] = astuple(motion.body.segments)
        row.root_position[...], row.root_quaternion[...] = motion.root_position[0], motion.root_quaternion[0]
        row.joints[...] = motion.joints[0]
        self._ring.publish(np.asarray(row.array))

    def publish_row(self, row: NDArray[np.void]) -> None:
        """Append a row of a log."""
        self._ring.publish(row)

    def reader(self, *, new_only: bool = False) -> Reader:
        """A reader of the rows; see `Ring.reader`."""
        return self._ring.reader(new_only=new_only)


def pose_of(array: NDArray[np.void]) -> PersonPose:
    """The pose in a row."""
    row = PersonRow(array)
    body = Body(float(row.height), float(row.mass), fitted=Segments(*(float(size) for size in row.segments)))
    motion = Motion(
        FPS,
        row.root_position[None].copy(),
        row.root_quaternion[None].copy(),
        row.joints[None].copy(),
        body,
        source="person",
    )
    return PersonPose(int(row.stream), float(row.time_s), float(row.arrived_s), motion)
