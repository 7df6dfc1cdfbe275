"""Cycle time of the Dynamixel driver over calculated wire time, beside the bare SDK and rustypot on the same bus.

A cycle writes goals to all servos of OP3 (without its IMU) and reads all of them, on an emulated bus that takes its
time at the baud rate. Emulator and client get a processor each, with realtime scheduling where the system grants it.

    python benchmarks/bus.py --cycles 500
"""

from __future__ import annotations

import argparse
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
from pathlib import Path

import numpy as np
import rustypot
import yaml
from dynamixel_sdk import GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler

from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.dynamixel.bus import DynamixelBus
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.registry import create

GOAL, PRESENT, READ_SIZE = 116, 126, 10
BITS_A_BYTE = 10
WRITE_OVERHEAD, READ_REQUEST, FAST_ROW, STATUS = 14, 14, 4, 11


def robot_at(baud: int, folder: Path) -> Robot:
    """OP3 without IMU, its bus at a baud rate, with time for what a slow one takes."""
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
    """The robot's bus on a bench behind `link`; yields a dictionary that has the emulator's figures in the end."""
    command = [sys.executable, "-m", "flexmotion.streamer", "emulate", "--bench", "--json"]
    process = subprocess.Popen(
        [*command, "--robot", str(robot.folder), "--port-link", str(link)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    figures: dict[str, float] = {}
    try:
        for _ in range(300):
            if link.exists():
                break
            time.sleep(0.1)
        time.sleep(1.0)
        yield figures
    finally:
        process.send_signal(signal.SIGTERM)
        output, _ = process.communicate(timeout=20)
        figures.update(json.loads(output))


@contextmanager
def own_processor() -> Iterator[None]:
    """Within, this process runs under SCHED_FIFO on the first processor, where that is granted."""
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


def timed(cycle: Callable[[], bool], cycles: int) -> tuple[np.ndarray, int]:
    """Seconds that every good cycle took, and how many went wrong."""
    took, bad = [], 0
    for _ in range(cycles):
        begin = time.perf_counter()
        good = cycle()
        took.append(time.perf_counter() - begin)
        bad += not good
        time.sleep(0.002)
    return np.array(took), bad


def driver_cycles(robot: Robot, port: str, cycles: int) -> tuple[np.ndarray, int, float]:
    """Our driver."""
    state, command = RobotState(robot.n), JointCommand(robot.n)
    with create("dynamixel", robot, port=port) as driver:
        driver.read(state)
        command.position[:] = state.position
        driver.set_torque(True)

        def cycle() -> bool:
            driver.write(command)
            driver.read(state)
            return not state.stale.any()

        took, bad = timed(cycle, cycles)
    return took, bad, DynamixelBus.budget(robot, "main").cycle_s


def sdk_cycles(robot: Robot, port: str, cycles: int, *, fast: bool) -> tuple[np.ndarray, int, float]:
    """The SDK's own group calls on its own port."""
    baud, ids = robot.config.buses["main"].baud, [joint.id for joint in robot.joints]
    handler, line = PacketHandler(2.0), PortHandler(port)
    line.setBaudRate(baud)
    write, read = GroupSyncWrite(line, handler, GOAL, 4), GroupSyncRead(line, handler, PRESENT, READ_SIZE)
    for id_ in ids:
        write.addParam(id_, [0, 8, 0, 0])
        read.addParam(id_)

    def cycle() -> bool:
        write.txPacket()
        return (read.fastSyncRead() if fast else read.txRxPacket()) == 0

    took, bad = timed(cycle, cycles)
    line.closePort()
    return took, bad, wire_s(len(ids), baud, fast=fast)


def rustypot_cycles(robot: Robot, port: str, cycles: int, *, fast: bool) -> tuple[np.ndarray, int, float]:
    """The controller of rustypot."""
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

    took, bad = timed(cycle, cycles)
    client.close()
    return took, bad, wire_s(len(ids), baud, fast=fast)


def wire_s(servos: int, baud: int, *, fast: bool) -> float:
    """Wire time of a sync write of 4 bytes and a read of 10."""
    write = WRITE_OVERHEAD + servos * 5
    request = READ_REQUEST + servos
    reply = 8 + servos * (READ_SIZE + FAST_ROW) if fast else servos * (READ_SIZE + STATUS)
    return (write + request + reply) * BITS_A_BYTE / baud


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=500)
    parser.add_argument("--baud", type=int, action="append", help="repeatable; 1 M and 4 M if not given")
    arguments = parser.parse_args()
    print(f"{'client':24} {'baud':>8} {'wire ms':>8} {'median ms':>9} {'p99 ms':>8} {'median/wire':>11} {'bad':>4}")
    with tempfile.TemporaryDirectory() as folder:
        for baud in arguments.baud or (1_000_000, 4_000_000):
            robot = robot_at(baud, Path(folder))
            link = Path(folder) / f"bus{baud}"
            # In this order: the emulator must not inherit it.
            with emulated(robot, link) as figures, own_processor():
                for name, run in (
                    ("dynamixel driver", driver_cycles),
                    ("sdk, fast sync read", lambda *a: sdk_cycles(*a, fast=True)),
                    ("sdk, sync read", lambda *a: sdk_cycles(*a, fast=False)),
                    ("rustypot, fast sync read", lambda *a: rustypot_cycles(*a, fast=True)),
                    ("rustypot, sync read", lambda *a: rustypot_cycles(*a, fast=False)),
                ):
                    took, bad, wire = run(robot, str(link), arguments.cycles)
                    median, p99 = np.percentile(took, [50, 99])
                    print(
                        f"{name:24} {baud:8} {wire * 1e3:8.3f} {median * 1e3:9.3f} {p99 * 1e3:8.3f} "
                        f"{median / wire:11.3f} {bad:4}",
                        flush=True,
                    )
            print(f"emulator: {100 * figures['processor_share']:.0f} % of a processor", flush=True)


if __name__ == "__main__":
    main()
