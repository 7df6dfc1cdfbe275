"""How soon after a frame of a person does the arm of the robot get its first command from it?

A run of the simulated robot on the wall clock, in processes, mirrors a clip that another process sends over UDP at 30
frames/s. The time counts from the frame's arrival at the receiving process to the loop's first goals of a plan that
follows it; it is measured for every frame with which a plan was made. Meant for an otherwise idle machine that grants
realtime scheduling; the load is among the figures.
"""

from __future__ import annotations

import os
import socket
import time
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.shared.outcome import Outcome, Verdict
from flexmotion.configs.errors import DriverError
from flexmotion.drivers.realtime import child
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer import api
from flexmotion.streamer.mirror.clip_frames import clip_frames
from flexmotion.streamer.mirror.mirroring import MirrorFrom
from flexmotion.streamer.run.requests import Request

P50_MS, P95_MS = 80.0, 150.0
WARM_S = 2.0
"""Left out after the robot has begun to follow: what is done for the first time takes longer [s]."""
LONGEST_START_S = 60.0


def send(motion: Motion, port: int) -> None:
    """Send a clip over and over at its own rate, until this process is ended."""
    frames = [datagram for _, datagram in clip_frames(motion)]
    begin, number = time.perf_counter(), 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        while True:
            time.sleep(max(begin + number / motion.fps - time.perf_counter(), 0.0))
            # There and back, so that it has no jump.
            place = number % (2 * len(frames) - 2)
            datagram = frames[min(place, 2 * len(frames) - 2 - place)]
            stamp = f'{{"t": {number / motion.fps:.6f}'.encode()
            sender.sendto(stamp + datagram[datagram.index(b",") :], ("127.0.0.1", port))
            number += 1


def free_port() -> int:
    """A UDP port that is free now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        trial.bind(("127.0.0.1", 0))
        return int(trial.getsockname()[1])


def main(
    seconds: Annotated[float, typer.Option(min=5.0, help="Length of the measurement [s].")] = 60.0,
    foreseen: Annotated[bool, typer.Option("--model/--no-model", help="Whether the model foresees the person.")] = True,
) -> Outcome:
    """Measure and compare with the limits."""
    port, load = free_port(), os.getloadavg()[0]
    source = api.open_mirror(foreseen=foreseen)
    session = api.open_session("op3", source=source, clock="real", stay=True, mirror=MirrorFrom(port=port))
    motion = default_clip()[:225]  # on the spot: the arms move all the time
    followed: list[float] = []

    def operate() -> Request | None:
        now = time.perf_counter()
        if not followed:
            if np.isfinite(session.state.source_s):
                followed.append(now)
            elif now - begin > LONGEST_START_S:
                return Request.END
            return None
        return Request.END if now > followed[0] + WARM_S + seconds else None

    session.next_request, begin = operate, time.perf_counter()
    sender = child.start("sender", send, motion, port)
    try:
        record = session.run()
    finally:
        sender.terminate()
        child.end(sender, patience_s=2.0)
    if not followed:
        raise DriverError(f"the person was not followed within {LONGEST_START_S:g} s")
    measured = record.stamp_ns > (followed[0] + WARM_S) * 1e9
    waited = record.ticks.seen_to_command_s[measured]
    waited_ms = 1e3 * waited[np.isfinite(waited)]
    if not len(waited_ms):
        faults = "; ".join(event.message for event in record.events if event.kind == "fault")
        raise DriverError(f"the run ended before a frame was measured: {faults or 'no fault'}")
    p50, p95, most = np.percentile(waited_ms, [50, 95, 100])
    plans = [plan for plan in record.plans if plan.sample_s > 0.0]
    parts = {
        "sample_ms": 1e3 * float(np.median([plan.sample_s for plan in plans])),
        "retarget_ms": 1e3 * float(np.median([plan.retarget_s for plan in plans])),
    }
    table = Table("frames", "p50 ms", "p95 ms", "max ms", "sample ms", "retarget ms", "scheduling", "load")
    cells = (p50, p95, most, *parts.values())
    table.add_row(str(len(waited_ms)), *(f"{cell:.0f}" for cell in cells), session.scheduling, f"{load:.1f}")
    Console(width=120).print(table)
    figures: dict[str, Any] = {
        "frames": len(waited_ms),
        "p50_ms": float(p50),
        "p95_ms": float(p95),
        "max_ms": float(most),
        **parts,
        "scheduling": session.scheduling,
        "load": load,
        "model": foreseen,
        "underruns": record.underruns,
    }
    return Outcome(
        [
            Verdict(f"frame to command p50 {p50:.0f} ms (<= {P50_MS:g})", bool(p50 <= P50_MS)),
            Verdict(f"frame to command p95 {p95:.0f} ms (<= {P95_MS:g})", bool(p95 <= P95_MS)),
        ],
        figures,
    )
