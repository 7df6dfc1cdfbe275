"""Reader of Acclaim motion: a skeleton (ASF) and its motion (AMC).

A bone rotates by C R C⁻¹ relative to its parent: C is its `axis`, R the rotation of the motion, both about the fixed
axes x, y, z in that order. A point is the start of a bone. Lengths are in units of `length` of an inch.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import MotionFormatError
from flexmotion.importers.capture import Capture

Float = NDArray[np.float64]

FPS = 120.0
"""Frame rate of the CMU database [1/s]; AMC files do not contain it."""

ROTATIONS = ("rx", "ry", "rz")
ROOT = "root"


@dataclass
class Bone:
    """A bone of the skeleton: unit direction and length at zero pose, axis frame, and the motion's channels."""

    name: str
    direction: Float = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0
    axis: Rotation = field(default_factory=Rotation.identity)
    channels: list[str] = field(default_factory=list)


@dataclass
class Skeleton:
    """Content of an ASF file; parents come before their children."""

    bones: dict[str, Bone]
    parents: dict[str, str]
    scale: float
    degrees: bool


def read_acclaim(path: Path) -> Capture:
    """Motion of an AMC file on the skeleton beside it.

    The skeleton is `NAME.asf`, `SUBJECT.asf` for `SUBJECT_TRIAL.amc`, or the only ASF file of the folder.

    Raises:
        MotionFormatError: a file cannot be read, or there is no skeleton; names the line and the error.
    """
    skeleton_path = find_skeleton(path)
    if skeleton_path is None:
        expected = " or ".join(candidate.name for candidate in _skeleton_names(path))
        raise MotionFormatError(f"{path}: no skeleton beside it, expected {expected}")
    skeleton = read_asf(skeleton_path)
    table, degrees = _read_amc(path, skeleton)
    frames = len(next(iter(table.values())))
    bones, order = skeleton.bones, list(skeleton.bones)
    positions, rotations = np.empty((frames, len(order), 3)), np.empty((frames, len(order), 3, 3))
    zero = np.zeros((len(order), 3))
    for index, name in enumerate(order):
        bone = bones[name]
        values = table.get(name, np.zeros((frames, len(bone.channels))))
        euler = np.zeros((frames, 3))
        for column, channel in enumerate(bone.channels):
            if channel in ROTATIONS:
                euler[:, ROTATIONS.index(channel)] = values[:, column]
        turn = (bone.axis * Rotation.from_euler("xyz", euler, degrees=degrees) * bone.axis.inv()).as_matrix()
        if name == ROOT:
            place = [bone.channels.index(channel) for channel in ("tx", "ty", "tz")]
            positions[:, index], rotations[:, index] = values[:, place], turn
            continue
        above = order.index(skeleton.parents[name])
        reach = bones[order[above]].direction * bones[order[above]].length
        positions[:, index] = positions[:, above] + rotations[:, above] @ reach
        rotations[:, index] = rotations[:, above] @ turn
        zero[index] = zero[above] + reach
    parents = tuple(order.index(skeleton.parents[name]) if name != ROOT else -1 for name in order)
    scale = skeleton.scale
    return Capture(str(path), FPS, tuple(order), scale * positions, rotations, parents, scale * zero)


def find_skeleton(path: Path) -> Path | None:
    """The skeleton of an AMC file (see `read_acclaim`), if there is one."""
    found = next((candidate for candidate in _skeleton_names(path) if candidate.is_file()), None)
    others = sorted(path.parent.glob("*.asf"))
    return found or (others[0] if len(others) == 1 else None)


def _skeleton_names(path: Path) -> tuple[Path, Path]:
    return path.with_suffix(".asf"), path.with_name(path.stem.partition("_")[0] + ".asf")


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Line number and words of every line with words; comments are skipped."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise MotionFormatError(f"{path}: cannot be read ({error.strerror})") from error
    rows = ((number, line.partition("#")[0].split()) for number, line in enumerate(text.splitlines(), 1))
    return [(number, words) for number, words in rows if words]


def _error(path: Path, number: int, message: str) -> MotionFormatError:
    return MotionFormatError(f"{path}, line {number}: {message}")


