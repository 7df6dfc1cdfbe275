"""What `dry-run` and `run` share: stream a motion to a driver, then report."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import typer

from configs.errors import DriverError
from configs.robot import Robot, load_robot
from configs.stream import StreamSettings
from drivers.registry import create
from flexmotion.motion import Motion
from streamer.commands.options import Clock
from streamer.commands.output import print_json, print_note, print_result, progress_bar
from streamer.metrics import HumanTrack, RobotFigures
from streamer.page import write_page
from streamer.plots import write_plots
from streamer.record import RunRecord
from streamer.report import Report, RunInfo, build_report
from streamer.session import Session, count_human_steps
from streamer.sources import ClipSource
from streamer.summary import render

CHECK_FAILED, INTERRUPTED = 1, 130


@dataclass(frozen=True)
class Request:
    """A run as asked for.

    Attributes:
        motion: what to follow, at most `seconds` [s] of it.
        driver_options: fields of the driver's `Options`, without the seed.
    """

    robot: str
    driver: str
    motion: Motion
    settings: StreamSettings
    seconds: float | None = None
    seed: int = 0
    clock: Clock = "lockstep"
    feedback: bool = True
    driver_options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """A finished run."""

    robot: Robot
    motion: Motion
    figures: RobotFigures
    record: RunRecord
    report: Report
    interrupted: bool


def stream(request: Request) -> Outcome:
    """Run to the end, or until Ctrl-C asks for a stop and a second one cuts it short.

    Raises:
        ConfigError: robot, driver or an option is unknown.
        DriverError: the driver failed.
        KeyboardInterrupt: interrupted twice; the driver has been closed.
    """
    robot = load_robot(request.robot)
    source = ClipSource(request.motion)
    seconds = min(request.seconds or source.seconds, source.seconds)
    played = source.cut(seconds)
    options = dict(request.driver_options)
    seeded = {"seed": request.seed} if request.driver == "sim" else {}
    driver = create(request.driver, robot, **options, **seeded)
    title = f"{robot.name} follows {request.motion.source}"
    with _stop_on_interrupt() as stop_requested, progress_bar(title) as progress:
        session = Session(
            robot,
            driver,
            played,
            request.settings,
            seconds,
            feedback=request.feedback,
            progress=progress,
            stop_requested=stop_requested,
        )
        begin = time.perf_counter()
        try:
            record = session.run(request.clock)
        except OSError as error:
            # A port that went away: pyserial's errors are OSErrors. Files are read before and written after.
            raise DriverError(f"driver {request.driver!r}: {error}") from error
        elapsed = time.perf_counter() - begin
        interrupted = stop_requested()
    record.human_steps = count_human_steps(played.motion, session.planner.retargeter)
    for event in record.events:
        if event.kind == "warning":
            print_note(f"warning: {event.message}")
    figures = RobotFigures.of(robot, request.motion.body.leg)
    info = RunInfo(
        robot=robot.name,
        driver=request.driver,
        source=request.motion.source,
        seed=request.seed,
        clock=request.clock,
        options=options | ({} if request.feedback else {"feedback": False}),
        elapsed_s=elapsed,
        missed_allowed=request.settings.budgets.missed_deadlines,
        underruns_allowed=request.settings.budgets.underruns,
    )
    report = build_report(record, info, figures, human=HumanTrack.of(played.motion))
    return Outcome(robot, played.motion, figures, record, report, interrupted)


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
        page = write_page(folder / "index.html", report, pictures)
        print_note(f"report: {page}")
    if outcome.interrupted:
        raise typer.Exit(INTERRUPTED)
    if not report.ok:
        raise typer.Exit(CHECK_FAILED)


@contextmanager
def _stop_on_interrupt() -> Iterator[Callable[[], bool]]:
    """Within, the first SIGINT or SIGTERM is only remembered (what is yielded tells), the second one interrupts."""
    received: list[int] = []

    def remember(number: int, _frame: FrameType | None) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)
        print_note("stopping: the robot comes to a stand and parks; once more to cut this short")

    before = {number: signal.signal(number, remember) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
