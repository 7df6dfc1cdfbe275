"""Is every target over a WebSocket answered, and how soon does it become a command?

Starts `flexmotion dry-run --web` on the simulated robot in real time, sends targets at random intervals (words and
velocities; one in ten right after the one before), and then as many as a socket takes in a burst. Every message must be
answered. The time from target to command is that of the run's report: from the arrival at the gateway to the first
command of the plan. Meant for an otherwise idle machine.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.served_run import served_run
from flexmotion.streamer.commands.choice import SWITCHED_PROMPTS
from flexmotion.streamer.gateway.async_client import AsyncClient
from flexmotion.streamer.gateway.messages import Answer

MEDIAN_MS, P99_MS = 35.0, 50.0
"""Bounds of the time from target to command [ms]."""
FOLLOWED = ("accepted", "slowed", "partly")


@dataclass(frozen=True)
class Told:
    """The answer to one target: what was asked, its state, and the time from sending to the answer [ms]."""

    asked: str
    state: str
    answered_ms: float


async def drive(port: int, targets: int, burst: int, interval_s: float, seed: int) -> list[Told]:
    """Send all targets and wait for their answers."""
    random = np.random.default_rng(seed)

    async def one(client: AsyncClient, message: dict[str, Any]) -> Told:
        begin = time.perf_counter()
        answer: Answer = await client.ask(message)
        return Told(message["type"], answer.state, 1e3 * (time.perf_counter() - begin))

    def drawn() -> dict[str, Any]:
        if random.random() < 0.5:
            return {"type": "text", "text": str(random.choice(SWITCHED_PROMPTS))}
        return {"type": "velocity", "velocity": [0.0, 0.0, round(float(random.uniform(-0.4, 0.4)), 3)], "ttl_s": 1.0}

    async with AsyncClient(port=port, source="benchmark") as client:
        waiting = []
        for _ in range(targets):
            waiting.append(asyncio.create_task(one(client, drawn())))
            # Closer ones would wait for the shortest time between two changes of what is followed.
            await asyncio.sleep(0.0 if random.random() < 0.1 else float(random.uniform(0.5, 1.5)) * interval_s)
        told = list(await asyncio.gather(*waiting))
        return told + list(await asyncio.gather(*(one(client, drawn()) for _ in range(burst))))


def main(
    targets: Annotated[int, typer.Option(min=1, help="Number of targets at random intervals.")] = 1000,
    burst: Annotated[int, typer.Option(min=0, help="Number of targets at once, after them.")] = 1000,
    interval_s: Annotated[float, typer.Option(min=0.0, help="Mean interval [s].")] = 0.5,
    seed: Annotated[int, typer.Option(help="Of targets and intervals.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Send targets to a run and measure."""
    with served_run() as run:
        told = asyncio.run(drive(run.port, targets, burst, interval_s, seed))
        run.end()
    report = run.report
    latency = report["planner"]["target_to_command_ms"]
    states = Counter(one.state for one in told)
    answered = np.array([one.answered_ms for one in told[:targets]])
    table = Table("", "p50 ms", "p99 ms", "max ms")
    table.add_row("target to command", *(f"{latency[key]:.1f}" for key in ("p50", "p99", "max")))
    table.add_row("sending to answer", *(f"{np.percentile(answered, share):.1f}" for share in (50, 99, 100)))
    console = Console(width=100)
    console.print(table)
    console.print(", ".join(f"{state} {number}" for state, number in sorted(states.items())))
    if csv_out is not None:
        write_csv(csv_out, [asdict(one) for one in told])
    followed = sum(states[state] for state in FOLLOWED)
    missed, violations = report["loop"]["missed_deadlines"], report["limits"]["violations_sent"]
    verdicts = [
        Verdict(f"answered: {len(told)} of {targets + burst}", len(told) == targets + burst),
        Verdict(f"target to command, median: {latency['p50']:.1f} ms (<= {MEDIAN_MS:g})", latency["p50"] <= MEDIAN_MS),
        Verdict(f"target to command, p99: {latency['p99']:.1f} ms (<= {P99_MS:g})", latency["p99"] <= P99_MS),
        Verdict(f"missed deadlines: {missed} (0)", missed == 0),
        Verdict(f"goals outside the envelope: {violations} (0)", violations == 0),
        Verdict(f"fell: {report['motion']['fell']}", not report["motion"]["fell"]),
    ]
    figures = {
        "targets": targets + burst,
        "followed": followed,
        "target_to_command_p50_ms": latency["p50"],
        "target_to_command_p99_ms": latency["p99"],
        "answered_p50_ms": float(np.median(answered)),
        "answered_p99_ms": float(np.percentile(answered, 99)),
    }
    return Outcome(verdicts, figures)
