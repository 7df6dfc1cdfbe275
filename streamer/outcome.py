"""`outcome`: a finished run and its judgement."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flexmotion.configs.errors import SessionError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.simulated import simulated
from flexmotion.human.motion import Motion
from flexmotion.retarget.human_steps import count_steps
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.log.recorder import Recorder
from flexmotion.streamer.log.recording import driver_options
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import Performance
from flexmotion.streamer.report.likeness import likeness
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures
from flexmotion.streamer.report.report import Report, RunInfo, build_report
from flexmotion.streamer.report.torque_profile import TorqueProfile, torque_profile
from flexmotion.streamer.run.played_human import human_motion
from flexmotion.streamer.run.session import Phase, Session


@dataclass(frozen=True)
class Outcome:
    """A finished run and its judgement.

    Attributes:
        motion: motion of the human; None if unknown, as in a run with targets.
        figures: the robot's sizes that the report measures by.
        record: every tick of the run, or the last of a long one.
        profile: the human's torques beside the robot's; None if unknown.
        simulated: whether the robot was simulated; its faults are then no failures of hardware.
    """

    robot: Robot
    motion: Motion | None
    figures: RobotFigures
    record: RunTrace
    report: Report
    profile: TorqueProfile | None
    simulated: bool

    def write(self, folder: str | Path, *, video: bool = False) -> Path:
        """Write `report.json`, the pictures and `index.html` with all of it into `folder`; returns the page.

        There are no pictures of a robot whose torque was never on.

        Args:
            folder: of the report.
            video: whether human and robot are filmed too (`motion.mp4`), which takes longer than the rest.

        Raises:
            ConfigError: `video` without the extra of that name.
            FilmError: the film cannot be written; the page is there without it.
        """
        # matplotlib and jinja2 take a second to load: only where a report is asked for.
        from flexmotion.streamer.plots.pictures import write_plots
        from flexmotion.streamer.report.report_page import write_report_page

        folder = Path(folder)
        self.report.write(folder)
        # Of a robot whose torque was never on they would show nothing.
        drawn = bool((self.record.state != State.OFF).any())
        pictures = (
            write_plots(folder, self.record, self.robot, self.figures, self.motion, self.profile) if drawn else []
        )
        page = write_report_page(folder / "index.html", self.report, pictures)
        if not video:
            return page
        # A film takes long and may fail: the page is there before it.
        from flexmotion.streamer.plots.video import film_run

        film = film_run(folder / "motion.mp4", self.record, self.robot, self.motion)
        return write_report_page(folder / "index.html", self.report, pictures, film)


def outcome(session: Session) -> Outcome:
    """The outcome of a session that has run. Raises `SessionError` before its end."""
    if session.phase is not Phase.ENDED:
        raise SessionError(f"{session!r}: its outcome is known once it has ended, after `with session:`")
    robot, source, record = session.robot, session.source, session.record
    noise_m = source.size_m if isinstance(source, NoisySource) else 0.0
    performed = source.source if isinstance(source, NoisySource) else source
    motion = human_motion(source, record)
    if motion is not None:
        record.human_steps = count_steps(motion)
    figures = RobotFigures.of(robot, performed.body.leg if isinstance(performed, Performance) else None)
    options = driver_options(session.driver)
    options |= {} if session.feedback else {"feedback": False}
    options |= {"replan_noise_m": noise_m} if noise_m else {}
    options |= {"allow_refused": True} if session.allow_refused else {}
    options |= {} if session.min_likeness is None else {"min_likeness": session.min_likeness}
    budgets = session.settings.budgets
    info = RunInfo(
        robot=robot.name,
        driver=session.driver.name,
        source=source.name,
        seed=session.seed,
        clock=session.clock,
        options=options,
        elapsed_s=session.elapsed_s,
        realtime=session.scheduling,
        missed_allowed=budgets.missed_deadlines,
        underruns_allowed=budgets.underruns,
        targets=tuple(session.heard),
        ends_itself=session.seconds is not None and not session.stay,
        allow_refused=session.allow_refused,
        min_likeness=session.min_likeness,
        log=next((service.result() for service in session.services if isinstance(service, Recorder)), None),
    )
    profile = None if motion is None else torque_profile(record, robot, figures, motion)
    report = build_report(
        record,
        info,
        figures,
        human=None if motion is None else HumanTrack.of(motion),
        likeness=None if motion is None else likeness(record, robot, figures, motion),
        profile=profile,
    )
    return Outcome(robot, motion, figures, record, report, profile, simulated=simulated(session.driver) is not None)
