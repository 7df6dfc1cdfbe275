"""Does the loop notice 10,000 targets a second, and is every one answered or counted?

One run of `flexmotion dry-run --web` takes, in turn, a target every fifth of a second (as often as the robot changes
from one to another), and a flood from a process of its own over one WebSocket: as many as are due, or as many as the
gateway takes, since a full socket makes its sender wait. Beside the answers stand the loop's missed periods and its
lateness, in both parts, from its own rows. The parts take turns, since machines are slower at times.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from websockets.asyncio.client import ClientConnection, connect

from benchmarks.shared.live_run import LiveRun
from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.configs.stream import Gateway, load_stream
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.listening import Listening
from flexmotion.streamer.gateway.ports import any_free

Float = NDArray[np.float64]

SLOW_HZ = 5.0
"""Rate of the part without a flood [1/s]."""
MOST_LATER, LEAST_US = 1.5, 50.0
"""The loop notices if its lateness or its work (99 %) is larger by this factor, and by more than this [µs]."""
_LAST_S = 60.0
"""Longest time from the last target to the last answer [s]."""
_BATCH_S = 0.01


@dataclass(frozen=True)
class Sent:
    """What a sender did.

    Attributes:
        targets, seconds: targets sent, and the time that it took [s].
        states: of the answers.
        last_s: time from the last target to the last answer [s].
    """

    targets: int
    seconds: float
    states: dict[str, int]
    last_s: float


@dataclass(frozen=True)
class Part:
    """A part of the run.

    Attributes:
        kind: "calm" or "flood".
        ticks, missed: periods of the loop, and those missed.
        late_p50_us, late_p99_us, late_max_us: lateness of the loop [µs].
        work_p50_us, work_p99_us: work of a tick [µs].
        targets, answered: sent, and answered.
        rate_hz: targets a second.
    """

    kind: str
    ticks: int
    missed: int
    late_p50_us: float
    late_p99_us: float
    late_max_us: float
    work_p50_us: float
    work_p99_us: float
    targets: int
    answered: int
    rate_hz: float


async def _send(port: int, rate_hz: float, seconds: float, seed: int) -> Sent:
    random, states = np.random.default_rng(seed), Counter[str]()
    async with connect(f"ws://127.0.0.1:{port}/targets", max_size=None) as socket:
        await socket.send(json.dumps({"type": "take", "source": "flood", "id": "take"}))
        reading = asyncio.create_task(_read(socket, states))
        begin, sent = time.perf_counter(), 0
        while (passed := time.perf_counter() - begin) < seconds:
            due = min(int(rate_hz * passed) + 1, int(rate_hz * seconds))
            while sent < due and time.perf_counter() - begin < seconds:
                turning = round(float(random.uniform(-0.4, 0.4)), 2)
                message = {"type": "velocity", "velocity": [0.0, 0.0, turning], "ttl_s": 2.0, "source": "flood"}
                await socket.send(json.dumps(message))  # waits while the socket is full
                sent += 1
                if sent % 50 == 0:
                    await asyncio.sleep(0)  # answers are read
            await asyncio.sleep(_BATCH_S)
        took, ended = time.perf_counter() - begin, time.perf_counter()
        while states.total() < sent and time.perf_counter() < ended + _LAST_S and not reading.done():
            await asyncio.sleep(_BATCH_S)
        last_s = time.perf_counter() - ended
        reading.cancel()
    return Sent(sent, took, dict(states), last_s)


async def _read(socket: ClientConnection, states: Counter[str]) -> None:
    async for frame in socket:
        content = json.loads(frame)
        if content["type"] == "answer" and content.get("id") != "take":
            states[content["state"]] += 1


def send(port: int, rate_hz: float, seconds: float, seed: int) -> Sent:
    """Send targets to turn on the spot at a rate, and read all answers."""
    return asyncio.run(_send(port, rate_hz, seconds, seed))


def part_of(kind: str, rows: Any, sent: Sent) -> Part:
    """A part from the loop's rows."""
    late, work = 1e6 * rows["lateness_s"], 1e6 * rows["work_s"]
    return Part(
        kind,
        ticks=len(rows),
        missed=int(rows["missed_deadlines"][-1] - rows["missed_deadlines"][0]),
        late_p50_us=float(np.percentile(late, 50)),
        late_p99_us=float(np.percentile(late, 99)),
        late_max_us=float(late.max()),
        work_p50_us=float(np.percentile(work, 50)),
        work_p99_us=float(np.percentile(work, 99)),
        targets=sent.targets,
        answered=sum(sent.states.values()),
        rate_hz=sent.targets / sent.seconds,
    )


