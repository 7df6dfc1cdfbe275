"""`record_to`: adds a recorder to a session that has not begun."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from flexmotion.configs.robot import list_robots
from flexmotion.drivers.interface import Driver
from flexmotion.streamer.log.header import begin_header, robot_files
from flexmotion.streamer.log.recorder import Recorder
from flexmotion.streamer.log.source import pack
from flexmotion.streamer.run.session import Session


def record_to(file: Path, session: Session, clock: Literal["real", "lockstep"]) -> Recorder:
    """Record a session to a log.

    Args:
        clock: that the session will run on.

    Raises:
        ConfigError: the file cannot be written.
    """
    robot = session.robot
    parts, motions = pack(session.source)
    header = begin_header(
        robot.name if robot.name in list_robots() else str(robot.folder.resolve()),
        robot,
        source=session.source.name,
        source_parts=parts,
        driver=session.driver.name,
        driver_options=driver_options(session.driver),
        seed=session.seed,
        clock=clock,
        settings=session.settings,
        seconds=session.seconds,
        feedback=session.feedback,
        allow_refused=session.allow_refused,
    )
    files = motions | robot_files(robot)
    recorder = Recorder(
        file, header, files, session.telemetry, session.plans, session.targets, session.heard_channel, session.heard
    )
    session.services += (recorder,)
    return recorder


def driver_options(driver: Driver) -> dict[str, Any]:
    """The options that a driver was given, by name; without the seed, which logs and reports hold apart."""
    return driver.options.model_dump(mode="json", exclude_unset=True, exclude={"seed"})
