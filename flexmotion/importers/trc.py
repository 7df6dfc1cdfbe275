"""Reader of TRC files: trajectories of named markers or joint centres, tab-separated.

A mapping turns markers into joint centres; `A + B` is the mean of two markers, such as the two sides of a knee.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import MotionFormatError
from flexmotion.importers.capture import Capture
from flexmotion.importers.marker_names import unique_names
from flexmotion.importers.trc_times import frame_numbers
from flexmotion.importers.units import METRES, UNITS

Float = NDArray[np.float64]


def read_trc(path: Path) -> Capture:
    """Positions of every marker in metres, NaN where a marker is missing: an empty field, `nan`, or three zeros.

    Raises:
        MotionFormatError: not a TRC file, or its times are not those of its frames; names the line and what was
            expected.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise MotionFormatError(f"{path}: cannot be read ({error.strerror})") from error
    if len(lines) < 6 or not lines[0].lstrip().startswith("PathFileType"):
        raise MotionFormatError(f"{path}: not a TRC file: line 1 does not begin with PathFileType")
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    try:
        fps, unit = float(header["DataRate"].replace(",", ".")), UNITS[header["Units"].lower()]
        count, frames = int(header["NumMarkers"]), int(header["NumFrames"])
    except (KeyError, ValueError) as error:
        raise MotionFormatError(f"{path}, line 3: {error} missing or invalid in the header") from error
    if not fps > 0:
        raise MotionFormatError(f"{path}, line 3: DataRate is {fps}, expected a positive number")
    labels = _labels(lines[3])
    if not labels:
        raise MotionFormatError(f"{path}, line 4: no names of markers")
    numbered = [(number, line) for number, line in enumerate(lines[5:], 6) if line.strip()]
    if not numbered:
        raise MotionFormatError(f"{path}: no frames")
    rows = np.array([_row(path, number, line, len(labels)) for number, line in numbered])
    at, late = frame_numbers(str(path), rows[:, 0], [number for number, _ in numbered], fps)
    # Frames that are left out are gaps of all markers.
    table = np.full((at[-1] + 1, rows.shape[1]), np.nan)
    table[at] = rows
    positions = METRES[unit] * table[:, 1:].reshape(len(table), len(labels), 3)
    positions[(positions == 0.0).all(axis=-1) | ~np.isfinite(positions).all(axis=-1)] = np.nan
    names, positions, notes = unique_names(labels, positions)
    notes += late
    if len(labels) != count:
        notes.append(f"{len(labels)} names of markers, NumMarkers says {count}")
    if len(rows) != frames:
        notes.append(f"{len(rows)} frames, NumFrames says {frames}: the file may be cut off")
    start = float(table[0, 0]) if np.isfinite(table[0, 0]) else 0.0
    return Capture(str(path), fps, names, positions, start=start, warnings=tuple(notes), units=unit)


def _split(line: str) -> list[str]:
    line = line.rstrip("\r\n")
    return line.split("\t") if "\t" in line else line.split()


def _labels(line: str) -> list[str]:
    """Names of the columns of three; they are above the first of the three, or one after the other."""
    fields = [field.strip() for field in _split(line)[2:]]
    while fields and not fields[-1]:
        fields.pop()
    apart = all(not field for index, field in enumerate(fields) if index % 3)
    return fields[::3] if apart else [field for field in fields if field]


def _row(path: Path, number: int, line: str, count: int) -> list[float]:
    """Time and coordinates in one line, NaN where a field is empty."""
    fields = _split(line)[1 : 2 + 3 * count]
    fields += [""] * (1 + 3 * count - len(fields))
    try:
        return [float(field) if field.strip() else np.nan for field in fields]
    except ValueError as error:
        comma = next((field for field in fields if "," in field), None)
        if comma is not None:
            raise MotionFormatError(
                f"{path}, line {number}: {comma!r} has a decimal comma, expected a point"
            ) from error
        raise MotionFormatError(f"{path}, line {number}: {error}") from error
