"""How long does a bus cycle take with the Dynamixel driver, the bare SDK and rustypot, and how much processor time?

A cycle writes goals to all servos of OP3 and reads all of them, on an emulated bus with the timing of its baud rate.
The driver's cycle has everything that a run needs: position, speed, current, voltage, temperature, hardware error,
millisecond counter and torque switch of every servo, the IMU, and all checks of `docs/drivers.md`. The bare SDK and
rustypot read position, speed and current, check nothing, and read no IMU; rustypot is also timed with the same bytes
as the driver, and so are the system calls alone that Python needs for them, with nothing decoded or checked. All
clients have the port open and take turns of a few cycles, of which the first is not counted: what else this machine
does meets all of them alike. Processor time is that of the client's thread. Emulator and clients get a processor each,
with realtime scheduling where the system grants it.
"""

from __future__ import annotations

import fcntl
import json
import math
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import rustypot
import typer
import yaml
from dynamixel_sdk import GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler
from rich.console import Console
from rich.table import Table

from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.dynamixel.bus import DynamixelBus
from flexmotion.drivers.dynamixel.exchange import ReadMany, ReadOne
from flexmotion.drivers.dynamixel.goals import sync_write
from flexmotion.drivers.dynamixel.layout import Span, layout_of
from flexmotion.drivers.dynamixel.opencr import board_of
from flexmotion.drivers.dynamixel.registers import table_of
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.registry import create

GOAL, PRESENT, READ_SIZE = 116, 126, 10
BITS_A_BYTE = 10
WRITE_OVERHEAD, READ_REQUEST, FAST_ROW, STATUS = 14, 14, 4, 11
"""Bytes of a sync write and of a read request without their rows, of a row of a fast reply, of a status packet."""
BAUDS = (1_000_000, 2_000_000, 4_000_000)
START_S, SETTLE_S, STOP_S = 90.0, 1.0, 20.0
"""Longest time for the emulator's start, time after it, longest time for its end [s]."""
PATIENCE_S = 0.02
"""Longest wait for a part of an answer [s]."""
PAUSE_S = 0.002
"""Between two cycles [s]."""
TURN = 5
"""Cycles of a turn that are counted. The one before them is not: caches and, in the driver, the servos' counters belong
to another client, or are old."""
WATCHDOG_MS = 200
"""Of the servos: as long as they may be, since clients take turns [ms]."""

OURS, YARDSTICK = "dynamixel driver", "rustypot, fast sync read"
MOST_PROCESSOR, MOST_WIRE = 2.3, {1_000_000: 1.15, 2_000_000: 1.15}
"""Greatest processor time of the driver's cycle over that of rustypot, and greatest cycle over wire, by baud rate."""


@dataclass
class Client:
    """One client and its cycles so far.

    Attributes:
        name: of the client.
        cycle: writes and reads once; whether it succeeded.
        wire_s: time of a cycle on the wire [s].
        took, processor: duration and processor time of each cycle [s].
        failed: cycles that did not succeed.
    """

    name: str
    cycle: Callable[[], bool]
    wire_s: float
    took: list[float] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)
    failed: int = 0

    def run(self) -> None:
        """One turn."""
        self.cycle()
        for _ in range(TURN):
            time.sleep(PAUSE_S)
            begin, spent = time.perf_counter(), time.thread_time()
            good = self.cycle()
            self.processor.append(time.thread_time() - spent)
            self.took.append(time.perf_counter() - begin)
            self.failed += not good

    def figures(self, baud: int, yardstick: Client) -> dict[str, Any]:
        """Figures of its cycles; processor time also over that of another client."""
        median, p99 = np.percentile(self.took, [50, 99])
        processor, p90, processor_p99 = 1e6 * np.percentile(self.processor, [50, 90, 99])
        return {
            "client": self.name,
            "baud": baud,
            "wire_ms": 1e3 * self.wire_s,
            "median_ms": 1e3 * float(median),
            "p99_ms": 1e3 * float(p99),
            "median_over_wire": float(median) / self.wire_s,
            "processor_us": float(processor),
            "processor_p90_us": float(p90),
            "processor_p99_us": float(processor_p99),
            "processor_ratio": float(np.median(self.processor) / np.median(yardstick.processor)),
            "failed": self.failed,
        }


