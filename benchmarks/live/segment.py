"""One segment of a soak, in a process of its own: `python -m benchmarks.live.segment` prints its figures as JSON."""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import psutil

from benchmarks.live.figures import Fall, SegmentFigures
from benchmarks.live.senders import Sender, merged, three
from benchmarks.shared.lines import Lines
from benchmarks.shared.memory import of_family, of_process
from benchmarks.shared.program import end_on_terminate
from benchmarks.shared.served_run import ServedRun, served_run
from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import LogParts, StreamSettings, load_stream
from flexmotion.drivers.registry import create
from flexmotion.streamer import api
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.start_check import gets_up_from
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.connection import PATIENCE_S
from flexmotion.streamer.gateway.messages import Answer, decode, intent_of
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.log.parts import later_parts
from flexmotion.streamer.log.reader import read_log
from flexmotion.streamer.log.recording import record_to
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

PARTS = 6
"""Parts of a segment's log, at least; the oldest are removed meanwhile."""
KEPT_S, PICKED_UP_S = 20.0, 3.0
STAND_UP_S = 60.0
"""Longest time until the robot stands [s]."""
_SAMPLE_S = 5.0
_AGAIN_S = 1.0
"""Time between two attempts to arm a robot that fell [s]."""
_BEFORE_S = 10.0
"""Targets of so long before a fall are told with it [s]."""


def settings(seconds: float) -> StreamSettings:
    """The shipped settings, with short parts of the log."""
    parts = LogParts(part_mb=60.0, part_s=max(seconds / PARTS, 10.0), keep_mb=400.0)
    return load_stream().model_copy(update={"log": parts})


class Falls:
    """Notices falls by the ladder's state, and what was asked before.

    Args:
        found: gets the falls.
        newest: gives the last targets, each as time [s], target and answer.
    """

    def __init__(self, found: SegmentFigures, newest: Callable[[], list[tuple[float, dict[str, Any], str]]]) -> None:
        self._found, self._newest, self._lies = found, newest, False

    def see(self, state: str | None, now_s: float, cause: str | None = None) -> bool:
        """Take the state of the ladder and its cause; returns whether the robot must be armed again."""
        down = state in ("DAMPED", "FAULT", "OFF")
        if down and not self._lies:
            recent = sorted((one for one in self._newest() if one[0] > now_s - _BEFORE_S), key=lambda one: one[0])
            asked = [f"{at_s - now_s:+.2f} s {_told(target)}: {answer}" for at_s, target, answer in recent]
            self._found.falls.append(Fall(at_s=round(now_s, 2), cause=cause, asked=asked))
        self._lies = down
        return state in ("FAULT", "OFF")


def _told(target: dict[str, Any]) -> str:
    return str(target.get("text") or target.get("velocity") or target["type"])


# ---------------------------------------------------------------- in lockstep


def lockstep(seconds: float, seed: int, interval_s: float, log: Path, *, targets: bool) -> SegmentFigures:
    """A segment in lockstep. Without `targets` the same targets are sent by the program itself, over no transport."""
    found = SegmentFigures(clock="lockstep", seed=seed, targets=targets)
    robot = load_robot("op3")
    session = Session(
        robot,
        create("sim", robot, seed=seed, picked_up_s=PICKED_UP_S),
        api.open_source(robot, api.STANDING, seed=seed),
        settings(seconds),
        stay=True,
        attended=True,
        kept_s=KEPT_S,
        seed=seed,
    )
    run = _Lockstep(session, found, interval_s)
    with ExitStack() as stack:
        port, lines = stack.enter_context(_gateway(session))
        record_to(log, session, "lockstep")
        stack.enter_context(session)
        run.stand_up()
        senders = three(port, lines, run.now, interval_s, seed) if targets else []
        if targets:
            _wait_until_it_listens(port)
        for sender in senders:
            sender.start()
        run.follow(seconds, senders, merged(interval_s, seed) if not targets else None)
        _end(senders, session.step)
        session.finish()
    _count(found, senders)
    found.seconds = run.now()
    found.violations = session.record.violations_sent
    _read_parts(found, log)
    return found


