"""The report of a run from its log, for `log plot` and `log replay`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, list_robots, load_robot
from flexmotion.human.motion import Motion
from flexmotion.retarget.human_steps import count_steps
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.log.header import LogHeader, attached_robot
from flexmotion.streamer.log.reader import Log
from flexmotion.streamer.log.source import MODEL
from flexmotion.streamer.report.likeness import likeness
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures
from flexmotion.streamer.report.report import Report, RunInfo, build_report
from flexmotion.streamer.report.torque_profile import TorqueProfile, torque_profile
from flexmotion.streamer.run.played_human import human_motion


@dataclass(frozen=True)
class Subject:
    """The robot and the human of a log.

    Attributes:
        robot: the robot as installed now, see `Log.changed_files`; where its folder is gone, as the log holds it.
        motion: motion of the human; None if the source followed targets, or is not in the log.
    """

    robot: Robot
    motion: Motion | None
    figures: RobotFigures
    human_steps: int | None

    @classmethod
    def of(cls, log: Log) -> Subject:
        """From the log and the robot's files. Raises `ConfigError`, `MotionFormatError`."""
        name = log.header.robot
        gone = name not in list_robots() and not Path(name).is_dir()
        robot = attached_robot(name, log.files, log.path) if gone else load_robot(name)
        motion = _human(log)
        figures = RobotFigures.of(robot, None if motion is None else motion.body.leg)
        steps = None if motion is None else count_steps(motion)
        return cls(robot, motion, figures, steps)

    def report(self, log: Log, record: RunTrace) -> Report:
        """The report of `record`: the log's own, or that of its replay."""
        header, budgets = log.header, log.header.settings.budgets
        record.human_steps = self.human_steps
        info = RunInfo(
            robot=self.robot.name,
            driver=header.driver,
            source=header.source,
            seed=header.seed,
            clock=header.clock,
            options=header.driver_options | _settings(header),
            missed_allowed=budgets.missed_deadlines,
            underruns_allowed=budgets.underruns,
            log=str(log.path),
            targets=tuple(log.heard),
            ends_itself=header.seconds is not None and not header.stay,
            allow_refused=header.allow_refused,
            min_likeness=header.min_likeness,
        )
        human = None if self.motion is None else HumanTrack.of(self.motion)
        like = None if self.motion is None else likeness(record, self.robot, self.figures, self.motion)
        return build_report(record, info, self.figures, human=human, likeness=like, profile=self.profile(record))

    def profile(self, record: RunTrace) -> TorqueProfile | None:
        """The human's torques beside the robot's in `record`; None if unknown."""
        return None if self.motion is None else torque_profile(record, self.robot, self.figures, self.motion)


def _settings(header: LogHeader) -> dict[str, bool | float]:
    """Settings of a run that differ from the default, as in its own report."""
    found: dict[str, bool | float] = {} if header.feedback else {"feedback": False}
    found |= {} if header.min_likeness is None else {"min_likeness": header.min_likeness}
    return found | ({"allow_refused": True} if header.allow_refused else {})


def _human(log: Log) -> Motion | None:
    """Motion of the human, if the log holds its source."""
    if not log.files:
        return None
    try:
        source = log.source()
    except ConfigError:
        # A log does not hold the model, which may not be on this machine; the rest of the log is still readable.
        if log.header.source_parts.get("kind") != MODEL:
            raise
        return None
    return human_motion(source, log.record())
