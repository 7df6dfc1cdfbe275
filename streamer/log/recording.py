"""`record_to`: adds a recorder to a session that has not begun."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from flexmotion.configs.robot import list_robots
from flexmotion.drivers.interface import Driver
from flexmotion.streamer.log.following import Published
from flexmotion.streamer.log.header import LogHeader, begin_header, robot_files
from flexmotion.streamer.log.live_view import LiveView
from flexmotion.streamer.log.recorder import Recorder
from flexmotion.streamer.log.source import pack
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.run.session import Session


def record_to(file: Path, session: Session, clock: Literal["real", "lockstep"]) -> Recorder:
    """Record a session to a log.

    Args:
        clock: that the session will run on.

    Raises:
        ConfigError: the file cannot be written, or another run writes to it.
    """
    published, motions = _published(session, clock)
    recorder = Recorder(file, motions | robot_files(session.robot), published)
    session.services += (recorder,)
    return recorder


def show_in_foxglove(port: int, session: Session) -> LiveView:
    """Show a session in Foxglove while it runs, to programs of this machine.

    Args:
        port: that Foxglove connects to.

    Raises:
        ConfigError: the port is taken.
    """
    view = LiveView(port, _published(session, session.clock)[0])
    session.services += (view,)
    return view


def _published(session: Session, clock: Literal["real", "lockstep"]) -> tuple[Published, dict[str, bytes]]:
    """What a session publishes, and the motions that it follows, by attachment name."""
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
        min_likeness=session.min_likeness,
        armed=session.armed,
        attended=session.attended,
    )
    channels = (session.telemetry, session.plans, session.targets, session.heard_channel)
    persons = session.source.channel if isinstance(session.source, MirrorSource) else None

    def begun() -> LogHeader:
        return header.model_copy(update={"stay": session.stay})

    return Published(begun, *channels, tuple(session.heard), persons), motions


def driver_options(driver: Driver) -> dict[str, Any]:
    """The options that a driver was given, by name; without the seed, which logs and reports hold apart."""
    return driver.options.model_dump(mode="json", exclude_unset=True, exclude={"seed"})
