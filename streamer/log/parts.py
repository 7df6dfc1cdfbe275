"""The parts of a log: a long run goes on in a new file, and the oldest files but the first are removed.

`run.mcap` is the first part, `run.part0002.mcap` the next one. Each is a log of its own, with header and attachments.
"""

from __future__ import annotations

import re
from pathlib import Path

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.stream import LogParts

_NUMBER = re.compile(r"\.part(\d{4,})$")


def part_path(first: Path, number: int) -> Path:
    """Path of a part, numbered from 1."""
    return first if number == 1 else first.with_name(f"{first.stem}.part{number:04d}{first.suffix}")


def part_number(path: Path) -> int:
    """Number of a part, by its name."""
    found = _NUMBER.search(path.stem)
    return int(found[1]) if found else 1


def later_parts(first: Path) -> list[Path]:
    """The files that are named as later parts of a log, in order; none of a file that is a later part itself."""
    if part_number(first) > 1 or not first.parent.is_dir():
        return []
    named = re.compile(re.escape(first.stem) + r"\.part\d{4,}" + re.escape(first.suffix))
    found = (path for path in first.parent.iterdir() if named.fullmatch(path.name) and path.is_file())
    return sorted(found, key=part_number)


def refuse_existing(first: Path | None, option: str = "--log") -> None:
    """Raise `ConfigError` where a log would replace another one, or the later parts of one; None: no log."""
    if first is None or first.suffix != ".mcap" or first.is_dir():
        return  # a folder, or a name that is refused as such
    there = [path for path in (first, *later_parts(first)) if path.is_file() and path.stat().st_size]
    if there:
        more = f" and {len(there) - 1} more of its parts" if len(there) > 1 else ""
        raise ConfigError(
            f"{option}: {there[0]}{more}: there is a log already, which would be lost; choose another name, give a "
            "folder, in which each run gets a file of its own, or remove it first"
        )


class Rotation:
    """Decides when a log goes on in a new part, and which parts are removed.

    Args:
        first: path of the first part.
        limits: of a part, and of all of them.

    Attributes:
        number: of the part that is being written.
    """

    def __init__(self, first: Path, limits: LogParts) -> None:
        self.first, self.limits, self.number = first, limits, 1

    def due(self, size_bytes: int, seconds: float) -> bool:
        """Whether the part, with that size and of that age, is complete."""
        return size_bytes >= self.limits.part_mb * 1e6 or seconds >= self.limits.part_s

    @property
    def next(self) -> Path:
        """Path of the next part."""
        return part_path(self.first, self.number + 1)

    def advance(self) -> list[Path]:
        """Go on to the next part; returns what must be removed: the oldest parts.

        The first one stays: it is locked, and a replay needs it.
        """
        self.number += 1
        parts = [path for path in (self.first, *later_parts(self.first)) if path.exists()]
        sizes = {path: path.stat().st_size for path in parts}
        # The part that is begun grows up to its limit.
        spare = self.limits.keep_mb * 1e6 - self.limits.part_mb * 1e6 - sum(sizes.values())
        removed = []
        for path in parts[1:-1]:
            if spare >= 0:
                break
            removed.append(path)
            spare += sizes[path]
        return removed
