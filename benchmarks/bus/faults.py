"""What does the loop do on every bus fault, and do random bad packets and false readings do harm?

The robot walks a clip in lockstep over the emulated bus; the real driver sends and reads bytes, and goals outside the
envelope are counted where the bytes arrive. First random bad packets for minutes, then servos and an IMU that lie for
minutes, then every single fault of `docs/faults.md`. Fails where bad packets or false readings end a run, let the robot
fall or pass a goal outside the envelope, where bad packets cost more than 10 % of the tracking, and where a goal jumps
with false readings: by more than `JUMP_DEG` in a tick, beyond what it does without them.
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
    *("blocked:14", "tripped:14", "false_position:14:400", "false_position:14:-4096", "false_position:14:4096"),
    *("false_speed:14:20", "false_voltage:14:20", "false_temperature:14:200", "false_gyro:20", "false_accel:100"),
)
LEGS = slice(8, None)
"""Columns of OP3's leg joints."""
TRACKING = 1.1
"""Most that bad packets may cost: tracking error over that of the clean run."""
JUMP_DEG = 5.0
"""Most that a goal may move in a tick with false readings, beyond its motion in the clean run [°]. One reading of +400
servo units moved it by 32 degrees before readings were doubted, one of -4096 by 70."""


@dataclass(frozen=True)
class Result:
    """A run.

    Attributes:
        record: of the loop.
        body: the robot, as it was left.
        packets: sent by the host.
        damaged: packets damaged on the way to the servos or back.
        refused: goals outside the servos' limits that the driver did not send (`drivers/bus/goal_guard.py`).
        told: false readings.
    """

    record: RunTrace
    body: SimBody
    packets: int
    damaged: int
    refused: int
    told: int

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
    robot: Robot,
    clip: Path | None,
    *,
    fault: str | None = None,
    bad_packets: float = 0.0,
    false_readings: float = 0.0,
    seed: int = 0,
) -> Result:
    """One run of the clip, with one fault or a share of bad packets or of false readings."""
    settings = load_stream(None)
    motion = choose_motion(clip)
    body = SimBody(robot)
    faults = [] if fault is None else [Fault.parse(f"{fault}@{FAULT_AT}")]
    world = Loopback(body, faults=faults, bad_packets=bad_packets, false_readings=false_readings, seed=seed)
    real = create("dynamixel", robot, port="main")
    assert isinstance(real, BusDriver)
    driver = LockstepBus(real, world, body)
    record = Session(robot, driver, ClipSource(motion), settings, None).run()
    line = world.emulator.lines[0]
    assert isinstance(line, BusLine)
    told = sum(world.emulator.false_readings.told.values())
    return Result(record, body, line.bus.received, sum(line.damage.spoilt.values()), real.violations, told)


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


def jump(record: RunTrace, clean: RunTrace) -> float:
    """Most that a goal moved in a tick beyond its motion in the clean run of the same clip [rad]."""
    ticks = min(len(record.q_cmd), len(clean.q_cmd))
    away = np.diff(record.q_cmd[:ticks] - clean.q_cmd[:ticks], axis=0)
    return float(np.nanmax(np.abs(away), initial=0.0))


def lying(robot: Robot, clip: Path | None, share: float, minutes: float) -> dict[str, float]:
    """Runs with random false readings of servos and IMU, compared with a clean run."""
    found = {"minutes": 0.0, "false": 0.0, "disbelieved": 0.0, "faults": 0.0, "falls": 0.0, "violations": 0.0}
    most, seed, clean = 0.0, 0, run(robot, clip).record
    while found["minutes"] < minutes:
        result = run(robot, clip, false_readings=share, seed=seed)
        most = max(most, jump(result.record, clean))
        seed += 1
        found["minutes"] += len(result.record.q) / robot.rate_hz / 60
        found["false"] += result.told
        found["disbelieved"] += int(result.record.disbelieved[-1]) - int(clean.disbelieved[-1])
        found["faults"] += len(result.faults)
        found["falls"] += result.body.fell
        found["violations"] += result.body.receiver.violations + result.refused
        print(f"{found['minutes']:.1f} of {minutes:g} min: {found['false']:.0f} false readings, ", end="")
        print(f"faults {found['faults']:.0f}, falls {found['falls']:.0f}, jump {np.degrees(most):.1f}°", flush=True)
    return found | {"jump_deg": float(np.degrees(most))}


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


def verdicts_of_lies(share: float, found: dict[str, float]) -> list[Verdict]:
    """Of the false readings."""
    lies = f"{100 * share:g} % false readings for {found['minutes']:.1f} min"
    most, told, disbelieved = found["jump_deg"], found["false"], found["disbelieved"]
    return [
        # Without lies, or with none that was seen, the verdicts below say nothing.
        Verdict(f"{lies}: {told:.0f} readings were false (> 0)", told > 0),
        Verdict(f"{lies}: {disbelieved:.0f} more than in the clean run were not believed (> 0)", disbelieved > 0),
        Verdict(f"{lies}: {found['faults']:.0f} faults (0)", not found["faults"]),
        Verdict(f"{lies}: {found['falls']:.0f} falls (0)", not found["falls"]),
        Verdict(f"{lies}: goals outside the envelope: {found['violations']:.0f} (0)", not found["violations"]),
        Verdict(f"{lies}: greatest jump of a goal: {most:.1f}° (<= {JUMP_DEG:g})", most <= JUMP_DEG),
    ]


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
    lies_min: Annotated[float, typer.Option(min=0.0, help="Minutes of false readings, in the loop's time.")] = 10.0,
    lies: Annotated[float, typer.Option(min=0.0, max=1.0, help="Share of false readings.")] = 0.01,
) -> Outcome:
    """Run the campaigns, then every single fault."""
    logging.disable(logging.ERROR)
    robot = load_robot("op3")
    found = campaign(robot, clip, share, minutes)
    print(f"{found['packets']:.0f} packets sent, {found['damaged']:.0f} damaged either way", flush=True)
    told = lying(robot, clip, lies, lies_min) if lies_min else None
    stories = {}
    for fault in track(FAULTS, "faults"):
        stories[fault] = single(robot, clip, fault)
        own = stories[fault]
        print(f"{fault:12} violations {own['violations']}, torque on at {own['torque_on']} servos: {own['events']}")
    judged = verdicts(share, found) + ([] if told is None else verdicts_of_lies(lies, told))
    return Outcome(judged, {"campaign": found} | ({} if told is None else {"lies": told}) | stories)
