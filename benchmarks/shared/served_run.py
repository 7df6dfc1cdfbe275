"""`served_run`: `flexmotion dry-run --web` in a process of its own, for a benchmark that is one of its clients."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import IO, Any

import psutil

from benchmarks.shared.lines import Lines
from benchmarks.shared.program import ENDED_S, started
from flexmotion.configs.errors import DriverError, GatewayError
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.ports import any_free

PROGRAM = (sys.executable, "-m", "flexmotion.streamer")
PROCESSES = ("loop", "robot", "planner", "gateway", "estop")
"""Processes of a run, as `ps` shows them without "fm-"."""
_FOLLOWS = ("HOLD", "STREAMING")
_STARTED_S = 300.0
"""Longest time until the robot follows targets [s]."""
_LOOK_S = 0.1


class ServedRun:
    """A run on the simulated robot in real time that listens on this machine.

    Attributes:
        process: of the run; it is the parent of the others.
        port, stop_port: where it listens.
        lines: its standard input and output; None: messages come over its ports alone.
        report: its figures, after `end`.
    """

    report: dict[str, Any]
    lines: Lines | None = None

    def __init__(self, process: subprocess.Popen[bytes], ports: tuple[int, int], out: IO[str], notes: IO[str]) -> None:
        self.process, (self.port, self.stop_port) = process, ports
        self._out, self._notes = out, notes

    def client(self, source: str = "benchmark") -> Client:
        """A client that is not connected yet."""
        return Client(port=self.port, stop_port=self.stop_port, source=source)

    def status(self) -> dict[str, Any]:
        """The status; empty where the gateway does not answer.

        Raises:
            DriverError: the run has ended.
        """
        if self.process.poll() is not None:
            raise DriverError(f"the run ended with exit code {self.process.returncode}: {self.last_notes()}")
        try:
            return self.client().status()
        except GatewayError:
            return {}

    def wait_until_it_follows(self) -> None:
        """Wait until the robot stands and follows targets.

        Raises:
            DriverError: the run ended, has a fault, or takes longer than five minutes.
        """
        end = time.monotonic() + _STARTED_S
        while (state := self.status().get("state")) not in _FOLLOWS:
            if state == "FAULT":
                raise DriverError(f"the robot did not stand up; is the machine busy? {self.last_notes()}")
            if time.monotonic() > end:
                what = f"the robot does not follow targets after {_STARTED_S:g} s, its state is {state}"
                raise DriverError(f"{what}: {self.last_notes()}")
            time.sleep(_LOOK_S)

    def processor_s(self) -> dict[str, float]:
        """Processor time of each process so far [s]; without those of `PROCESSES` that are not there."""
        found = {}
        for process in psutil.Process(self.process.pid).children(recursive=True):
            name = process.name().removeprefix("fm-")
            if name in PROCESSES:
                times = process.cpu_times()
                found[name] = times.user + times.system
        return found

    def end(self, how: signal.Signals = signal.SIGINT) -> None:
        """Ask the run to end, wait for it, and read its report.

        Raises:
            DriverError: it has none.
        """
        if self.process.poll() is None:
            self.process.send_signal(how)
        self.process.wait(ENDED_S)
        text = self._printed()
        if not text.startswith("{"):
            raise DriverError(f"the run has no report: {self.last_notes()}")
        self.report = json.loads(text)

    def _printed(self) -> str:
        """What the run has printed, without answers to lines."""
        if self.lines is not None:
            self.lines.end()
            return "".join(self.lines.rest)
        self._out.seek(0)
        return self._out.read()

    def last_notes(self) -> str:
        """The last lines of what the run has told."""
        self._notes.seek(0)
        return self._notes.read().strip()[-300:]


@contextmanager
def served_run(*options: str, lines: bool = False, program: Sequence[str] = PROGRAM) -> Iterator[ServedRun]:
    """Context of a run that follows targets: it is waited for, and ended also where the benchmark fails.

    Args:
        options: further ones of `flexmotion dry-run`.
        lines: whether it takes messages on its standard input too.
        program: that is `flexmotion`.

    Raises:
        DriverError: it did not start, or has no report.
    """
    port, stop_port = any_free(), any_free()
    command = [*program, "dry-run", "--web", "--json", "--allow-refused"]
    command += ["--web-port", str(port), "--stop-port", str(stop_port), *(["--stdin"] if lines else []), *options]
    pipe = subprocess.PIPE if lines else None
    # The output goes to files: nobody reads a pipe while the run goes on, and a full pipe would stop the run.
    with (
        tempfile.TemporaryFile("w+") as out,
        tempfile.TemporaryFile("w+") as notes,
        started(command, stdin=pipe, stdout=pipe or out, stderr=notes) as process,
    ):
        run = ServedRun(process, (port, stop_port), out, notes)
        if process.stdin is not None and process.stdout is not None:
            run.lines = Lines(process.stdin, process.stdout)
        run.wait_until_it_follows()
        yield run
        if not hasattr(run, "report"):
            run.end()
