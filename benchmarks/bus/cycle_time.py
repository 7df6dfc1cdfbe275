"""How long does a bus cycle take with the Dynamixel driver, the bare SDK and rustypot, over the time on the wire?

A cycle writes goals to all servos of OP3 (without its IMU) and reads all of them, on an emulated bus with the timing of
its baud rate. Emulator and client get a processor each, with realtime scheduling where the system grants it.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import rustypot
import typer
import yaml
from dynamixel_sdk import GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.shared.outcome import Outcome
from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.dynamixel.bus import DynamixelBus
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.registry import create

GOAL, PRESENT, READ_SIZE = 116, 126, 10
BITS_A_BYTE = 10
WRITE_OVERHEAD, READ_REQUEST, FAST_ROW, STATUS = 14, 14, 4, 11
"""Bytes of a sync write and of a read request without their rows, of a row of a fast reply, of a status packet."""
BAUDS = (1_000_000, 4_000_000)
START_S, SETTLE_S, STOP_S = 30.0, 1.0, 20.0
"""Longest time for the emulator's start, time after it, longest time for its end [s]."""
PAUSE_S = 0.002
"""Between two cycles [s]."""


@dataclass(frozen=True)
class Cycles:
    """Cycles of one client: their durations, (N,) [s], how many failed, and the time on the wire [s]."""

    took: NDArray[np.float64]
    failed: int
    wire_s: float

    def figures(self, client: str, baud: int) -> dict[str, Any]:
        """Figures of them."""
        median, p99 = np.percentile(self.took, [50, 99])
        return {
            "client": client,
            "baud": baud,
            "wire_ms": 1e3 * self.wire_s,
            "median_ms": 1e3 * float(median),
            "p99_ms": 1e3 * float(p99),
            "median_over_wire": float(median) / self.wire_s,
            "failed": self.failed,
        }


def robot_at(baud: int, folder: Path) -> Robot:
    """OP3 without IMU, its bus at a baud rate, with a loop rate that a slow bus keeps up with."""
    place = folder / f"op3_{baud}"
    shutil.copytree(ROBOTS / "op3", place)
    file = place / "op3.yaml"
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    content.pop("imu")
    content["rate_hz"] = 60
    content["buses"]["main"]["baud"] = baud
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


def timed(cycle: Callable[[], bool], cycles: int, wire_s: float) -> Cycles:
    """Run a cycle, which returns whether it succeeded, many times."""
    took, failed = [], 0
    for _ in range(cycles):
        begin = time.perf_counter()
        good = cycle()
        took.append(time.perf_counter() - begin)
        failed += not good
        time.sleep(PAUSE_S)
    return Cycles(np.array(took), failed, wire_s)


def driver_cycles(robot: Robot, port: str, cycles: int) -> Cycles:
    """Cycles of the project's driver."""
    state, command = RobotState(robot.n), JointCommand(robot.n)
    with create("dynamixel", robot, port=port) as driver:
        driver.read(state)
        command.position[:] = state.position
        driver.set_torque(True)

        def cycle() -> bool:
            driver.write(command)
            driver.read(state)
            return not state.stale.any()

        return timed(cycle, cycles, DynamixelBus.budget(robot, "main").cycle_s)


def sdk_cycles(robot: Robot, port: str, cycles: int, *, fast: bool) -> Cycles:
    """Cycles of the SDK's own group calls on its own port."""
    baud, ids = robot.config.buses["main"].baud, [joint.id for joint in robot.joints]
    handler, line = PacketHandler(2.0), PortHandler(port)
    line.setBaudRate(baud)
    write, read = GroupSyncWrite(line, handler, GOAL, 4), GroupSyncRead(line, handler, PRESENT, READ_SIZE)
    for id_ in ids:
        write.addParam(id_, [0, 8, 0, 0])
        read.addParam(id_)

    def cycle() -> bool:
        write.txPacket()
        return bool((read.fastSyncRead() if fast else read.txRxPacket()) == 0)

    found = timed(cycle, cycles, wire_s(len(ids), baud, fast=fast))
    line.closePort()
    return found


def rustypot_cycles(robot: Robot, port: str, cycles: int, *, fast: bool) -> Cycles:
    """Cycles of rustypot's controller."""
    baud, ids = robot.config.buses["main"].baud, [joint.id for joint in robot.joints]
    client = rustypot.Xl430PyController(port, baud, 0.02)
    client.set_fast_sync_read(fast)
    goals = [2048] * len(ids)

    def cycle() -> bool:
        try:
            client.sync_write_goal_position(ids, goals)
            client.sync_read_raw_data(ids, PRESENT, READ_SIZE)
        except (RuntimeError, OSError):
            return False
        return True

    found = timed(cycle, cycles, wire_s(len(ids), baud, fast=fast))
    client.close()
    return found


def wire_s(servos: int, baud: int, *, fast: bool) -> float:
    """Time on the wire of a sync write of 4 bytes and a read of 10 [s]."""
    write = WRITE_OVERHEAD + servos * 5
    request = READ_REQUEST + servos
    reply = 8 + servos * (READ_SIZE + FAST_ROW) if fast else servos * (READ_SIZE + STATUS)
    return (write + request + reply) * BITS_A_BYTE / baud


CLIENTS: dict[str, Callable[[Robot, str, int], Cycles]] = {
    "dynamixel driver": driver_cycles,
    "sdk, fast sync read": partial(sdk_cycles, fast=True),
    "sdk, sync read": partial(sdk_cycles, fast=False),
    "rustypot, fast sync read": partial(rustypot_cycles, fast=True),
    "rustypot, sync read": partial(rustypot_cycles, fast=False),
}


def main(
    cycles: Annotated[int, typer.Option(min=10, help="Of each client.")] = 500,
    baud: Annotated[list[int] | None, typer.Option(help="Baud rate; may be given again [1 M and 4 M].")] = None,
) -> Outcome:
    """Time every client at every baud rate."""
    figures: dict[str, Any] = {}
    table = Table(title="Bus cycles: write to and read from all servos")
    for name in ("client", "baud", "wire ms", "median ms", "p99 ms", "median / wire", "failed"):
        table.add_column(name, justify="left" if name == "client" else "right")
    with tempfile.TemporaryDirectory() as folder:
        for rate in baud or BAUDS:
            robot, link = robot_at(rate, Path(folder)), Path(folder) / f"bus{rate}"
            # In this order: the emulator must not inherit the scheduling.
            with emulated(robot, link) as emulator, own_processor():
                for client, run in CLIENTS.items():
                    own = run(robot, str(link), cycles).figures(client, rate)
                    figures[f"{client}, {rate}"] = own
                    times = (f"{own[name]:.3f}" for name in ("wire_ms", "median_ms", "p99_ms", "median_over_wire"))
                    table.add_row(client, str(rate), *times, str(own["failed"]))
            figures[f"processor_share_{rate}"] = emulator["processor_share"]
    Console(width=120).print(table)
    return Outcome(figures=figures)
