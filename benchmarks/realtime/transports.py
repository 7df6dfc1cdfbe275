"""Does every transport answer every target, and how soon is its emergency stop at the driver, with the gateway stopped?

One run on the simulated robot in real time takes targets over each transport in turn; all must be answered. Then, for
each transport, runs in which the gateway's process is stopped (SIGSTOP), and an emergency stop is sent while the robot
moves. Its time counts from the call that sends it to the tick from which on the goals no longer move. Gamepad and
keyboard send no message that carries an answer's address: the gateway's counts must agree. A zenoh router is started
for ROS 2. Meant for an otherwise idle machine.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.shared.hand_operators import OverGamepad, OverKeyboard
from benchmarks.shared.live_run import LiveRun
from benchmarks.shared.network_operators import OverHttp, OverRos2, OverWebSocket, OverZenoh
from benchmarks.shared.operators import Operator, Place
from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.configs.errors import DriverError
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow

OPERATORS: dict[str, Callable[[Place, ExitStack], Operator]] = {
    one.name: one for one in (OverWebSocket, OverHttp, OverZenoh, OverRos2, OverGamepad, OverKeyboard)
}
"""By the name of the transport."""
PERIODS = 2.0
"""Bound of the time to the driver, in periods of the loop."""
_STILL_TICKS = 5
_SETTLED_S = 0.5


@dataclass(frozen=True)
class Sent:
    """What became of the targets over one transport; times from sending to the answer [ms], NaN without one."""

    transport: str
    targets: int
    answered: int
    states: str
    p50_ms: float
    p99_ms: float


@dataclass(frozen=True)
class Stopped:
    """One emergency stop: time to the first tick at which it acts, in periods of the loop."""

    transport: str
    periods: float


def targets_over(operator: Operator, number: int, interval_s: float, random: Any) -> Sent:
    """Send targets at random intervals over one transport, and wait for their answers."""
    operator.take()
    for _ in range(number):
        operator.send(round(float(random.uniform(-0.4, 0.4)), 2))
        time.sleep(float(random.uniform(0.5, 1.5)) * interval_s)
    states, times = operator.answers(number)
    shares = np.percentile(times, (50, 99)) if times else (np.nan, np.nan)
    told = ", ".join(f"{state} {count}" for state, count in sorted(states.items()))
    return Sent(operator.name, operator.sent, sum(states.values()), told, float(shares[0]), float(shares[1]))


def estop_over(name: str, moment_s: float) -> Stopped:
    """Start a run, let it move, stop its gateway, and send an emergency stop."""
    with ExitStack() as stack:
        place = Place.free(stack)
        run = stack.enter_context(LiveRun(place.settings, place.listening))
        run.wait_for(State.HOLD, State.STREAMING)
        place.wait()
        operator = OPERATORS[name](place, stack)
        operator.take()
        operator.send(0.4)
        time.sleep(moment_s)
        run.stop_process("fm-gateway")
        began_ns = time.perf_counter_ns()
        operator.estop()
        time.sleep(_SETTLED_S)
        acted_ns = _acted_ns(run, began_ns)
        return Stopped(operator.name, (acted_ns - began_ns) * 1e-9 * run.session.robot.rate_hz)


def _acted_ns(run: LiveRun, since_ns: int) -> int:
    """When the goals that no longer move were sent first."""
    ticks = run.session.telemetry.ticks
    rows = [TickRow(row) for row in ticks.reader().read()]
    rows = [row for row in rows if int(row.stamp_ns) >= since_ns - 50_000_000]
    before = [row for row in rows if int(row.stamp_ns) < since_ns]
    if len(before) < 2 or (before[0].q_cmd == before[-1].q_cmd).all():
        raise DriverError("the goals did not move before the emergency stop: it measures nothing")
    for number, row in enumerate(rows[:-_STILL_TICKS]):
        same = all((rows[number + ahead].q_cmd == row.q_cmd).all() for ahead in range(1, _STILL_TICKS))
        if same and int(row.stamp_ns) >= since_ns:
            return int(row.stamp_ns)
    raise DriverError("the goals still move half a second after the emergency stop")


def main(
    targets: Annotated[int, typer.Option(min=1, help="Number of targets over each transport.")] = 200,
    interval_s: Annotated[float, typer.Option(min=0.0, help="Mean interval [s].")] = 0.3,
    stops: Annotated[int, typer.Option(min=0, help="Emergency stops over each transport.")] = 5,
    only: Annotated[list[str] | None, typer.Option(help="Transports; all without.")] = None,
    seed: Annotated[int, typer.Option(help="Of targets, intervals and moments.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Send targets and emergency stops over each transport."""
    random = np.random.default_rng(seed)
    chosen = {name: make for name, make in OPERATORS.items() if not only or name in only}
    sent: list[Sent] = []
    with ExitStack() as stack:
        place = Place.free(stack)
        run = stack.enter_context(LiveRun(place.settings, place.listening))
        run.wait_for(State.HOLD, State.STREAMING)
        place.wait()
        for make in track(chosen.values(), "targets", console=Console(stderr=True)):
            sent.append(targets_over(make(place, stack), targets, interval_s, random))
        run.end()
        report = run.report
    # Each in a process of its own: a run is forked, which a process with threads of zenoh must not be.
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as pool:
        moments = [(name, float(random.uniform(0.5, 1.5))) for name in chosen for _ in range(stops)]
        planned = [pool.submit(estop_over, name, moment_s) for name, moment_s in moments]
        pressed = []
        for (name, _), stopped in zip(moments, track(planned, "stops", console=Console(stderr=True)), strict=True):
            try:
                pressed.append(stopped.result())
            except (DriverError, TimeoutError) as error:  # of one run; the others are measured
                Console(stderr=True).print(f"{name}: not measured: {error}", markup=False)
    missing = len(moments) - len(pressed)
    table = Table("transport", "targets", "answered", "", "p50 ms", "p99 ms", "E-STOP periods: median", "longest")
    for one in sent:
        own = [stop.periods for stop in pressed if stop.transport == one.transport] or [np.nan]
        table.add_row(
            one.transport,
            str(one.targets),
            str(one.answered),
            one.states,
            f"{one.p50_ms:.1f}",
            f"{one.p99_ms:.1f}",
            f"{np.median(own):.2f}",
            f"{max(own):.2f}",
        )
    Console(width=120).print(table)
    if csv_out is not None:
        write_csv(csv_out, [asdict(one) for one in sent])
    late = Counter(stop.transport for stop in pressed if stop.periods > PERIODS)
    verdicts = [
        Verdict(f"{one.transport}: answered {one.answered} of {one.targets}", one.answered == one.targets)
        for one in sent
    ]
    verdicts.append(Verdict(f"emergency stops later than {PERIODS:g} periods: {dict(late) or 'none'}", not late))
    verdicts.append(Verdict(f"emergency stops that were not measured: {missing} (0)", missing == 0))
    verdicts.append(Verdict(f"fell: {report['motion']['fell']}", not report["motion"]["fell"]))
    figures = {one.transport: asdict(one) for one in sent}
    return Outcome(verdicts, {"transports": figures, "estop_periods": [asdict(stop) for stop in pressed]})