class _Lockstep:
    """A session in lockstep that is armed again after each fall."""

    def __init__(self, session: Session, found: SegmentFigures, interval_s: float) -> None:
        self.session, self.found, self.interval_s = session, found, interval_s
        self._begin_s = 0.0

    def now(self) -> float:
        """Time of the run since the robot stood up [s]."""
        return self.session.telemetry.ticks.count / self.session.robot.rate_hz - self._begin_s

    def stand_up(self) -> None:
        """Step until the robot stands. Raises `DriverError` where it does not."""
        while self.session.state.ladder not in (State.HOLD, State.STREAMING):
            if not self.session.step() or self.now() > STAND_UP_S:
                raise DriverError(f"the robot does not stand: {self.session.state.ladder.name}")
        self._begin_s = self.now()

    def follow(self, seconds: float, senders: list[Sender], own: Iterator[tuple[float, dict[str, Any]]] | None) -> None:
        """Step for some time; `own`: targets that this program sends itself."""
        session, now, memory = self.session, self.now, self.found.memory.setdefault("all", [])
        sent: list[tuple[float, dict[str, Any], str]] = []
        falls = Falls(self.found, lambda: [one for sender in senders for one in sender.newest] + sent[-20:])
        waiting = next(own) if own is not None else None
        sampled_s = armed_s = 0.0
        while now() < seconds and session.step():
            if own is not None and waiting is not None and now() >= waiting[0]:
                _send_directly(session, waiting[1])
                sent = [*sent[-20:], (now(), waiting[1], "sent")]
                self.found.sent["none"] = self.found.sent.get("none", 0) + 1
                waiting = next(own)
            assert session.loop is not None
            if falls.see(session.state.ladder.name, now(), session.loop.ladder.fault) and now() >= armed_s:
                armed_s = now() + _AGAIN_S
                session.ask(self._again())
            if now() >= sampled_s:
                sampled_s = now() + _SAMPLE_S
                memory.append((now(), *of_process(os.getpid())))
                _tell(now(), seconds, sum(self.found.sent.values()) + sum(sender.sent for sender in senders))

    def _again(self) -> Request:
        """What leads a robot without torque back to following."""
        row = self.session.telemetry.ticks.latest()
        if row is not None and gets_up_from(self.session.robot, TickRow(row)) is not None:
            return Request.GET_UP
        return Request.CLEAR if self.session.state.ladder is State.FAULT else Request.ARM


def _wait_until_it_listens(port: int) -> None:
    while True:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)


def _send_directly(session: Session, message: dict[str, Any]) -> None:
    intent = intent_of(decode(json.dumps(message)))
    assert intent is not None
    session.targets.send(
        intent, holds_s=message.get("ttl_s", float("inf")), take_up_s=session.settings.gateway.take_up_s
    )


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


def _end(senders: list[Sender], step: Callable[[], bool]) -> None:
    """End the senders; a run in lockstep must go on for their last answers."""
    for sender in senders:
        sender.end(0.0)
    end = time.monotonic() + PATIENCE_S
    while any(sender.is_alive() for sender in senders) and time.monotonic() < end and step():
        pass


# ---------------------------------------------------------------- on the wall clock


def wall_clock(seconds: float, seed: int, interval_s: float, log: Path) -> SegmentFigures:
    """A segment of the whole program on the wall clock: `flexmotion dry-run --web --stdin`."""
    found = SegmentFigures(clock="real", seed=seed, targets=True)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "stream.yaml"
        file.write_text(json.dumps(settings(seconds).model_dump(mode="json")), encoding="utf-8")  # JSON is YAML
        options = ("--arm", "--seed", str(seed), "--settings", str(file), "--log", str(log))
        with served_run(*options, lines=True) as run:
            assert run.lines is not None
            _follow(found, run, run.lines, seconds, seed, interval_s)
            run.end(signal.SIGTERM)  # as a service manager does
    found.exit_code = run.process.returncode
    found.violations = run.report["limits"]["violations_sent"]
    found.missed = run.report["loop"]["missed_deadlines"]
    late = run.report["loop"]["robot_lateness_us"]
    found.robot_late_ms = 0.0 if late is None else 1e-3 * late["max"]
    found.seconds = run.report["duration_s"]
    _read_parts(found, log)
    return found


def _follow(found: SegmentFigures, run: ServedRun, lines: Lines, seconds: float, seed: int, interval_s: float) -> None:
    """Send targets to a run until its time is over."""
    begin = time.monotonic()

    def now() -> float:
        return time.monotonic() - begin

    senders = three(run.port, lines, now, interval_s, seed)
    falls = Falls(found, lambda: [one for sender in senders for one in sender.newest])
    for sender in senders:
        sender.start()
    sampled_s = 0.0
    while now() < seconds:
        time.sleep(_AGAIN_S)
        # Another sender may take the lease in between: then it is asked again.
        status = run.status()
        if falls.see(status.get("state"), now(), status.get("cause")):
            with run.client("soak") as client:
                asks: dict[str, Callable[[], Answer]] = {"take": client.take}
                if status.get("gets_up_from") is not None:
                    asks["get up"] = partial(client.clear, get_up=True)
                else:
                    asks |= {"clear": client.clear, "arm": client.arm}
                answers = [(name, ask()) for name, ask in asks.items()]
            told = ", ".join(f"{name} {answer.state} {answer.reason or ''}".strip() for name, answer in answers)
            print(f"{now():.0f} s, armed again in {status['state']}: {told}", file=sys.stderr, flush=True)
        if now() >= sampled_s:
            sampled_s = now() + _SAMPLE_S
            for name, (resident, private) in of_family(run.process.pid).items():
                found.memory.setdefault(name, []).append((now(), resident, private))
            _tell(now(), seconds, sum(sender.sent for sender in senders))
    for sender in senders:
        sender.end(PATIENCE_S)
    _count(found, senders)


# ---------------------------------------------------------------- of both


def _count(found: SegmentFigures, senders: list[Sender]) -> None:
    states = Counter(found.states)
    for sender in senders:
        sender.end(PATIENCE_S)
        found.sent[sender.name] = sender.sent
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


def _tell(now_s: float, seconds: float, targets: int) -> None:
    load = psutil.getloadavg()[0]
    print(f"{now_s:.0f} of {seconds:.0f} s, {targets} targets, load {load:.1f}", file=sys.stderr, flush=True)


def measure() -> None:
    """Run a segment."""
    end_on_terminate()
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
