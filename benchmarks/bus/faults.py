"""What does the loop do on every bus fault, and do random bad packets do harm?

The robot walks a clip in lockstep over the emulated bus; the real driver sends and reads bytes, and goals outside the
envelope are counted where the bytes arrive. First random bad packets for minutes, then every single fault of
`docs/faults.md`. Fails where bad packets end a run, pass a goal outside the envelope, or cost more than 10 % of the
tracking.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.progress import track

from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.line import BusLine
from flexmotion.drivers.emulator.lockstep import LockstepBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.registry import create
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.session import Session

FAULT_AT = 3.0
"""When a single fault happens, after torque went on [s]."""
FAULTS = (
    *("cable", "port", "lost", "corrupt", "truncated", "late", "late:0.009", "duplicated"),
    *("dead:4", "dead:14", "dead:200", "overheat:4", "overheat:14", "reset:4", "reset:14", "voltage:9.5", "imu"),
)
LEGS = slice(8, None)
"""Columns of OP3's leg joints."""
TRACKING = 1.1
"""Most that bad packets may cost: tracking error over that of the clean run."""


@dataclass(frozen=True)
class Result:
    """A run.

    Attributes:
        record: of the loop.
        body: the robot, as it was left.
        packets: sent by the host.
        damaged: packets damaged on the way to the servos or back.
        refused: goals outside the servos' limits that the driver did not send (`drivers/bus/goal_guard.py`).
    """

    record: RunTrace
    body: SimBody
    packets: int
    damaged: int
    refused: int

    @property
    def squared_error(self) -> tuple[float, int]:
        """Sum of the squared tracking errors of the legs [rad²], and the number of values."""
        error = (self.record.q - self.record.q_ref)[:, LEGS]
        known = error[np.isfinite(error).all(axis=1)]
        return float((known**2).sum()), known.size

    @property
    def faults(self) -> list[str]:
        """Messages of the latched faults."""
        return [event.message for event in self.record.events if event.kind == "fault"]


def run(
    robot: Robot, clip: Path | None, *, fault: str | None = None, bad_packets: float = 0.0, seed: int = 0
) -> Result:
    """One run of the clip, with one fault or a share of bad packets."""
    settings = load_stream(None)
    motion = choose_motion(clip)
    body = SimBody(robot)
    faults = [] if fault is None else [Fault.parse(f"{fault}@{FAULT_AT}")]
    world = Loopback(body, faults=faults, bad_packets=bad_packets, seed=seed)
    real = create("dynamixel", robot, port="main")
    assert isinstance(real, BusDriver)
    driver = LockstepBus(real, world, body)
    record = Session(robot, driver, ClipSource(motion), settings, None).run()
    line = world.emulator.lines[0]
    assert isinstance(line, BusLine)
    return Result(record, body, line.bus.received, sum(line.damage.spoilt.values()), real.violations)


def campaign(robot: Robot, clip: Path | None, share: float, minutes: float) -> dict[str, float]:
    """Runs with random bad packets, compared with a clean run."""
    found = {"minutes": 0.0, "packets": 0.0, "damaged": 0.0, "faults": 0.0, "falls": 0.0, "violations": 0.0}
    total, count, seed = 0.0, 0, 0
    clean_total, clean_count = run(robot, clip).squared_error
    while found["minutes"] < minutes:
        result = run(robot, clip, bad_packets=share, seed=seed)
        squares, values = result.squared_error
        total, count, seed = total + squares, count + values, seed + 1
        found["minutes"] += len(result.record.q) / robot.rate_hz / 60
        found["packets"] += result.packets
        found["damaged"] += result.damaged
        found["faults"] += len(result.faults)
        found["falls"] += result.body.fell
        found["violations"] += result.body.receiver.violations + result.refused
    return found | {"tracking": float(np.sqrt(total / count) / np.sqrt(clean_total / clean_count))}


def single(robot: Robot, clip: Path | None, fault: str) -> dict[str, Any]:
    """One fault while walking, and the events that followed."""
    result = run(robot, clip, fault=fault)
    on = next(event.tick for event in result.record.events if "READY" in event.message)

    def when(event: Event) -> float:
        return (event.tick - on) / robot.rate_hz - FAULT_AT

    after = [event for event in result.record.events if when(event) >= 0]
    return {
        "fault": fault,
        "events": "; ".join(f"{when(event):.3f} s {event.message}" for event in after),
        "violations": result.body.receiver.violations + result.refused,
        "torque_on": int(result.body.plant.enabled.sum()),
    }


def verdicts(share: float, found: dict[str, float]) -> list[Verdict]:
    """Of the campaign."""
    packets = f"{100 * share:g} % bad packets for {found['minutes']:.1f} min"
    return [
        Verdict(f"{packets}: {found['faults']:.0f} faults (0)", not found["faults"]),
        Verdict(f"{packets}: {found['falls']:.0f} falls (0)", not found["falls"]),
        Verdict(f"goals outside the envelope: {found['violations']:.0f} (0)", not found["violations"]),
        Verdict(f"tracking error over clean: {found['tracking']:.3f} (<= {TRACKING})", found["tracking"] <= TRACKING),
    ]


def main(
    clip: Annotated[Path | None, typer.Option(help="Motion file; default: the shipped clip.")] = None,
    minutes: Annotated[float, typer.Option(min=0.1, help="Of bad packets, in the loop's time.")] = 10.0,
    share: Annotated[float, typer.Option(min=0.0, max=1.0, help="Of bad packets.")] = 0.005,
) -> Outcome:
    """Run the campaign, then every single fault."""
    logging.disable(logging.ERROR)
    robot = load_robot("op3")
    found = campaign(robot, clip, share, minutes)
    print(f"{found['packets']:.0f} packets sent, {found['damaged']:.0f} damaged either way", flush=True)
    stories = {}
    for fault in track(FAULTS, "faults"):
        stories[fault] = single(robot, clip, fault)
        own = stories[fault]
        print(f"{fault:12} violations {own['violations']}, torque on at {own['torque_on']} servos: {own['events']}")
    return Outcome(verdicts(share, found), {"campaign": found} | stories)