def robot_at(baud: int, folder: Path) -> Robot:
    """OP3 with its bus at a baud rate, and with a loop rate that a slow bus keeps up with."""
    place = folder / f"op3_{baud}"
    shutil.copytree(ROBOTS / "op3", place)
    file = place / "op3.yaml"
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    content["rate_hz"] = 60
    content["buses"]["main"] |= {"baud": baud, "watchdog_ms": WATCHDOG_MS}
    file.rename(place / "robot.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return load_robot(place)


@contextmanager
def emulated(robot: Robot, link: Path) -> Iterator[dict[str, float]]:
    """The robot's bus on a bench behind `link`; yields a dictionary that holds the emulator's figures after the end.

    Raises:
        TimeoutError: the emulator did not start.
    """
    command = [sys.executable, "-m", "flexmotion.streamer", "emulate", "--bench", "--json"]
    process = subprocess.Popen(
        [*command, "--robot", str(robot.folder), "--port-link", str(link)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    figures: dict[str, float] = {}
    deadline = time.monotonic() + START_S
    try:
        while not link.exists():
            if time.monotonic() > deadline:
                raise TimeoutError(f"the emulator did not start within {START_S:g} s")
            time.sleep(0.1)
        time.sleep(SETTLE_S)
        yield figures
    finally:
        process.send_signal(signal.SIGTERM)
        output, _ = process.communicate(timeout=STOP_S)
    figures.update(json.loads(output))


@contextmanager
def own_processor() -> Iterator[None]:
    """Run this process under SCHED_FIFO on the first processor within the context, where the system grants it."""
    everywhere = os.sched_getaffinity(0)
    with suppress(PermissionError):
        os.sched_setaffinity(0, {min(everywhere)})
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
    try:
        yield
    finally:
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            os.sched_setaffinity(0, everywhere)


@contextmanager
def clients(robot: Robot, port: str) -> Iterator[list[Client]]:
    """All clients, with the same port open."""
    with ExitStack() as stack:
        driver = stack.enter_context(create("dynamixel", robot, port=port))
        assert isinstance(driver, BusDriver)
        state, command = RobotState(robot.n), JointCommand(robot.n)
        driver.read(state)
        command.position[:] = state.position
        driver.set_torque(True)
        goals = robot.to_ticks(command.position).astype(int).tolist()

        # The driver is the first to open the port. It gives up its lock on it, and afterwards the settings of the
        # terminal, which belong to all clients, are its own again.
        descriptor = driver.buses[0].port.descriptor
        fcntl.flock(descriptor, fcntl.LOCK_UN)
        settings = termios.tcgetattr(descriptor)
        others = [*sdk_clients(robot, port, goals, stack), *rustypot_clients(robot, port, goals)]
        others.append(bare_client(robot, port, goals, stack))
        termios.tcsetattr(descriptor, termios.TCSANOW, settings)

        def cycle() -> bool:
            driver.write(command)
            driver.read(state)
            return not state.stale.any() and state.imu_stale == 0

        yield [Client(OURS, cycle, DynamixelBus.budget(robot, "main").cycle_s), *others]


def sdk_clients(robot: Robot, port: str, goals: Sequence[int], stack: ExitStack) -> Iterator[Client]:
    """The SDK's own group calls on its own port."""
    baud, ids = robot.config.buses["main"].baud, [joint.id for joint in robot.joints]
    handler, line = PacketHandler(2.0), PortHandler(port)
    line.setBaudRate(baud)
    stack.callback(line.closePort)
    write, read = GroupSyncWrite(line, handler, GOAL, 4), GroupSyncRead(line, handler, PRESENT, READ_SIZE)
    for id_, goal in zip(ids, goals, strict=True):
        write.addParam(id_, list(goal.to_bytes(4, "little")))
        read.addParam(id_)

    def cycle(*, fast: bool) -> bool:
        write.txPacket()
        try:
            return bool((read.fastSyncRead() if fast else read.txRxPacket()) == 0)
        except IndexError:  # a reply that is cut short
            return False

    yield Client("sdk, fast sync read", lambda: cycle(fast=True), wire_s(len(ids), baud, fast=True))
    yield Client("sdk, sync read", lambda: cycle(fast=False), wire_s(len(ids), baud, fast=False))


def rustypot_clients(robot: Robot, port: str, goals: list[int]) -> Iterator[Client]:
    """Cycles of rustypot's controller."""
    baud, ids = robot.config.buses["main"].baud, [joint.id for joint in robot.joints]
    controller = rustypot.Xl430PyController(port, baud, 0.02)
    span = layout_of(table_of(robot.servos[0].name), current_bound=False).read
    board = board_of(robot, "main")
    assert board is not None

    def cycle(address: int, size: int, *, fast: bool, imu: bool = False) -> bool:
        controller.set_fast_sync_read(fast)
        try:
            controller.sync_write_goal_position(ids, goals)
            controller.sync_read_raw_data(ids, address, size)
            if imu:
                controller.read_raw_data(board.id, board.span.address, board.span.size)
        except (RuntimeError, OSError):
            return False
        return True

    yield Client(YARDSTICK, lambda: cycle(PRESENT, READ_SIZE, fast=True), wire_s(len(ids), baud, fast=True))
    yield Client(
        "rustypot, sync read", lambda: cycle(PRESENT, READ_SIZE, fast=False), wire_s(len(ids), baud, fast=False)
    )
    yield Client(
        "rustypot, the driver's bytes",
        lambda: cycle(span.address, span.size, fast=True, imu=True),
        DynamixelBus.budget(robot, "main").cycle_s,
    )


def bare_client(robot: Robot, port: str, goals: Sequence[int], stack: ExitStack) -> Client:
    """The driver's bytes, made once: what is left of a cycle in Python if nothing is computed in it."""
    ids, board = [joint.id for joint in robot.joints], board_of(robot, "main")
    assert board is not None
    span = layout_of(table_of(robot.servos[0].name), current_bound=False).read
    rows = b"".join(bytes([id_]) + goal.to_bytes(4, "little") for id_, goal in zip(ids, goals, strict=True))
    packet = sync_write(Span(GOAL, 4), rows)
    exchanges = ReadMany(ids, span, fast=True, where="main"), ReadOne(board.id, board.span)
    reads = [(exchange.begin(), exchange.sizes[1]) for exchange in exchanges]
    line = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    stack.callback(os.close, line)

    def cycle() -> bool:
        os.write(line, packet)
        for request, left in reads:
            os.write(line, request)
            while left > 0:
                if not select.select((line,), (), (), PATIENCE_S)[0]:
                    return False
                left -= len(os.read(line, left))
        return True

    return Client("python, the driver's bytes", cycle, DynamixelBus.budget(robot, "main").cycle_s)


def wire_s(servos: int, baud: int, *, fast: bool) -> float:
    """Time on the wire of a sync write of 4 bytes and a read of 10 [s]."""
    write = WRITE_OVERHEAD + servos * 5
    request = READ_REQUEST + servos
    reply = 8 + servos * (READ_SIZE + FAST_ROW) if fast else servos * (READ_SIZE + STATUS)
    return (write + request + reply) * BITS_A_BYTE / baud


def verdicts(figures: dict[str, Any]) -> list[Verdict]:
    """The driver's processor time, and its cycle over the time on the wire."""
    ours = [own for own in figures.values() if isinstance(own, dict) and own["client"] == OURS]
    found = []
    for own in ours:
        at, ratio, over = f"{own['baud'] / 1e6:g} M", own["processor_ratio"], own["median_over_wire"]
        found.append(
            Verdict(f"processor time at {at}: {ratio:.2f} x rustypot's <= {MOST_PROCESSOR}", ratio <= MOST_PROCESSOR)
        )
        if own["baud"] in MOST_WIRE:
            most = MOST_WIRE[own["baud"]]
            found.append(Verdict(f"cycle at {at}: {over:.2f} x the time on the wire <= {most}", over <= most))
    return found


def main(
    cycles: Annotated[int, typer.Option(min=10, help="Of each client.")] = 300,
    baud: Annotated[list[int] | None, typer.Option(help="Baud rate; may be given again [1 M, 2 M and 4 M].")] = None,
) -> Outcome:
    """Time every client at every baud rate."""
    figures: dict[str, Any] = {}
    table = Table(title="Bus cycles: write to and read from all servos")
    for name in (
        "client",
        "baud",
        "wire ms",
        "median ms",
        "p99 ms",
        "/ wire",
        "processor us",
        "p90 us",
        "ratio",
        "bad",
    ):
        table.add_column(name, justify="left" if name == "client" else "right")
    with tempfile.TemporaryDirectory() as folder:
        for rate in baud or BAUDS:
            robot, link = robot_at(rate, Path(folder)), Path(folder) / f"bus{rate}"
            # In this order: the emulator must not inherit the scheduling.
            with emulated(robot, link) as emulator, clients(robot, str(link)) as taking_turns, own_processor():
                for _ in range(math.ceil(cycles / TURN)):
                    for client in taking_turns:
                        client.run()
            yardstick = next(client for client in taking_turns if client.name == YARDSTICK)
            for client in taking_turns:
                own = figures[f"{client.name}, {rate}"] = client.figures(rate, yardstick)
                times = (f"{own[name]:.3f}" for name in ("wire_ms", "median_ms", "p99_ms", "median_over_wire"))
                spent = f"{own['processor_us']:.0f}", f"{own['processor_p90_us']:.0f}", f"{own['processor_ratio']:.2f}"
                table.add_row(client.name, str(rate), *times, *spent, str(client.failed))
            figures[f"processor_share_{rate}"] = emulator["processor_share"]
    Console(width=140).print(table)
    return Outcome(verdicts(figures), figures)
