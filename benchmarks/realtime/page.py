"""What do open pages cost the run: its punctuality, its plans, and processor time of each process?

Starts `flexmotion dry-run --web` on the simulated robot in real time with no page, one and three, over and over, sends
each run the same targets, and reads what pages are sent as a browser does. Figures are compared within a round, since
machines are slower at times. What a browser needs to draw it is not measured: it runs on another machine.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import asdict, dataclass
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from benchmarks.realtime.gateway import drive
from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.served_run import PROCESSES, served_run

PAGES = (0, 1, 3)
MOST_CPU, MOST_EACH, MOST_SLOWER = 0.25, 0.05, 1.1
"""Bounds: processor time of the gateway with three pages, more of it for each page after the first [cores]; how much
longer plans take with three pages than with none."""


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        pages: number of pages open.
        wake_p99_us: lateness of the loop [µs].
        missed: deadlines of the loop.
        work_p50_us: work of a tick [µs].
        sample_ms, retarget_ms, command_ms: medians of making plans, and from target to command [ms].
        kilobytes_s: sent to each page [kB/s].
        loop, robot, planner, gateway, estop: processor time of the process over clock time [cores].
    """

    pages: int
    wake_p99_us: float
    missed: int
    work_p50_us: float
    sample_ms: float
    retarget_ms: float
    command_ms: float
    kilobytes_s: float
    loop: float
    robot: float
    planner: float
    gateway: float
    estop: float


class Page:
    """Reads what a page is sent."""

    def __init__(self) -> None:
        self.received = 0

    @asynccontextmanager
    async def opened(self, port: int) -> AsyncIterator[None]:
        """The page is open in this context."""
        async with connect(f"ws://127.0.0.1:{port}/targets?page&status=4", max_size=None) as socket:

            async def read() -> None:
                try:
                    async for message in socket:
                        self.received += len(message)
                except ConnectionClosed:
                    pass  # the run has ended

            reading = asyncio.create_task(read())
            try:
                yield
            finally:
                reading.cancel()


def measured(pages: int, targets: int, interval_s: float, seed: int) -> Run:
    """One run with a number of pages.

    Raises:
        DriverError: it has no report.
    """
    open_pages = [Page() for _ in range(pages)]
    with served_run("--seed", str(seed)) as run:

        async def watch() -> tuple[dict[str, float], float]:
            async with AsyncExitStack() as entered:
                for page in open_pages:
                    await entered.enter_async_context(page.opened(run.port))
                before, begin = run.processor_s(), time.perf_counter()
                await drive(run.port, targets, 0, interval_s, seed)
                after, passed = run.processor_s(), time.perf_counter() - begin
            return {name: (after[name] - before[name]) / passed for name in PROCESSES}, passed

        cores, passed = asyncio.run(watch())
        run.end()
    report = run.report
    loop, planner = report["loop"], report["planner"]
    return Run(
        pages=pages,
        wake_p99_us=loop["wake_lateness_us"]["p99"],
        missed=loop["missed_deadlines"],
        work_p50_us=loop["work_us"]["p50"],
        sample_ms=planner["sample_ms"]["p50"],
        retarget_ms=planner["retarget_ms"]["p50"],
        command_ms=planner["target_to_command_ms"]["p50"],
        kilobytes_s=float(np.mean([page.received for page in open_pages])) / passed / 1e3 if pages else 0.0,
        **cores,
    )


def main(
    rounds: Annotated[int, typer.Option(min=1, help="Runs with each number of pages.")] = 3,
    targets: Annotated[int, typer.Option(min=1, help="Targets of a run.")] = 40,
    interval_s: Annotated[float, typer.Option(min=0.2, help="Mean interval [s].")] = 0.5,
    seed: Annotated[int, typer.Option(help="Of targets and intervals.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run with no page, one and three, and compare."""
    runs = [measured(pages, targets, interval_s, seed + turn) for turn in range(rounds) for pages in PAGES]
    medians = {
        pages: {
            name: float(np.median([asdict(run)[name] for run in runs if run.pages == pages]))
            for name in asdict(runs[0])
        }
        for pages in PAGES
    }
    table = Table("median of the runs", *(f"{pages} pages" for pages in PAGES))
    for name in list(asdict(runs[0]))[1:]:
        table.add_row(name, *(f"{medians[pages][name]:.3g}" for pages in PAGES))
    Console(width=100).print(table)
    if csv_out is not None:
        write_csv(csv_out, [asdict(run) for run in runs])
    slower = _slower(runs, "retarget_ms")
    gateway, each = medians[3]["gateway"], (medians[3]["gateway"] - medians[1]["gateway"]) / 2
    verdicts = [
        Verdict(f"gateway with three pages: {gateway:.2f} of a core (<= {MOST_CPU:g})", gateway <= MOST_CPU),
        Verdict(f"more of it for each further page: {each:.3f} (<= {MOST_EACH:g})", each <= MOST_EACH),
        Verdict(f"retargeting with three pages over none: {slower:.2f} (<= {MOST_SLOWER:g})", slower <= MOST_SLOWER),
    ]
    figures = {f"{name}_{pages}": value for pages, found in medians.items() for name, value in found.items()}
    return Outcome(verdicts, {**figures, "retarget_slower": slower, "command_slower": _slower(runs, "command_ms")})


def _slower(runs: list[Run], name: str) -> float:
    """Median over the rounds of a figure with three pages over the one with none."""
    with_pages, without = ([asdict(run)[name] for run in runs if run.pages == pages] for pages in (3, 0))
    return float(np.median(np.array(with_pages) / np.array(without)))
