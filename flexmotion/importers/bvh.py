"""Reader of Biovision hierarchy files (BVH) with any skeleton.

Rotation channels apply in the order in which they are listed (intrinsic). Position channels of a joint replace its
OFFSET, also in files with six channels for every joint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import MotionFormatError
from flexmotion.importers.capture import Capture

Float = NDArray[np.float64]

CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")
HALF_TURN = 3.2
"""No rotation of a file in radians is greater: half a turn [rad], and some rounding."""
MOVING = 0.3
"""A rotation that changes by more than this is of motion [rad]; in degrees nobody holds that still."""
END = "/end"
"""Suffix of an end site, after the name of its joint."""


@dataclass
class Joint:
    """A joint or end site of the hierarchy; `channels` start at `column` of the motion table."""

    name: str
    parent: int
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    channels: list[str] = field(default_factory=list)
    column: int = 0


def read_bvh(path: Path) -> Capture:
    """Joint positions and orientations of every frame, end sites included (`NAME/end`).

    Raises:
        MotionFormatError: the file cannot be read; names the line and the error.
    """
    lines = _lines(path)
    joints, position = _hierarchy(path, lines)
    fps, table = _motion(path, lines, position, joints)
    positions, rotations = _forward(joints, table)
    return Capture(
        path=str(path),
        fps=fps,
        names=tuple(joint.name for joint in joints),
        positions=positions,
        rotations=rotations,
        parents=tuple(joint.parent for joint in joints),
        zero_positions=_zero_positions(joints),
        warnings=_in_radians(joints, table),
    )


def _error(path: Path, line: int, message: str) -> MotionFormatError:
    return MotionFormatError(f"{path}, line {line + 1}: {message}")


def _lines(path: Path) -> list[str]:
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise MotionFormatError(f"{path}: cannot be read ({error.strerror})") from error
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise MotionFormatError(f"{path}: the file is empty")
    return lines


def _hierarchy(path: Path, lines: list[str]) -> tuple[list[Joint], int]:
    """Joints in the order of the file, and the index of the line after `MOTION`."""
    joints: list[Joint] = []
    names: set[str] = set()
    stack: list[int] = []
    pending: Joint | None = None
    column = 0
    for number, line in enumerate(lines):
        words = line.split()
        if not words:
            continue
        keyword = words[0].upper()
        if number == 0 and keyword != "HIERARCHY":
            raise _error(path, number, f"not a BVH file: found {words[0][:40]!r}, expected HIERARCHY")
        if keyword in ("ROOT", "JOINT", "END"):
            parent = stack[-1] if stack else -1
            if keyword == "END":
                name = joints[parent].name + END
            elif len(words) < 2:
                raise _error(path, number, f"{keyword} has no name")
            else:
                # Some exporters prepend a namespace, or put spaces into names.
                name = " ".join(words[1:]).rsplit(":", 1)[-1]
            if keyword == "ROOT" and joints:
                raise _error(path, number, f"a second ROOT {name!r}; expected one skeleton per file")
            if name in names:
                raise _error(path, number, f"a second joint named {name!r}")
            names.add(name)
            pending = Joint(name, parent)
        elif keyword == "{":
            if pending is None:
                raise _error(path, number, "'{' without a joint before it")
            stack.append(len(joints))
            joints.append(pending)
            pending = None
        elif keyword == "}":
            if not stack:
                raise _error(path, number, "'}' without a '{'")
            stack.pop()
        elif keyword == "OFFSET" and stack:
            x, y, z = _floats(path, number, words[1:], 3)
            joints[stack[-1]].offset = (x, y, z)
        elif keyword == "CHANNELS" and stack:
            joints[stack[-1]].channels = _channels(path, number, words[1:])
            joints[stack[-1]].column = column
            column += len(words) - 2
        elif keyword == "MOTION":
            if stack:
                raise _error(path, number, f"MOTION inside joint {joints[stack[-1]].name!r}: a '}}' is missing")
            if not joints:
                raise _error(path, number, "MOTION before any joint")
            return joints, number + 1
        elif keyword != "HIERARCHY":
            raise _error(path, number, f"unknown keyword {words[0][:40]!r}")
    raise MotionFormatError(f"{path}: ends before MOTION (truncated?)")


def _floats(path: Path, number: int, words: list[str], count: int) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise _error(path, number, f"{error}") from error
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise _error(path, number, f"found {' '.join(words)[:60]!r}, expected {count} finite numbers")
    return values


def _channels(path: Path, number: int, words: list[str]) -> list[str]:
    known = {channel.lower(): channel for channel in CHANNELS}
    channels = [known.get(word.lower(), word) for word in words[1:]]
    for channel in channels:
        if channel not in CHANNELS:
            raise _error(path, number, f"unknown channel {channel!r}; valid: {', '.join(CHANNELS)}")
    if not words or words[0] != str(len(channels)) or len(set(channels)) != len(channels):
        raise _error(path, number, "CHANNELS: expected their number, then as many different channels")
    if sum(channel.endswith("rotation") for channel in channels) not in (0, 3):
        raise _error(path, number, "expected three rotation channels of a joint, or none")
    return channels


def _motion(path: Path, lines: list[str], start: int, joints: list[Joint]) -> tuple[float, Float]:
    """Frames per second and the table of channel values, (T, C)."""
    header: dict[str, float] = {}
    number = start
    for key in ("frames", "frame time"):
        while number < len(lines) and not lines[number].strip():
            number += 1
        if number >= len(lines):
            raise MotionFormatError(f"{path}: ends before '{key.title()}:' (truncated?)")
        name, _, value = lines[number].partition(":")
        if " ".join(name.lower().split()) != key:
            raise _error(path, number, f"found {lines[number].strip()[:40]!r}, expected '{key.title()}: NUMBER'")
        (header[key],) = _floats(path, number, value.split(), 1)
        if header[key] <= 0:
            raise _error(path, number, f"'{key.title()}' is {header[key]:g}, expected a positive number")
        number += 1

    rows = [(at, line.split()) for at, line in enumerate(lines[number:], number) if line.strip()]
    width = sum(len(joint.channels) for joint in joints)
    for at, row in rows:
        if len(row) != width:
            raise _error(path, at, f"{len(row)} values, expected {width} (truncated?)")
    if len(rows) != header["frames"]:
        raise MotionFormatError(f"{path}: {len(rows)} frames, but 'Frames' says {header['frames']:g} (truncated?)")
    try:
        table = np.array([row for _, row in rows], dtype=np.float64)
    except ValueError:
        # Each line is parsed on its own only to name the wrong one.
        for at, row in rows:
            _floats(path, at, row, width)
        raise
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        frame, column = bad[0]
        owner = next(joint for joint in joints if joint.column <= column < joint.column + len(joint.channels))
        channel = owner.channels[column - owner.column]
        raise _error(path, rows[frame][0], f"{channel} of joint {owner.name!r} is {table[frame, column]}")
    return 1.0 / header["frame time"], table


def _forward(joints: list[Joint], table: Float) -> tuple[Float, Float]:
    frames = len(table)
    positions, rotations = np.empty((frames, len(joints), 3)), np.empty((frames, len(joints), 3, 3))
    local = _local_rotations(joints, table)
    for index, joint in enumerate(joints):
        offset = np.tile(joint.offset, (frames, 1))
        for at, channel in enumerate(joint.channels):
            if channel.endswith("position"):
                offset[:, "XYZ".index(channel[0])] = table[:, joint.column + at]
        if joint.parent < 0:
            positions[:, index], rotations[:, index] = offset, local.get(index, np.eye(3))
            continue
        above = rotations[:, joint.parent]
        positions[:, index] = positions[:, joint.parent] + np.einsum("tij,tj->ti", above, offset)
        rotations[:, index] = above @ local[index] if index in local else above
    return positions, rotations


def _local_rotations(joints: list[Joint], table: Float) -> dict[int, Float]:
    """Rotation matrices (T, 3, 3) of every joint with rotation channels, converted once per channel order."""
    groups: dict[str, list[tuple[int, list[int]]]] = {}
    for index, joint in enumerate(joints):
        columns = [joint.column + at for at, c in enumerate(joint.channels) if c.endswith("rotation")]
        if columns:
            order = "".join(c[0] for c in joint.channels if c.endswith("rotation"))
            groups.setdefault(order, []).append((index, columns))
    local: dict[int, Float] = {}
    for order, members in groups.items():
        angles = table[:, [columns for _, columns in members]].reshape(-1, 3)
        matrices = Rotation.from_euler(order, angles, degrees=True).as_matrix().reshape(len(table), -1, 3, 3)
        local.update({index: matrices[:, at] for at, (index, _) in enumerate(members)})
    return local


def _in_radians(joints: list[Joint], table: Float) -> tuple[str, ...]:
    """A warning where every rotation is so small that it is of a statue, or in radians."""
    named = [
        (joint.column + at, f"{channel} of joint {joint.name!r}")
        for joint in joints
        for at, channel in enumerate(joint.channels)
        if channel.endswith("rotation")
    ]
    if not named:
        return ()
    angles = table[:, [column for column, _ in named]]
    greatest = np.abs(angles).max(axis=0)
    if greatest.max() > HALF_TURN or np.ptp(angles, axis=0).max() < MOVING:
        return ()
    channel = named[int(np.argmax(greatest))][1]
    return (f"no rotation is beyond ±{greatest.max():.3g} ({channel}), expected degrees: are they in radians?",)


def _zero_positions(joints: list[Joint]) -> Float:
    positions = np.zeros((len(joints), 3))
    for index, joint in enumerate(joints[1:], 1):
        positions[index] = positions[joint.parent] + joint.offset
    return positions
