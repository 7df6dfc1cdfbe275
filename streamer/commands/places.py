"""Checks of the files that a command is to write, before it reads or computes anything."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import typer


def check_place(path: Path | None, suffixes: Sequence[str] = ()) -> None:
    """Check that a file can be written.

    Args:
        path: of the file; None if none is asked for.
        suffixes: of the formats that can be written; empty for any.

    Raises:
        typer.BadParameter: it is a folder, its folder does not exist or cannot be written, or its suffix is another.
    """
    if path is None:
        return
    if path.is_dir():
        raise typer.BadParameter(f"{path}: a folder, expected a file")
    if suffixes and path.suffix.lower() not in suffixes:
        raise typer.BadParameter(f"{path}: unknown kind of file, expected {' or '.join(suffixes)}")
    if not path.parent.is_dir():
        raise typer.BadParameter(f"{path.parent}: no such folder to write {path.name} into")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise typer.BadParameter(f"{path}: cannot be written (permission denied)")
