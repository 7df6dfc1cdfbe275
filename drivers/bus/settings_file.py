"""Files with the settings of a robot's servos as they were before they were configured."""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import yaml

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import Strict, load
from flexmotion.drivers.bus.inspection import Inspection


class ServoSettings(Strict):
    """Settings of the servo of one joint, valid for this model and id."""

    id: int
    servo: str
    settings: dict[str, int]


class SettingsFile(Strict):
    """Settings of servos by joint, the robot's name, and the date on which they were read (ISO 8601)."""

    robot: str
    date: str
    joints: dict[str, ServoSettings]


def default_file(robot: str) -> Path:
    """A new name in the current folder: `ROBOT-servos-DATE.yaml`."""
    return Path(f"{robot}-servos-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.yaml")


def write_settings(file: Path, robot: str, inspections: Sequence[Inspection]) -> None:
    """Write what servos hold to a new file: all of it, or no file.

    Raises:
        ConfigError: the file exists or cannot be written.
    """
    joints = {each.joint: ServoSettings(id=each.id, servo=each.servo, settings=each.held) for each in inspections}
    content = SettingsFile(robot=robot, date=datetime.now(UTC).isoformat(timespec="seconds"), joints=joints)
    text = yaml.safe_dump(content.model_dump(), sort_keys=False)
    try:
        with file.open("x", encoding="utf-8") as stream:
            try:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
            except BaseException:  # also Ctrl-C: a part of a file would be taken for the old values
                file.unlink(missing_ok=True)
                raise
    except OSError as error:
        raise ConfigError(f"{file}: cannot be written: {error.strerror}; nothing was changed") from error


def read_settings(file: Path, robot: str) -> SettingsFile:
    """A file of `write_settings`. Raises `ConfigError` if it is malformed or of another robot."""
    content = load(SettingsFile, file)
    if content.robot != robot:
        raise ConfigError(f"{file}: field robot: {content.robot!r}, expected {robot!r}")
    return content
