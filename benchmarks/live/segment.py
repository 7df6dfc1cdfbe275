"""One segment of a soak, in a process of its own: `python -m benchmarks.live.segment` prints its figures as JSON."""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.live.figures import SegmentFigures
from benchmarks.live.senders import Lines, Sender, drawn, three
from flexmotion.configs.errors import ConfigError, DriverError, GatewayError
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import LogParts, StreamSettings, load_stream
from flexmotion.drivers.registry import create
from flexmotion.streamer.api import STANDING, open_source
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.connection import PATIENCE_S
from flexmotion.streamer.gateway.messages import decode, intent_of
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.log.parts import later_parts
from flexmotion.streamer.log.reader import read_log
from flexmotion.streamer.log.recording import record_to
from flexmotion.streamer.run.session import Session

PART_S = 300.0
KEPT_S = 20.0
_SAMPLE_S = 5.0
_AGAIN_S = 6.0
"""Time for a robot that fell to lie still and to be picked up, before it is armed again [s]."""


def settings() -> StreamSettings:
    """The shipped settings, with short parts of the log."""
    return load_stream().model_copy(update={"log": LogParts(part_mb=60.0, part_s=PART_S, keep_mb=400.0)})


def lockstep(seconds: float, seed: int, interval_s: float, log: Path, *, targets: bool) -> SegmentFigures:
    """A segment in lockstep. Without `targets` the same targets are sent by the program itself, over no transport."""
    found = SegmentFigures(clock="lockstep", seed=seed, targets=targets, seconds=0.0)
    number = 0
    while found.seconds < seconds:
        # A robot that has fallen begins anew, with other noise.
        path = log.with_name(f"{log.stem}-{number}{log.suffix}")
        _lockstep_run(found, seconds, seed + 1000 * number, interval_s, path, targets=targets)
        _read_parts(found, path)
        number += 1
    return found


def _lockstep_run(
    found: SegmentFigures, seconds: float, seed: int, interval_s: float, log: Path, *, targets: bool
) -> None:
    robot = load_robot("op3")
    session = Session(
        robot,
        create("sim", robot, seed=seed),
        open_source(robot, STANDING, seed=seed),
        settings(),
        stay=True,
        kept_s=KEPT_S,
        seed=seed,
    )
    begin_s, memory, own = found.seconds, psutil.Process(), np.random.default_rng(seed)

    def now() -> float:
        return session.telemetry.ticks.count / robot.rate_hz

    due_s = sampled_s = 0.0
    with _gateway(session) as (port, lines):
        record_to(log, session, "lockstep")
        senders = three(port, lines, now, interval_s, seed) if targets else []
        with session:
            if targets:
                _wait_until_it_listens(port)
            for sender in senders:
                sender.start()
            while begin_s + now() < seconds and session.step():
                if not targets and now() >= due_s:
                    due_s = now() + float(own.uniform(0.2, 1.8)) * interval_s
                    _send_directly(session, drawn(own))
                if now() >= sampled_s:
                    sampled_s = now() + _SAMPLE_S
                    found.memory.append((begin_s + now(), memory.memory_info().rss * 1e-6))
                    _tell(begin_s + now(), seconds, senders)
            if session.state.ladder in (State.DAMPED, State.FAULT):
                found.falls += 1
            else:
                _end(senders, lambda: session.step())
                session.finish()
    _count(found, senders)
    found.seconds = begin_s + now()
    found.violations += session.record.violations_sent


def _wait_until_it_listens(port: int) -> None:
    while True:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)


def _send_directly(session: Session, message: dict[str, Any]) -> None:
    intent = intent_of(decode(json.dumps(message).encode()))
    assert intent is not None
    session.targets.send(intent, holds_s=message.get("ttl_s", float("inf")), take_up_s=5.0)


@contextmanager
def _gateway(session: Session) -> Iterator[tuple[int, Lines]]:
    """A gateway of a session in lockstep, which `Listening` does not offer: its time is not that of other programs."""
    to_run, from_test = os.pipe()
    to_test, from_run = os.pipe()
    gateway = GatewayService(
        session.robot,
        session.driver.name,
        session.settings.gateway,
        session.telemetry,
        session.targets,
        session.heard_channel,
        Admission(),
        port=any_free(),
        lines=(to_run, from_run),
    )
    session.services += (gateway,)
    # Not closed here: threads read them until the segment's process ends.
    yield gateway.port, Lines(os.fdopen(from_test, "wb"), os.fdopen(to_test, "rb"))


