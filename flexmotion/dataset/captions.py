"""Captions: sentences about intervals of a clip."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from flexmotion.configs.errors import MotionFormatError

COLUMNS = ("trial", "start_s", "end_s", "caption", "source")


@dataclass(frozen=True)
class Caption:
    """Sentence about a clip from `start` to `end` [s], and its source; an end of 0 is that of the clip."""

    start: float
    end: float
    text: str
    source: str = ""


def read_captions(path: Path) -> dict[str, list[Caption]]:
    """Captions of every clip in a table with the columns trial, start_s, end_s, caption, source.

    Raises:
        MotionFormatError: the file cannot be read or a row is invalid; names the line.
    """
    captions: dict[str, list[Caption]] = {}
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            missing = [column for column in COLUMNS if column not in (reader.fieldnames or ())]
            if missing:
                raise MotionFormatError(f"{path}: lacks column {', '.join(missing)}")
            for number, row in enumerate(reader, 2):
                captions.setdefault(row["trial"], []).append(_caption(path, number, row))
    except OSError as error:
        raise MotionFormatError(f"{path}: cannot be read ({error.strerror})") from error
    return captions


def _caption(path: Path, number: int, row: dict[str, str]) -> Caption:
    try:
        start, end = float(row["start_s"]), float(row["end_s"])
    except ValueError as error:
        raise MotionFormatError(f"{path}, line {number}: {error}") from error
    if not 0 <= start <= end:
        raise MotionFormatError(f"{path}, line {number}: from {start} to {end} s, expected 0 <= start <= end")
    return Caption(start, end, row["caption"], row["source"])
