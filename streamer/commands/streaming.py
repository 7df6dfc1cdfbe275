"""What `dry-run` and `run` share: run a session with a progress bar, then report."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import typer

from flexmotion.configs.errors import FilmError
from flexmotion.streamer.commands.exit_codes import CHECK_FAILED, HARDWARE_FAILED, INTERRUPTED, OK
from flexmotion.streamer.commands.output import print_json, print_note, print_result, progress_bar
from flexmotion.streamer.commands.signals import OperatorSignals
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.log.live_view import LiveView
from flexmotion.streamer.log.recorder import Recorder
from flexmotion.streamer.motion.sources import Performance
from flexmotion.streamer.outcome import Outcome
from flexmotion.streamer.outcome import outcome as outcome_of
from flexmotion.streamer.report.summary import render
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session


def stream(session: Session, signals: OperatorSignals | None = None) -> Outcome:
    """Run to the end, or until `signals` ask for it.

    Raises:
        ConfigError: the driver cannot run on the session's clock.
        DriverError: the driver failed.
    """
    seconds = session.source.seconds if isinstance(session.source, Performance) else session.seconds
    if signals is not None:
        session.next_request, session.wake = signals.next, signals.wake
    session.on_event = partial(_print_event, bool(session.stay))
    with progress_bar(f"{session.robot.name} follows {session.source.name}") as progress:

        def show(source_s: float) -> None:
            if seconds is not None and math.isfinite(source_s):
                progress(min(max(source_s / seconds, 0.0), 1.0))

        session.progress = show
        for service in session.services:
            if isinstance(service, GatewayService) and service.url is not None:
                session.next_request = _telling_address(service, session.next_request)
            if isinstance(service, LiveView):
                print_note(f"foxglove: open the connection {service.url}")
        try:
            session.run()
        finally:
            for service in session.services:
                if isinstance(service, Recorder):
                    print_note(f"log: {service.result()}")
    return outcome_of(session)


def _telling_address(
    service: GatewayService, next_request: Callable[[], Request | None] | None
) -> Callable[[], Request | None]:
    """`next_request` that also prints the address of a page, once it can be opened.

    On a busy machine the gateway's process listens seconds after the run has begun; until then a browser is refused.
    """
    told = False

    def next_and_tell() -> Request | None:
        nonlocal told
        if not told and service.listens:
            told = True
            print_note(f"web: {service.url}")
            if service.far_url is not None:
                print_note(f"on another machine: {service.far_url}")
        return None if next_request is None else next_request()

    return next_and_tell


def _print_event(states: bool, event: Event) -> None:
    """Print an event to stderr; changes of state only where `states` says so."""
    if event.kind != "state" or states:
        print_note(f"{event.kind}: {event.message}")


def emulated_port(options: Mapping[str, Any]) -> str | None:
    """The first port among a driver's options that is a pseudo-terminal, as of `flexmotion emulate`."""
    ports = [options.get("port"), *(options.get("ports") or {}).values()]
    return next((port for port in ports if port and Path(port).resolve().is_relative_to("/dev/pts")), None)


def present(
    outcome: Outcome,
    folder: Path | None,
    as_json: bool,
    signals: OperatorSignals | None = None,
    *,
    video: bool = False,
) -> None:
    """Print the report, write it where asked, with a video or without, and leave with the exit code that it means.

    SIGTERM is the regular end of a daemon: exit code 0 if the robot is parked without a fault.
    """
    report = outcome.report
    if as_json:
        print_json(report.json_text().rstrip())
    else:
        print_result(render(report))
    if folder is not None:
        try:
            print_note(f"report: {outcome.write(folder, video=video)}")
        except FilmError as error:  # the run's verdict decides
            print_note(f"report: {folder / 'index.html'}, without a film: {error}")
    if report.safety.hardware_failed and not outcome.simulated:
        if port := emulated_port(report.options):
            print_note(f"{port} is a pseudo-terminal: its other end may have been late (emulate says so when it ends)")
        raise typer.Exit(HARDWARE_FAILED)
    if signals is not None and signals.terminated:
        parked = report.safety.final_state == State.OFF.name and not report.safety.faults
        raise typer.Exit(OK if parked else CHECK_FAILED)
    if signals is not None and signals.interrupted:
        raise typer.Exit(INTERRUPTED)
    if report.safety.hardware_failed or not report.ok:
        raise typer.Exit(CHECK_FAILED)
