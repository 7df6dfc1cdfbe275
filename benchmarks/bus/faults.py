"""Fault campaign on the emulated bus: random bad packets for minutes, and every single fault of `docs/faults.md`.

The robot walks a clip in lockstep, the real driver speaking in bytes; goals outside the envelope are counted where the
bytes arrive. Exit code 1 where bad packets end a run, pass a goal outside the envelope, or cost more than 10 % of the
tracking.

    python benchmarks/bus_faults.py --clip walk.bvh --minutes 10
"""

from __future__ import annotations

import argparse
import logging
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.lockstep import LockstepBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.registry import create
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.run_trace import Event, RunTrace
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.session import Session

FAULT_AT = 3.0
FAULTS = (
    *("cable", "port", "lost", "corrupt", "truncated", "late", "late:0.009", "duplicated"),
    *("dead:4", "dead:14", "dead:200", "overheat:4", "overheat:14", "reset:4", "reset:14", "voltage:9.5", "imu"),
)


@dataclass(frozen=True)
class Result:
    """A run.

    Attributes:
        record: of the loop; `body` the robot, as it was left.
        packets, spoilt: sent by the host, and damaged either way.
        refused: goals that left past the limits which the servos told (`flexmotion.drivers.bus.goal_guard`).
    """

    record: RunTrace
    body: SimBody
    packets: int
    spoilt: int
    refused: int

    @property
    def squared_error(self) -> tuple[float, int]:
        """Of the measured legs against their reference, and over how many values [rad²]."""
        error = (self.record.q - self.record.q_ref)[:, 8:]
        known = error[np.isfinite(error).all(axis=1)]
        return float((known**2).sum()), known.size

    @property
    def faults(self) -> list[str]:
        """What was latched."""
        return [event.message for event in self.record.events if event.kind == "fault"]


def run(
    robot: Robot, clip: Path | None, *, fault: str | None = None, bad_packets: float = 0.0, seed: int = 0
) -> Result:
    """One run of the clip."""
    settings = load_stream(None)
    motion = choose_motion(clip)
    body = SimBody(robot)
    faults = [] if fault is None else [Fault.parse(f"{fault}@{FAULT_AT}")]
    world = Loopback(body, faults=faults, bad_packets=bad_packets, seed=seed)
    real = create("dynamixel", robot, port="main")
    driver = LockstepBus(real, world, body)
    record = Session(robot, driver, ClipSource(motion), settings, None).run("lockstep")
    line = world.emulator.lines[0]
    return Result(record, body, line.bus.received, sum(line.damage.spoilt.values()), real.violations)


def campaign(robot: Robot, clip: Path | None, share: float, minutes: float) -> bool:
    """Runs with random bad packets, beside the clean run; whether they did no harm."""
    total, count, seconds, packets, spoilt, violations, falls = 0.0, 0, 0.0, 0, 0, 0, 0
    faults: list[str] = []
    clean_total, clean_count = run(robot, clip).squared_error
    seed = 0
    while seconds < 60 * minutes:
        result = run(robot, clip, bad_packets=share, seed=seed)
        squares, values = result.squared_error
        total, count, seed = total + squares, count + values, seed + 1
        seconds += len(result.record.q) / robot.rate_hz
        packets, spoilt = packets + result.packets, spoilt + result.spoilt
        violations += result.body.receiver.violations + result.refused
        falls += result.body.fell
        faults += result.faults
    ratio = np.sqrt(total / count) / np.sqrt(clean_total / clean_count)
    print(f"{share:.1%} bad packets for {seconds / 60:.1f} min: {packets} sent, {spoilt} spoilt either way")
    print(
        f"faults {len(faults)}, falls {falls}, goals outside the envelope {violations}, tracking {ratio:.3f} of clean"
    )
    return not faults and not falls and not violations and ratio <= 1.1


def single(robot: Robot, clip: Path | None, fault: str) -> None:
    """One fault while walking, and what came of it."""
    result = run(robot, clip, fault=fault)
    on = next(event.tick for event in result.record.events if "READY" in event.message)

    def when(event: Event) -> float:
        return (event.tick - on) / robot.rate_hz - FAULT_AT

    after = [event for event in result.record.events if when(event) >= 0]
    story = "; ".join(f"{when(event):.3f} s {event.message}" for event in after)
    violations = result.body.receiver.violations
    print(f"{fault:12} violations {violations}, torque on at {int(result.body.plant.enabled.sum())} servos: {story}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clip", type=Path, help="motion file; the shipped clip if not given")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--share", type=float, default=0.005)
    arguments = parser.parse_args()
    logging.disable(logging.ERROR)
    robot = load_robot("op3")
    unharmed = campaign(robot, arguments.clip, arguments.share, arguments.minutes)
    for fault in FAULTS:
        single(robot, arguments.clip, fault)
    sys.exit(0 if unharmed else 1)


if __name__ == "__main__":
    main()