def wall_clock(seconds: float, seed: int, interval_s: float, log: Path) -> SegmentFigures:
    """A segment of the whole program on the wall clock: `flexmotion dry-run --web --stdin`."""
    found = SegmentFigures(clock="real", seed=seed, targets=True, seconds=0.0)
    port, stop_port = any_free(), any_free()
    with tempfile.TemporaryDirectory() as folder:
        file, report = Path(folder) / "stream.yaml", Path(folder) / "report"
        file.write_text(json.dumps(settings().model_dump(mode="json")), encoding="utf-8")  # JSON is YAML
        command = [
            sys.executable,
            "-m",
            "flexmotion.streamer",
            "dry-run",
            "--web",
            "--stdin",
            "--arm",
            "--allow-refused",
        ]
        command += ["--web-port", str(port), "--stop-port", str(stop_port), "--seed", str(seed)]
        command += ["--settings", str(file), "--log", str(log), "--report", str(report)]
        with (
            open(Path(folder) / "notes", "w+", encoding="utf-8") as notes,
            subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=notes, process_group=0
            ) as run,
        ):
            _follow(found, run, port, seconds, seed, interval_s)
            notes.seek(0)
            if not (report / "report.json").is_file():
                raise DriverError(f"the run has no report: {notes.read().strip()[-300:]}")
            told = json.loads((report / "report.json").read_text(encoding="utf-8"))
    found.exit_code = run.returncode
    found.violations = told["limits"]["violations_sent"]
    found.missed = told["loop"]["missed_deadlines"]
    found.seconds = told["duration_s"]
    _read_parts(found, log)
    return found


def _follow(
    found: SegmentFigures, run: subprocess.Popen[bytes], port: int, seconds: float, seed: int, interval_s: float
) -> None:
    """Send targets to a run until its time is over, then end it as a service manager does."""
    assert run.stdin is not None and run.stdout is not None
    client = Client(port=port)
    status = _status(client, run)
    while status.get("state") != "STREAMING":
        time.sleep(0.5)
        status = _status(client, run)
    begin = time.monotonic()
    senders = three(port, Lines(run.stdin, run.stdout), time.monotonic, interval_s, seed)
    for sender in senders:
        sender.start()
    while (passed := time.monotonic() - begin) < seconds and run.poll() is None:
        time.sleep(_SAMPLE_S)
        found.memory.append((passed, _family_mb(run.pid)))
        _tell(passed, seconds, senders)
        if _status(client, run).get("state") == "FAULT":
            found.falls += 1
            time.sleep(_AGAIN_S)
            for ask in (client.take, client.clear, client.arm):
                ask()
    for sender in senders:
        sender.end(PATIENCE_S)
    _count(found, senders)
    run.send_signal(signal.SIGTERM)
    run.stdin.close()
    run.wait()


def _status(client: Client, run: subprocess.Popen[bytes]) -> dict[str, Any]:
    """The status; empty where the gateway does not answer yet, or is busy."""
    if run.poll() is not None:
        raise DriverError(f"the run ended with exit code {run.returncode}")
    try:
        return client.status()
    except GatewayError:
        return {}


def _family_mb(pid: int) -> float:
    """Memory of a run's processes that is their own [MB]; what they share with each other is not counted twice."""
    own = 0.0
    for process in (psutil.Process(pid), *psutil.Process(pid).children(recursive=True)):
        try:
            own += process.memory_full_info().uss * 1e-6
        except psutil.NoSuchProcess:
            continue
    return own


def _end(senders: list[Sender], step: Any) -> None:
    """End the senders; a run in lockstep must go on for their last answers."""
    for sender in senders:
        sender.end(0.0)
    end = time.monotonic() + PATIENCE_S
    while any(sender.is_alive() for sender in senders) and time.monotonic() < end and step():
        pass


def _count(found: SegmentFigures, senders: list[Sender]) -> None:
    states = Counter(found.states)
    for sender in senders:
        sender.end(PATIENCE_S)
        found.sent[sender.name] = found.sent.get(sender.name, 0) + sender.sent
        states.update(sender.states)
    found.states = dict(sorted(states.items()))


def _read_parts(found: SegmentFigures, log: Path) -> None:
    """Read the parts of a log, one after another, and remove them."""
    for part in (*later_parts(log), log):
        found.parts += 1
        try:
            found.unreadable += not read_log(part).whole
        except ConfigError:
            found.unreadable += 1
        part.unlink()


def _tell(now_s: float, seconds: float, senders: list[Sender]) -> None:
    sent = sum(sender.sent for sender in senders)
    print(f"{now_s:.0f} of {seconds:.0f} s, {sent} targets", file=sys.stderr, flush=True)


def measure() -> None:
    """Run a segment."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clock", choices=("lockstep", "real"))
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--interval-s", type=float, required=True)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--no-targets", action="store_true")
    given = parser.parse_args()
    log = given.folder / "run.mcap"
    if given.clock == "lockstep":
        found = lockstep(given.seconds, given.seed, given.interval_s, log, targets=not given.no_targets)
    else:
        found = wall_clock(given.seconds, given.seed, given.interval_s, log)
    print(found.model_dump_json())


if __name__ == "__main__":
    measure()