def measured(rates_hz: Sequence[float], seconds: float, seed: int) -> tuple[list[Part], Counter[str], dict[str, Any]]:
    """Run; returns the parts, the answers to the flood, and the run's report."""
    settings = load_stream()
    ports = {"port": any_free(), "stop_port": any_free()}
    settings = settings.model_copy(update={"gateway": Gateway.model_validate(ports)})
    parts, states = [], Counter[str]()
    with ExitStack() as stack:
        run = stack.enter_context(LiveRun(settings, Listening()))
        # Begun after the run was forked; spawned, so that it is none of the run's copies.
        pool = stack.enter_context(ProcessPoolExecutor(1, get_context("spawn")))
        run.wait_for(State.HOLD, State.STREAMING)
        run.wait_until_it_listens()
        rows = run.session.telemetry.ticks.reader(new_only=True)
        for number, rate_hz in enumerate(rates_hz):
            sending = pool.submit(send, ports["port"], rate_hz, seconds, seed + number)
            taken = []
            while not sending.done():
                taken.append(rows.read())
                time.sleep(0.5)
            sent = sending.result()
            flood = rate_hz > SLOW_HZ
            parts.append(part_of("flood" if flood else "calm", np.concatenate([*taken, rows.read()]), sent))
            if flood:
                states.update(sent.states)
        run.end()
        return parts, states, run.report


def main(
    rate_hz: Annotated[float, typer.Option("--rate", min=SLOW_HZ + 1.0, help="Targets a second.")] = 10_000.0,
    seconds: Annotated[float, typer.Option(min=1.0, help="Length of a part [s].")] = 30.0,
    rounds: Annotated[int, typer.Option(min=1, help="Parts of each kind.")] = 2,
    seed: Annotated[int, typer.Option(help="Of the targets.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Flood a run, and compare with the same run without."""
    parts, states, report = measured([SLOW_HZ, rate_hz] * rounds, seconds, seed)
    table = Table("part", "targets/s", "answered", "missed", "late µs: p50", "p99", "max", "work µs: p50", "p99")
    for one in parts:
        answered = f"{one.answered} of {one.targets}"
        times = (one.late_p50_us, one.late_p99_us, one.late_max_us, one.work_p50_us, one.work_p99_us)
        table.add_row(one.kind, f"{one.rate_hz:.0f}", answered, str(one.missed), *(f"{value:.0f}" for value in times))
    console = Console(width=120)
    console.print(table)
    console.print(", ".join(f"{state} {number}" for state, number in sorted(states.items())))
    if csv_out is not None:
        write_csv(csv_out, [asdict(one) for one in parts])
    middle = {
        kind: {
            name: float(np.median([asdict(one)[name] for one in parts if one.kind == kind]))
            for name in asdict(parts[0])
            if name != "kind"
        }
        for kind in ("calm", "flood")
    }
    targets, answered = (sum(getattr(one, name) for one in parts) for name in ("targets", "answered"))
    missed = {kind: sum(one.missed for one in parts if one.kind == kind) for kind in middle}
    violations, fell = report["limits"]["violations_sent"], report["motion"]["fell"]
    sentence = f"missed periods in a flood {missed['flood']}, without {missed['calm']}"
    verdicts = [
        Verdict(f"answered: {answered} of {targets}", answered == targets),
        Verdict(sentence, missed["flood"] <= missed["calm"]),
        Verdict(f"goals outside the envelope: {violations} (0)", violations == 0),
        Verdict(f"fell: {fell}", not fell),
    ]
    for name, what in (("late_p99_us", "lateness"), ("work_p99_us", "work of a tick")):
        calm, flood = middle["calm"][name], middle["flood"][name]
        kept = flood <= max(MOST_LATER * calm, calm + LEAST_US)
        sentence = f"{what}, p99: {flood:.0f} µs in a flood, {calm:.0f} µs without (x {MOST_LATER:g})"
        verdicts.append(Verdict(sentence, kept))
    return Outcome(verdicts, {**middle, "answers": dict(states), "missed": missed, "rate_asked_hz": rate_hz})
