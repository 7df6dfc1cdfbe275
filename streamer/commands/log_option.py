"""Where a run is logged to, and what its log says of it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import typer

from flexmotion.configs.robot import Robot, list_robots
from flexmotion.streamer.log.header import begin_header, robot_files
from flexmotion.streamer.log.recorder import Recorder
from flexmotion.streamer.log.source import pack
from flexmotion.streamer.run.session import Session

LOG_NAME, SUFFIX = "run.mcap", ".mcap"


def log_file(log: Path | None, report: Path | None) -> Path | None:
    """The file to log to: `log`, or a new one in it where it is a folder; else one beside the report; else None.

    Raises:
        typer.BadParameter: `log` is neither a folder nor a name of a log.
    """
    if log is not None:
        if log.is_dir():
            return log / f"{time.strftime('%Y%m%d-%H%M%S')}{SUFFIX}"
        if log.suffix != SUFFIX:
            raise typer.BadParameter(f"--log: {log}: expected a folder or a file that ends in {SUFFIX}")
        return log
    if report is None:
        return None
    report.mkdir(parents=True, exist_ok=True)
    return report / LOG_NAME


def record_to(file: Path, session: Session, robot: Robot, **about: Any) -> Recorder:
    """Let a session be recorded; `about` are the fields of `LogHeader` that the session does not know.

    Raises:
        ConfigError: the file cannot be written.
    """
    parts, motions = pack(session.source)
    header = begin_header(
        robot.name if robot.name in list_robots() else str(robot.folder.resolve()),
        robot,
        source_parts=parts,
        settings=session.settings,
        seconds=session.seconds,
        feedback=session.feedback,
        **about,
    )
    files = motions | robot_files(robot)
    recorder = Recorder(file, header, files, session.telemetry, session.plans, session.targets)
    session.services += (recorder,)
    return recorder
