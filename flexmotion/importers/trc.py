"""Reader of TRC files: trajectories of named markers or joint centres, tab-separated.

A mapping turns markers into joint centres; `A + B` is the mean of two markers, such as the two sides of a knee.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from flexmotion.configs.errors import MotionFormatError
from flexmotion.importers.capture import Capture
from flexmotion.importers.landmarks import METRES

Float = NDArray[np.float64]

GAP_S = 0.25
"""Longest gap of a marker that is interpolated [s]."""

UNITS = {"m": 1.0, "cm": METRES["cm"], "mm": METRES["mm"], "meters": 1.0, "millimeters": METRES["mm"]}


def read_trc(path: Path) -> Capture:
    """Positions of every marker in metres; gaps up to `GAP_S` are interpolated by a cubic spline.

    Raises:
        MotionFormatError: not a TRC file, or a marker is missing for longer; names the line or marker.
    """
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise MotionFormatError(f"{path}: cannot be read ({error.strerror})") from error
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise MotionFormatError(f"{path}: not a TRC file: line 1 does not begin with PathFileType")
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    try:
        fps, scale = float(header["DataRate"]), UNITS[header["Units"].lower()]
        count, frames = int(header["NumMarkers"]), int(header["NumFrames"])
    except (KeyError, ValueError) as error:
        raise MotionFormatError(f"{path}, line 3: {error} missing or invalid in the header") from error
    if not fps > 0:
        raise MotionFormatError(f"{path}, line 3: DataRate is {fps}, expected a positive number")
    names = tuple(name.strip() for name in lines[3].split("\t")[2:] if name.strip())
    if len(names) != count or len(set(names)) != count:
        raise MotionFormatError(f"{path}, line 4: {len(set(names))} different markers, NumMarkers says {count}")
    rows = [_row(path, number, line, count) for number, line in enumerate(lines[5:], 6) if line.strip()]
    if len(rows) != frames:
        raise MotionFormatError(f"{path}: {len(rows)} frames, NumFrames says {frames} (truncated?)")
    positions = np.array(rows).reshape(frames, count, 3)
    for marker, name in enumerate(names):
        _bridge(path, name, positions[:, marker], fps)
    return Capture(str(path), fps, names, scale * positions)


def _row(path: Path, number: int, line: str, count: int) -> list[float]:
    """Coordinates in one line, NaN where a field is empty."""
    fields = line.rstrip("\r\n").split("\t")[2 : 2 + 3 * count]
    fields += [""] * (3 * count - len(fields))
    try:
        return [float(field) if field.strip() else np.nan for field in fields]
    except ValueError as error:
        raise MotionFormatError(f"{path}, line {number}: {error}") from error


def _bridge(path: Path, name: str, track: Float, fps: float) -> None:
    """Fill the gaps of one marker in place."""
    seen = np.isfinite(track).all(axis=1)
    if seen.all():
        return
    known = np.flatnonzero(seen)
    gap = max(np.diff(np.concatenate([[-1], known, [len(track)]])) - 1) if len(known) else len(track)
    if gap > GAP_S * fps or len(known) < 4:
        raise MotionFormatError(f"{path}: marker {name!r} is missing for {gap / fps:.2f} s, at most {GAP_S} s allowed")
    track[~seen] = CubicSpline(known, track[known])(np.flatnonzero(~seen))
