"""`LogHeader`: properties of a run, known at its start, with which its log is read, judged and replayed."""

from __future__ import annotations

import json
import shutil
import tempfile
import time
import weakref
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from flexmotion.configs import calibration, get_up, identification, push_correction, repertoire
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.schema import Strict, parse
from flexmotion.configs.stream import StreamSettings
from flexmotion.configs.versions import FormatVersions

_NAME = "flexmotion.log/"
_ROBOT = "robot/"
"""Begin of the attachments' names that are files of the robot."""
LOG_VERSIONS = FormatVersions(kind="log", oldest=1, newest=1, migration="open it with {writer}", field="flexmotion.log")
"""Versions that are read, the newest is written; `docs/log.md` lists what changed."""
SCHEMA = f"{_NAME}{LOG_VERSIONS.newest}"
"""Name of the metadata record that holds the header."""


def is_header(name: str) -> bool:
    """Whether a metadata record of that name is the header of a log, of any version."""
    return name.startswith(_NAME)


def require_version(name: str, metadata: Mapping[str, str], origin: Path) -> None:
    """Check that this program reads logs whose header has that name.

    Raises:
        ConfigError: the log is too old or too new; the message says what to do.
    """
    number = name.removeprefix(_NAME)
    found = int(number) if number.isdecimal() else number
    software = metadata.get("software")
    if software is None:
        LOG_VERSIONS.check(found, origin)
    else:
        LOG_VERSIONS.check(found, origin, f"flexmotion {json.loads(software)}")


class LogHeader(Strict):
    """Properties of a run that are known at its start.

    Attributes:
        software: version of FlexMotion that wrote the log.
        robot: name of a shipped robot, or folder.
        joints: joint names, in the order of all columns.
        driver, driver_options: name of the driver and its options without the seed.
        clock: clock of the loop.
        source, source_parts: name of the source, and its parts to rebuild it from the attachments
            (`flexmotion.streamer.log.source`).
        seconds: longest that the source is streamed [s].
        allow_refused: the run is ok although something that was asked was refused.
        min_likeness: the run is not ok below this likeness; None: not judged.
        armed, attended, stay: see `flexmotion.streamer.run.parts.RunParts`; `stay` None: of an older version, unknown.
        start_ns: when the log was begun, nanoseconds since the epoch.
        wall_minus_perf_ns: offset from `perf_counter_ns` to the wall clock, measured once.
    """

    software: str
    robot: str
    joints: tuple[str, ...]
    rate_hz: float
    driver: str
    driver_options: dict[str, Any] = Field(default_factory=dict)
    seed: int = 0
    clock: Literal["real", "lockstep"]
    source: str
    source_parts: dict[str, Any] = Field(default_factory=dict)
    seconds: float | None = None
    feedback: bool = True
    allow_refused: bool = False
    min_likeness: float | None = None
    armed: bool = True
    attended: bool = False
    stay: bool | None = None
    settings: StreamSettings
    start_ns: int
    wall_minus_perf_ns: int

    def metadata(self) -> dict[str, str]:
        """The header as MCAP metadata: a JSON text for each field."""
        return {name: json.dumps(value) for name, value in self.model_dump(mode="json").items()}

    @classmethod
    def from_metadata(cls, metadata: dict[str, str], origin: Path) -> LogHeader:
        """The inverse of `metadata`. Raises `ConfigError`."""
        content: dict[str, Any] = {}
        for name, text in metadata.items():
            try:
                content[name] = json.loads(text)
            except json.JSONDecodeError:
                content[name] = text  # `parse` reports the error
        return parse(cls, content, f"{origin}: header")


def begin_header(name: str, robot: Robot, **about: Any) -> LogHeader:
    """The header of a run that begins now; `name` is the robot's name or folder, `about` the other fields."""
    wall, perf = time.time_ns(), time.perf_counter_ns()
    return LogHeader(
        software=version("flexmotion"),
        robot=name,
        joints=robot.joint_names,
        rate_hz=robot.rate_hz,
        start_ns=wall,
        wall_minus_perf_ns=wall - perf,
        **about,
    )


def robot_files(robot: Robot) -> dict[str, bytes]:
    """The robot file, its MJCF and what was measured and judged of the robot by attachment name, as they are now."""
    beside = [
        file
        for own in (calibration, identification, get_up, push_correction, repertoire)
        if (file := robot.folder / own.FILE).is_file()
    ]
    files = (robot.file, robot.folder / robot.config.mjcf, *beside)
    return {f"{_ROBOT}{file.name}": file.read_bytes() for file in files}


def attached_robot(name: str, files: Mapping[str, bytes], origin: Path) -> Robot:
    """The robot that a log holds; its files are kept in a temporary folder as long as it is.

    Args:
        name: of the folder that it was in.
        files: attachments of the log, by name.
        origin: the log, for messages.

    Raises:
        ConfigError: the log lacks the robot, or files that its MJCF names, such as meshes.
    """
    place = Path(tempfile.mkdtemp(prefix="flexmotion-log-"))
    folder = place / Path(name).name
    folder.mkdir()
    for attachment, content in files.items():
        if attachment.startswith(_ROBOT):
            (folder / Path(attachment).name).write_bytes(content)
    try:
        robot = load_robot(folder)
    except ConfigError as error:
        shutil.rmtree(place, ignore_errors=True)
        raise ConfigError(
            f"{origin}: there is no robot {name!r} any more, and its files in the log are not enough: {error}"
        ) from error
    weakref.finalize(robot, shutil.rmtree, place, ignore_errors=True)
    return robot
