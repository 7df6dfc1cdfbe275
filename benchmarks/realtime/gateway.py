"""Is every target over a WebSocket answered, and how soon does it become a command?

Starts `flexmotion dry-run --web` on the simulated robot in real time, sends targets at random intervals (words and
velocities; one in ten right after the one before), and then as many as a socket takes in a burst. Every message must be
answered. The time from target to command, of those at intervals, is the loop's: from the arrival at the gateway to the
first command of the plan. It is judged as `flexmotion check latency` does: median and 99 % while the machine kept its
pace, 95 % of all; with more than 10 % left out the run says nothing about the program. A table shows what the slowest
targets waited for. Meant for an otherwise idle machine.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.shared.live_run import LiveRun
from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.target_waits import Wait, waits_of
from flexmotion.configs.errors import DriverError, GatewayError
from flexmotion.configs.stream import Budgets, Gateway, load_stream
from flexmotion.drivers.realtime.witness import Witness
from flexmotion.streamer.checks.latency_result import Stage
from flexmotion.streamer.checks.machine_pace import MachinePace
from flexmotion.streamer.checks.stages import target_to_command, unfit
from flexmotion.streamer.commands.choice import SWITCHED_PROMPTS
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import Collector, RunTrace
from flexmotion.streamer.gateway.async_client import AsyncClient
from flexmotion.streamer.gateway.listening import Listening
from flexmotion.streamer.gateway.messages import Answer
from flexmotion.streamer.gateway.ports import any_free

FOLLOWED = ("accepted", "slowed", "partly")
_SLOWEST = 10
_LOOKS_S = 1.0
_MARGIN_S = 120.0
"""Part of the run that is kept beyond the targets at intervals: standing up, the burst, parking [s]."""


@dataclass(frozen=True)
class Told:
    """The answer to one target: what was asked, its number, its state, and the time from sending to the answer [ms]."""

    asked: str
    target: int
    state: str
    answered_ms: float


@dataclass(frozen=True)
class Measured:
    """A run and what its clients were told.

    Attributes:
        told: the answers, in the order in which the targets were sent.
        record: its rows.
        report: its report.
        pace: of the machine; None where the witness was not granted its priority.
    """

    told: list[Told]
    record: RunTrace
    report: dict[str, Any]
    pace: MachinePace | None


async def drive(
    port: int, targets: int, burst: int, interval_s: float, seed: int, look: Callable[[], object] = lambda: None
) -> list[Told]:
    """Send all targets and wait for their answers; `look` is called once a second meanwhile."""
    random = np.random.default_rng(seed)

    async def one(client: AsyncClient, message: dict[str, Any]) -> Told:
        begin = time.perf_counter()
        answer: Answer = await client.ask(message)
        answered_ms = 1e3 * (time.perf_counter() - begin)
        return Told(str(message.get("text", message["type"])), answer.target or 0, answer.state, answered_ms)

    def drawn() -> dict[str, Any]:
        if random.random() < 0.5:
            return {"type": "text", "text": str(random.choice(SWITCHED_PROMPTS))}
        return {"type": "velocity", "velocity": [0.0, 0.0, round(float(random.uniform(-0.4, 0.4)), 3)], "ttl_s": 1.0}

    async def watch() -> None:
        while True:
            look()
            await asyncio.sleep(_LOOKS_S)

    async with AsyncClient(port=port, source="benchmark") as client:
        watching = asyncio.create_task(watch())
        waiting = []
        for _ in range(targets):
            waiting.append(asyncio.create_task(one(client, drawn())))
            # Targets that come later, and closer than `change_s`, would wait for the change before them.
            await asyncio.sleep(0.0 if random.random() < 0.1 else float(random.uniform(0.5, 1.5)) * interval_s)
        told = list(await asyncio.gather(*waiting))
        told += list(await asyncio.gather(*(one(client, drawn()) for _ in range(burst))))
        watching.cancel()
        with suppress(asyncio.CancelledError):
            await watching
        return told


def measured(targets: int, burst: int, interval_s: float, seed: int) -> Measured:
    """Run, with a witness that has watched the idle machine before.

    Raises:
        DriverError: the run has ended before all was answered.
    """
    settings = load_stream()
    port = any_free()
    gateway = Gateway.model_validate({"port": port, "stop_port": any_free()})
    settings = settings.model_copy(update={"gateway": gateway})
    live = LiveRun(settings, Listening())
    session, witness = live.session, Witness()
    kept_s = 1.5 * targets * interval_s + _MARGIN_S
    record = RunTrace(session.robot.rate_hz, session.robot.joint_names, kept_s=kept_s)
    collector = Collector(session.telemetry, record)
    with ExitStack() as stack:
        stack.enter_context(witness)
        run = stack.enter_context(live)
        run.wait_for(State.HOLD, State.STREAMING)
        run.wait_until_it_listens()
        try:
            told = asyncio.run(drive(port, targets, 0, interval_s, seed, collector.collect))
            collector.collect()
            spaced = record.used
            told += asyncio.run(drive(port, 0, burst, interval_s, seed + 1, collector.collect))
        except GatewayError as error:
            collector.collect()
            faults = [event.message for event in record.events if event.kind == "fault"]
            raise DriverError(f"{error}; faults of the run: {'; '.join(faults) or 'none'}") from error
        run.end()
        collector.collect()
        record.rows["target_to_command_s"][spaced:] = np.nan  # the burst waits for the change before, by design
        return Measured(told, record, run.report, MachinePace.of(record, witness, 0.0))


def verdicts_of(found: Measured, asked: int, command: Stage, budgets: Budgets) -> list[Verdict]:
    """Every criterion; those of times as `flexmotion check latency` judges them."""
    pace, report = found.pace, found.report
    answered = Verdict(f"answered: {len(found.told)} of {asked}", len(found.told) == asked)
    if pace is None or command.time is None or command.kept is None:
        told = "no realtime scheduling, or no target was followed while the machine kept its pace"
        return [answered, Verdict(f"{told}: figures do not count", False)]
    reason, share = unfit(pace, command), f"{100 * (1 - command.left_out):.1f} % of the targets"
    kept, whole, missed = command.kept, command.time, report["loop"]["missed_deadlines"]
    median, most, all_of = (
        budgets.target_to_command_p50_ms,
        budgets.target_to_command_p99_ms,
        budgets.target_to_command_ms,
    )
    violations, fell = report["limits"]["violations_sent"], report["motion"]["fell"]
    return [
        answered,
        Verdict(f"the machine kept its pace during {share}: {'UNFIT, ' + reason if reason else 'fit'}", not reason),
        Verdict(f"target to command then, median: {kept.p50:.1f} ms (<= {median:g})", kept.p50 <= median),
        Verdict(f"target to command then, p99: {kept.p99:.1f} ms (<= {most:g})", kept.p99 <= most),
        Verdict(f"target to command of all, p95: {whole.p95:.1f} ms (<= {all_of:g})", whole.p95 <= all_of),
        Verdict(f"missed deadlines but for the machine's: {pace.missed_kept} of {missed} (0)", pace.missed_kept == 0),
        Verdict(f"goals outside the envelope: {violations} (0)", violations == 0),
        Verdict(f"fell: {fell}", not fell),
    ]


def slowest(waits: Sequence[Wait], told: Sequence[Told]) -> Table:
    """What the slowest targets waited for."""
    asked = {one.target: one.asked for one in told}
    columns = (
        "slowest targets [ms]",
        "to command",
        "plan begun",
        "sampled",
        "retargeted",
        "joined",
        "machine off pace",
    )
    table = Table(*columns)
    for wait in sorted(waits, key=lambda wait: -wait.total_ms)[:_SLOWEST]:
        times = (wait.total_ms, wait.begin_ms, wait.sample_ms, wait.retarget_ms, wait.join_ms, wait.off_pace_ms)
        table.add_row(asked.get(wait.target, "-"), *(f"{value:.1f}" for value in times))
    return table


def main(
    targets: Annotated[int, typer.Option(min=1, help="Number of targets at random intervals.")] = 1000,
    burst: Annotated[int, typer.Option(min=0, help="Number of targets at once, after them.")] = 1000,
    interval_s: Annotated[float, typer.Option(min=0.0, help="Mean interval [s].")] = 0.5,
    seed: Annotated[int, typer.Option(help="Of targets and intervals.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Send targets to a run and measure."""
    found, budgets = measured(targets, burst, interval_s, seed), load_stream().budgets
    command = target_to_command(found.record, budgets, found.pace)
    waits = waits_of(found.record, found.pace)
    states = Counter(one.state for one in found.told)
    answered = np.array([one.answered_ms for one in found.told[:targets]])
    table = Table("", "p50 ms", "p95 ms", "p99 ms", "max ms")
    for name, times in (("target to command", command.time), ("while the machine kept its pace", command.kept)):
        if times is not None:
            table.add_row(name, *(f"{value:.1f}" for value in (times.p50, times.p95, times.p99, times.max)))
    table.add_row("sending to answer", *(f"{np.percentile(answered, share):.1f}" for share in (50, 95, 99, 100)))
    console = Console(width=120)
    console.print(table)
    console.print(slowest(waits, found.told))
    console.print(", ".join(f"{state} {number}" for state, number in sorted(states.items())))
    if csv_out is not None:
        known, none = {wait.target: asdict(wait) for wait in waits}, dict.fromkeys(asdict(waits[0]), "")
        write_csv(csv_out, [none | known.get(one.target, {}) | asdict(one) for one in found.told])
    figures = {
        "targets": targets + burst,
        "followed": sum(states[state] for state in FOLLOWED),
        "target_to_command_ms": None if command.time is None else command.time.model_dump(),
        "kept_pace_ms": None if command.kept is None else command.kept.model_dump(),
        "left_out": command.left_out,
        "answered_p50_ms": float(np.median(answered)),
        "answered_p99_ms": float(np.percentile(answered, 99)),
        "slowest": [asdict(wait) for wait in sorted(waits, key=lambda wait: -wait.total_ms)[:_SLOWEST]],
    }
    return Outcome(verdicts_of(found, targets + burst, command, budgets), figures)