def _floats(path: Path, number: int, words: list[str]) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise _error(path, number, f"found {' '.join(words)[:60]!r}, expected numbers") from error
    if not np.isfinite(values).all():
        raise _error(path, number, f"found {' '.join(words)[:60]!r}, expected finite numbers")
    return values


def read_asf(path: Path) -> Skeleton:
    """The skeleton in an ASF file. Raises `MotionFormatError`."""
    root = Bone(ROOT, channels=[])
    skeleton = Skeleton({ROOT: root}, {}, 1.0, True)
    section, bone = "", root
    for number, words in _lines(path):
        if words[0].startswith(":"):
            section = words[0][1:].lower()
            continue
        key, rest = words[0].lower(), words[1:]
        if section == "units" and key == "length":
            skeleton.scale = 1.0 / _floats(path, number, rest[:1])[0]
        elif section == "units" and key == "angle":
            skeleton.degrees = rest[:1] != ["rad"]
        elif section == "root" and key == "order":
            root.channels = [word.lower() for word in rest]
        elif section == "root" and key == "orientation":
            root.axis = Rotation.from_euler("xyz", _floats(path, number, rest[:3]), degrees=skeleton.degrees)
        elif section == "bonedata":
            if key == "begin":
                bone = Bone("")
            elif key == "name" and rest:
                bone.name = rest[0]
                skeleton.bones[bone.name] = bone
            elif key == "direction":
                bone.direction = np.array(_floats(path, number, rest[:3]))
            elif key == "length":
                bone.length = _floats(path, number, rest[:1])[0]
            elif key == "axis":
                order = rest[3].lower() if len(rest) > 3 else "xyz"
                bone.axis = Rotation.from_euler(order, _floats(path, number, rest[:3]), degrees=skeleton.degrees)
            elif key == "dof":
                bone.channels = [word.lower() for word in rest]
        elif section == "hierarchy" and key not in ("begin", "end"):
            for name in (words[0], *rest):
                if name not in skeleton.bones:
                    raise _error(path, number, f"unknown bone {name!r}")
            skeleton.parents.update(dict.fromkeys(rest, words[0]))
    if not skeleton.parents or not root.channels:
        raise MotionFormatError(f"{path}: not an ASF skeleton: no :hierarchy or no :root order")
    ordered = [ROOT]
    for name in ordered:
        children = [child for child, parent in skeleton.parents.items() if parent == name]
        if ROOT in children or len(ordered) > len(skeleton.bones):
            raise MotionFormatError(f"{path}: the :hierarchy has a cycle at {name!r}")
        ordered += children
    skeleton.bones = {name: skeleton.bones[name] for name in ordered}
    return skeleton


def _read_amc(path: Path, skeleton: Skeleton) -> tuple[dict[str, Float], bool]:
    """Channel values of every bone, (T, C), and whether angles are in degrees."""
    degrees, frames = skeleton.degrees, 0
    table: dict[str, list[list[float]]] = {}
    for number, words in _lines(path):
        if words[0].startswith(":"):
            degrees = {":degrees": True, ":radians": False}.get(words[0].lower(), degrees)
            continue
        if len(words) == 1 and words[0].isdigit():
            _check_frame(path, number, table, frames)
            frames += 1
            continue
        bone = skeleton.bones.get(words[0])
        if bone is None:
            raise _error(path, number, f"bone {words[0]!r} is not in the skeleton")
        if not frames:
            raise _error(path, number, "values before the first frame's number")
        if len(words) - 1 != len(bone.channels):
            raise _error(path, number, f"{len(words) - 1} values for {bone.name!r}, expected {len(bone.channels)}")
        table.setdefault(bone.name, []).append(_floats(path, number, words[1:]))
    if not frames:
        raise MotionFormatError(f"{path}: no frames, not an AMC file?")
    _check_frame(path, len(_lines(path)), table, frames)
    if ROOT not in table:
        raise MotionFormatError(f"{path}: no values for {ROOT!r}")
    return {name: np.array(rows) for name, rows in table.items()}, degrees


def _check_frame(path: Path, number: int, table: dict[str, list[list[float]]], frames: int) -> None:
    short = next((name for name, rows in table.items() if len(rows) != frames), None)
    if short:
        raise _error(path, number, f"frame {frames} has no values for {short!r}, or has them twice (truncated?)")
