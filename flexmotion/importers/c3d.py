"""Reader of C3D files: trajectories of markers, as optical systems write them; needs the extra `c3d` (ezc3d)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexmotion.configs.errors import ConfigError, MotionFormatError
from flexmotion.importers.capture import Capture
from flexmotion.importers.marker_names import unique_names
from flexmotion.importers.units import METRES, UNITS


def read_c3d(path: Path) -> Capture:
    """Positions of every point in metres, NaN where a point is missing (negative residual, or three zeros).

    Force plates and other analog channels are not read.

    Raises:
        MotionFormatError: not a C3D file, or one without points; says what is missing.
        ConfigError: the package `ezc3d` is not installed.
    """
    if not path.is_file():
        raise MotionFormatError(f"{path}: cannot be read (no such file)")
    try:
        import ezc3d
    except ImportError as error:
        raise ConfigError(f"{path}: C3D files need the extra 'c3d': in a clone, pip install '.[c3d]'") from error
    try:
        content = ezc3d.c3d(str(path))
    except (OSError, RuntimeError, ValueError, IndexError) as error:
        raise MotionFormatError(f"{path}: not a C3D file, or a damaged one ({error})") from error
    group: dict[str, Any] = content["parameters"].get("POINT", {})
    points = np.asarray(content["data"]["points"], np.float64)
    labels = [str(name).strip() for key in _label_groups(group) for name in group[key]["value"]]
    count, frames = points.shape[1:]
    if not count or not frames:
        raise MotionFormatError(f"{path}: no points, only analog channels?")
    labels += ["" for _ in range(count - len(labels))]
    fps = float(_value(group, "RATE", 0.0) or content["header"]["points"]["frame_rate"])
    if not fps > 0:
        raise MotionFormatError(f"{path}: POINT:RATE is {fps:g}, expected a positive number")
    unit = str(_value(group, "UNITS", "mm")).strip().lower() or "mm"
    if unit not in UNITS:
        raise MotionFormatError(f"{path}: POINT:UNITS is {unit!r}, expected one of {', '.join(METRES)}")
    positions = METRES[UNITS[unit]] * np.ascontiguousarray(points[:3].transpose(2, 1, 0))
    residuals = np.asarray(content["data"]["meta_points"]["residuals"], np.float64)[0].T
    missing = (residuals < 0) | (positions == 0.0).all(axis=-1) | ~np.isfinite(positions).all(axis=-1)
    positions[missing] = np.nan
    names, positions, notes = unique_names(labels[:count], positions)
    start = float(content["header"]["points"]["first_frame"]) / fps
    return Capture(str(path), fps, names, positions, start=start, warnings=tuple(notes), units=UNITS[unit])


def _label_groups(group: dict[str, Any]) -> list[str]:
    """Parameters with the names of points: LABELS has 255 of them, LABELS2 the next."""
    return sorted((key for key in group if key.startswith("LABELS")), key=lambda key: int(key[6:] or 1))


def _value(group: dict[str, Any], name: str, default: float | str) -> float | str:
    values = group.get(name, {}).get("value", ())
    return values[0] if len(values) else default
