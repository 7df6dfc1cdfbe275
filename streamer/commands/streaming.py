"""What `dry-run` and `run` share: stream a motion to a driver, then report."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import typer

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.registry import create
from flexmotion.human.motion import Motion
from flexmotion.streamer.commands.exit_codes import CHECK_FAILED, HARDWARE_FAILED, INTERRUPTED
from flexmotion.streamer.commands.log_option import record_to
from flexmotion.streamer.commands.options import Clock
from flexmotion.streamer.commands.output import print_json, print_note, print_result, progress_bar
from flexmotion.streamer.commands.signals import OperatorSignals
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.log.recorder import Recorder
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import Performance
from flexmotion.streamer.plots import write_plots
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures
from flexmotion.streamer.report.report import Report, RunInfo, build_report
from flexmotion.streamer.report.report_page import write_report_page
from flexmotion.streamer.report.summary import render
from flexmotion.streamer.run.session import Session, count_human_steps, human_motion
from flexmotion.streamer.viewer.service import Viewer


@dataclass(frozen=True)
class RunRequest:
    """A run as asked for.

    Attributes:
        source: what to follow, to its end.
        stay, realtime: as of `flexmotion.streamer.run.session.Session`.
        replan_noise_m: error of every redrawn window at 1 s lookahead [m] (`streamer/motion/replan_noise.py`).
        driver_options: fields of the driver's `Options`, without the seed.
        log: file to log to; None: nowhere.
        view_port: first port to try for the page that shows the run; None: no page.
    """

    robot: Robot
    driver: str
    source: Performance
    settings: StreamSettings
    seed: int = 0
    clock: Clock = "lockstep"
    feedback: bool = True
    stay: bool = False
    realtime: bool = True
    replan_noise_m: float = 0.0
    driver_options: dict[str, Any] = field(default_factory=dict)
    log: Path | None = None
    view_port: int | None = None


@dataclass(frozen=True)
class Outcome:
    """A finished run.

    Attributes:
        motion: what the human did; None where it is not known.
        simulated: the robot was a simulated one: what fails of it is no hardware.
    """

    robot: Robot
    motion: Motion | None
    figures: RobotFigures
    record: RunTrace
    report: Report
    interrupted: bool
    simulated: bool


def stream(request: RunRequest, signals: OperatorSignals | None = None) -> Outcome:
    """Run to the end, or until `signals` ask for it.

    Raises:
        ConfigError: driver or an option is unknown.
        DriverError: the driver failed.
    """
    robot = request.robot
    source, seconds = request.source, request.source.seconds
    options = dict(request.driver_options)
    seeded = {"seed": request.seed} if request.driver == "sim" else {}
    driver = create(request.driver, robot, **options, **seeded)
    title = f"{robot.name} follows {source.name}"
    with progress_bar(title) as progress:

        def show(source_s: float) -> None:
            if seconds is not None and math.isfinite(source_s):
                progress(min(max(source_s / seconds, 0.0), 1.0))

        session = Session(
            robot,
            driver,
            NoisySource(source, request.replan_noise_m, request.seed) if request.replan_noise_m else source,
            request.settings,
            None if request.stay else seconds,
            feedback=request.feedback,
            stay=request.stay,
            realtime=request.realtime,
            progress=show,
            next_request=None if signals is None else signals.next,
            wake=None if signals is None else signals.wake,
            on_event=partial(_tell, request.stay),
        )
        if request.view_port is not None:
            viewer = Viewer(robot, session.telemetry, port=request.view_port)
            session.services += (viewer,)
            print_note(f"view: {viewer.url}")
        # Only before the run: a ring has one writer, from the start on the loop.
        for remark in source.remarks:
            session.telemetry.emit(0, "note", remark)
        recorder = None if request.log is None else _recorder(request, session, robot)
        begin = time.perf_counter()
        try:
            record = session.run(request.clock)
        finally:
            logged = None if recorder is None else recorder.result()
            if logged is not None:
                print_note(f"log: {logged}")
        elapsed = time.perf_counter() - begin
    motion = human_motion(source, record)
    if motion is not None:
        record.human_steps = count_human_steps(motion, session.planner.retargeter)
    figures = RobotFigures.of(robot, source.body.leg)
    info = RunInfo(
        robot=robot.name,
        driver=request.driver,
        source=source.name,
        seed=request.seed,
        clock=request.clock,
        options=options | _unusual(request),
        elapsed_s=elapsed,
        realtime=session.scheduling,
        missed_allowed=request.settings.budgets.missed_deadlines,
        underruns_allowed=request.settings.budgets.underruns,
        log=logged,
    )
    report = build_report(record, info, figures, human=None if motion is None else HumanTrack.of(motion))
    return Outcome(
        robot,
        motion,
        figures,
        record,
        report,
        interrupted=signals is not None and signals.interrupted,
        simulated=driver.capabilities.truth,
    )


def _tell(states: bool, event: Event) -> None:
    """Say on stderr what has happened; changes of state where the robot stays."""
    if event.kind != "state" or states:
        print_note(f"{event.kind}: {event.message}")


def _unusual(request: RunRequest) -> dict[str, Any]:
    """What was set otherwise than usual, for the report."""
    unusual: dict[str, Any] = {} if request.feedback else {"feedback": False}
    return unusual | ({"replan_noise_m": request.replan_noise_m} if request.replan_noise_m else {})


def _recorder(request: RunRequest, session: Session, robot: Robot) -> Recorder:
    assert request.log is not None
    return record_to(
        request.log,
        session,
        robot,
        driver=request.driver,
        driver_options=request.driver_options,
        seed=request.seed,
        clock=request.clock,
        source=request.source.name,
    )


def emulated_port(options: Mapping[str, Any]) -> str | None:
    """The first port among a driver's options that is a pseudo-terminal, behind which no servo is."""
    ports = [options.get("port"), *(options.get("ports") or {}).values()]
    return next((port for port in ports if port and Path(port).resolve().is_relative_to("/dev/pts")), None)


def present(outcome: Outcome, folder: Path | None, as_json: bool) -> None:
    """Print the report, write it where asked, and leave with the exit code that it means."""
    report = outcome.report
    if as_json:
        print_json(report.json_text().rstrip())
    else:
        print_result(render(report))
    if folder is not None:
        report.write(folder)
        pictures = write_plots(folder, outcome.record, outcome.robot, outcome.figures, outcome.motion)
        page = write_report_page(folder / "index.html", report, pictures)
        print_note(f"report: {page}")
    if report.safety.hardware_failed and not outcome.simulated:
        if port := emulated_port(report.options):
            print_note(f"{port} is a pseudo-terminal: its other end may have been late (emulate says so when it ends)")
        raise typer.Exit(HARDWARE_FAILED)
    if outcome.interrupted:
        raise typer.Exit(INTERRUPTED)
    if report.safety.hardware_failed or not report.ok:
        raise typer.Exit(CHECK_FAILED)
