"""Copies of a robot's folder with other numbers in its file."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.yaml_numbers import Place, with_numbers

NAME = "robot.yaml"
"""Name of a copy's robot file: its folder may have any name."""


@contextmanager
def variant(file: Path, values: Mapping[Place, float]) -> Iterator[Robot]:
    """Context with a robot whose file has other numbers; its folder is temporary, with links to all other files.

    Args:
        file: the robot file.
        values: new numbers by place.

    Raises:
        ConfigError: with these numbers it is no valid robot file.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        for path in file.parent.iterdir():
            if path != file and path.name != NAME:
                (folder / path.name).symlink_to(path.absolute())
        _write(file, values, folder)
        yield load_robot(folder)


def write_variant(file: Path, values: Mapping[Place, float], folder: Path) -> Robot:
    """Write a complete copy of a robot's folder with other numbers in its file, in place of one that is there.

    Comments and layout of the robot file are kept; its name becomes `robot.yaml`.

    Raises:
        ConfigError: with these numbers it is no valid robot file, or the folder cannot be written.
    """
    unfinished = folder.with_name(f"{folder.name}.unfinished")
    try:
        shutil.rmtree(unfinished, ignore_errors=True)
        shutil.copytree(file.parent, unfinished, ignore=shutil.ignore_patterns(file.name, NAME, "__pycache__"))
        _write(file, values, unfinished)
        load_robot(unfinished)
        shutil.rmtree(folder, ignore_errors=True)
        os.replace(unfinished, folder)
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be written: {error.strerror or error}") from error
    return load_robot(folder)


def _write(file: Path, values: Mapping[Place, float], folder: Path) -> None:
    text = with_numbers(file.read_text(encoding="utf-8"), values, file)
    (folder / NAME).write_text(text, encoding="utf-8")
