"""How long does a live run take from Ctrl-C until the robot is parked and the program has ended?

Starts `flexmotion run` on the simulated robot in real time, sends SIGINT at a random moment of the shipped motion, and
measures the time until the robot is parked with torque off, which is judged, and until the program ends, which includes
the report. Meant for an otherwise idle machine.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.program import started
from flexmotion.configs.errors import DriverError

LIMIT_S = 5.5
"""Longest time of the stop and of parking [s]."""
EARLIEST_S, LATEST_S = 1.0, 12.0
"""Moments of the signal, after the first plan began to play [s]."""
INTERRUPTED = 130


@dataclass(frozen=True)
class Stop:
    """One run: the moment of the signal, the times from it to torque off and to the end [s], whether the robot fell."""

    moment_s: float
    parked_s: float
    ended_s: float
    fell: bool


def stop(moment_s: float) -> Stop:
    """Start a run and interrupt it at a moment of its motion.

    Raises:
        DriverError: the run ended before the signal, or otherwise than by it.
    """
    command = [sys.executable, "-m", "flexmotion.streamer", "run", "-r", "op3", "-d", "sim", "--json"]
    with started(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        wait_for(run, "READY -> STREAMING")
        time.sleep(moment_s)
        begin = time.monotonic()
        run.send_signal(signal.SIGINT)
        wait_for(run, "PARK -> OFF")
        parked = time.monotonic() - begin
        out, err = run.communicate()
        ended = time.monotonic() - begin
    if run.returncode != INTERRUPTED:
        raise DriverError(f"the run ended with exit code {run.returncode}: {err.strip()[-200:]}")
    return Stop(moment_s, parked, ended, bool(json.loads(out)["motion"]["fell"]))


def wait_for(run: subprocess.Popen[str], words: str) -> None:
    """Read the messages of a run until one has these words.

    Raises:
        DriverError: it ended without.
    """
    assert run.stderr is not None
    messages = []
    for line in run.stderr:
        messages.append(line)
        if words in line:
            return
    raise DriverError(f"the run ended without {words!r}: {''.join(messages).strip()[-200:]}")


def main(
    runs: Annotated[int, typer.Option(min=1, help="Number of runs.")] = 10,
    seed: Annotated[int, typer.Option(help="Of the moments.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Interrupt every run and measure."""
    moments = np.random.default_rng(seed).uniform(EARLIEST_S, LATEST_S, runs)
    done = [stop(float(moment)) for moment in track(moments, "runs", console=Console(stderr=True))]
    table = Table("signal at s", "parked after s", "ended after s", "fell")
    for own in done:
        table.add_row(f"{own.moment_s:.1f}", f"{own.parked_s:.2f}", f"{own.ended_s:.2f}", "yes" if own.fell else "")
    Console(width=100).print(table)
    if csv_out is not None:
        write_csv(csv_out, [asdict(own) for own in done])
    worst, falls = max(own.parked_s for own in done), sum(own.fell for own in done)
    verdicts = [
        Verdict(f"longest time until parked: {worst:.2f} s (<= {LIMIT_S})", worst <= LIMIT_S),
        Verdict(f"falls: {falls} (0)", falls == 0),
    ]
    parked, ended = (float(np.median([getattr(own, name) for own in done])) for name in ("parked_s", "ended_s"))
    return Outcome(verdicts, {"runs": runs, "parked_s": parked, "parked_longest_s": worst, "ended_s": ended})
