"""Where a run is logged to."""

from __future__ import annotations

import itertools
import time
from pathlib import Path

import typer

LOG_NAME, SUFFIX = "run.mcap", ".mcap"


def log_file(log: Path | None, report: Path | None) -> Path | None:
    """The file to log to: `log`, or a new file in it if it is a folder; else one beside the report; else None.

    A folder that does not exist is made, in one that does: a name that is written wrong makes no tree of folders.

    Raises:
        typer.BadParameter: `log` is neither a folder, nor one that can be made, nor a file name that ends in `SUFFIX`.
    """
    if log is not None:
        if not log.suffix and not log.exists():
            _make(log)
        if log.is_dir():
            return _new(log, time.strftime("%Y%m%d-%H%M%S"))
        if log.suffix != SUFFIX:
            raise typer.BadParameter(f"--log: {log}: expected a folder or a file that ends in {SUFFIX}")
        return log
    if report is None:
        return None
    report.mkdir(parents=True, exist_ok=True)
    return report / LOG_NAME


def _make(folder: Path) -> None:
    if not folder.parent.is_dir():
        raise typer.BadParameter(f"--log: {folder}: there is no folder {folder.parent} to make it in")
    try:
        folder.mkdir()
    except OSError as error:
        raise typer.BadParameter(f"--log: {folder}: the folder cannot be made: {error.strerror}") from None


def _new(folder: Path, stem: str) -> Path:
    """A file of a folder that does not exist yet: two runs may begin within a second."""
    names = (stem + ("" if number == 1 else f"-{number}") + SUFFIX for number in itertools.count(1))
    return next(path for path in map(folder.joinpath, names) if not path.exists())
