"""`LiveRun`: a run on the wall clock in a process of its own, whose memory the benchmark reads."""

from __future__ import annotations

import json
import multiprocessing
import signal
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import psutil

from flexmotion.configs.errors import DriverError, GatewayError
from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.realtime import child
from flexmotion.streamer import api
from flexmotion.streamer.commands.choice import choose_source
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.listening import Listening
from flexmotion.streamer.outcome import outcome as outcome_of
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

_PATIENCE_S = 300.0


class LiveRun:
    """A context manager: begins on entering, is ended on leaving, and where this process is killed.

    Args:
        settings: of the stream.
        listening: how it takes targets.

    Attributes:
        session: the run; its memory is shared, it is not to be run here.
        report: the run's, after `end`.
    """

    report: dict[str, Any]

    def __init__(self, settings: StreamSettings, listening: Listening) -> None:
        robot = api.open_robot("op3")
        source = choose_source(robot, listens=True, endless=True)
        self.session: Session = api.open_session(
            robot, "sim", source, clock="real", settings=settings, stay=True, listening=listening, allow_refused=True
        )
        context = multiprocessing.get_context("fork")
        self._folder = tempfile.TemporaryDirectory()
        self._file = Path(self._folder.name) / "report.json"
        self._ending, self._ended = context.Event(), False

    def __enter__(self) -> Self:
        self._process = child.start("benchmark", self._run)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()
        self._folder.cleanup()

    def _run(self) -> None:
        self.session.next_request = self._next_request
        self.session.run()
        self._file.write_text(outcome_of(self.session).report.json_text(), encoding="utf-8")

    def _next_request(self) -> Request | None:
        if self._ended or not self._ending.is_set():
            return None
        self._ended = True
        return Request.END

    def wait_for(self, *states: State) -> None:
        """Wait until the loop is in one of these states.

        Raises:
            DriverError: the run ended, or it takes longer than five minutes.
        """
        end = time.monotonic() + _PATIENCE_S
        while (row := self.row()) is None or State(int(row.state)) not in states:
            if not self._process.is_alive() or time.monotonic() > end:
                raise DriverError(f"the run did not come to {' or '.join(state.name for state in states)}")
            time.sleep(0.02)

    def wait_until_it_listens(self, patience_s: float = _PATIENCE_S) -> None:
        """Wait until the gateway answers.

        Raises:
            DriverError: it does not in time.
        """
        port, end = self.session.settings.gateway.port, time.monotonic() + patience_s
        while True:
            try:
                Client(port=port).status()
                return
            except GatewayError as error:
                if time.monotonic() > end:
                    raise DriverError(f"the gateway does not listen after {patience_s:g} s") from error
                time.sleep(0.1)

    def row(self) -> TickRow | None:
        """The newest row of the loop."""
        row = self.session.telemetry.ticks.latest()
        return None if row is None else TickRow(row)

    def stop_process(self, title: str) -> None:
        """Stop a process of the run as SIGSTOP does, such as "fm-gateway"; it goes on when the run ends."""
        for process in psutil.Process(self._process.pid).children(recursive=True):
            if title in " ".join(process.cmdline()) or process.name() == title:
                process.send_signal(signal.SIGSTOP)
                return
        raise DriverError(f"no process of the run is called {title}")

    def end(self) -> None:
        """End the run and read its report. Nothing where it has ended."""
        if not self._process.is_alive() and hasattr(self, "report"):
            return
        for process in psutil.Process(self._process.pid).children(recursive=True) if self._process.is_alive() else ():
            if process.status() == psutil.STATUS_STOPPED:
                process.send_signal(signal.SIGCONT)
        self._ending.set()
        self._process.join(_PATIENCE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self.report = json.loads(self._file.read_text(encoding="utf-8")) if self._file.exists() else {}
