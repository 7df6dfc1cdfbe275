"""The recorder: if it fails the run goes on, and a run that fails is recorded."""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.cli import execute
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.plan_buffer import Offer, PlanBuffer
from flexmotion.streamer.control.telemetry import KEPT_S
from flexmotion.streamer.log.log_file import LogFile
from flexmotion.streamer.log.reader import read_log
from flexmotion.streamer.log.recorder import Recorder
from flexmotion.streamer.log.recording import record_to
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ...virtual_time import virtual_time
from ...waiting import wait_until

RATE = 125


def recorded(path: Path, clock: str) -> tuple[Session, Recorder]:
    robot = load_robot("op3")
    clip = ClipSource(default_clip()[:30])
    session = Session(robot, create("sim", robot), clip, load_stream(), 0.9, realtime=False, clock=clock)
    return session, record_to(path, session, clock)


def killing(session: Session, process: str, after: int) -> Callable[[], Request | None]:
    """Kills one of the run's processes, once, after so many ticks."""
    killed: list[int] = []

    def request() -> Request | None:
        if not killed and session.telemetry.ticks.count > after:
            child = next(c for c in multiprocessing.active_children() if c.name == f"flexmotion-{process}")
            assert child.pid is not None
            killed.append(child.pid)
            os.kill(child.pid, signal.SIGKILL)
        return None

    return request


# ---------------------------------------------------------------- the recorder fails


def test_killed_it_changes_nothing_but_its_log(tmp_path: Path) -> None:
    session, recorder = recorded(tmp_path / "run.mcap", "real")
    session.next_request = killing(session, "recorder", after=2 * RATE)
    with virtual_time():
        record = session.run()
    assert record.state[-1] == State.OFF and record.violations_sent == 0
    assert "recorder ended (signal 9); the run goes on" in [e.message for e in record.events if e.kind == "note"]
    assert [e for e in record.events if e.kind == "fault"] == []
    assert recorder.result() == f"{tmp_path / 'run.mcap'} (the recorder ended before the run)"
    log = read_log(recorder.path)
    assert not log.whole and 0 < len(log.rows) <= record.used


def test_a_full_disk_ends_the_log_and_not_the_run(tmp_path: Path) -> None:
    file, most = tmp_path / "run.mcap", 400_000

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    command = ["dry-run", "--seconds", "0.6", "--json", "--log", str(file)]
    run = subprocess.run(
        [sys.executable, "-m", "flexmotion.streamer", *command], capture_output=True, text=True, preexec_fn=limit
    )
    assert run.returncode == 0, run.stderr
    assert run.stderr.count("recording stopped at tick") == 1 and "Traceback" not in run.stderr
    report = json.loads(run.stdout)
    assert report["log"] == f"{file} (recording stopped: File too large)"
    log = read_log(file)
    assert file.stat().st_size <= most
    assert not log.whole and 0 < len(log.rows) < report["loop"]["cycles"]


def test_a_file_with_a_failed_write_is_cut_back_to_its_last_mark(tmp_path: Path) -> None:
    path = tmp_path / "log"
    file = LogFile(path)
    file.write(b"whole")
    file.mark()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8, before[1]))
    try:
        assert file.write(b"broken") == 6
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert file.error is not None
    assert file.write(b"too late") == 8
    file.mark()
    file.close()
    assert path.read_bytes() == b"whole"


def test_a_file_that_cannot_be_written_is_told_before_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ConfigError, match="cannot be written"):
        recorded(tmp_path / "none" / "run.mcap", "lockstep")
    for log, expected in (
        (tmp_path / "none" / "run.mcap", "cannot be written"),
        (tmp_path / "run.txt", "ends in .mcap"),
    ):
        assert execute(["dry-run", "--seconds", "0.3", "--log", str(log)]) == 2
        err = capsys.readouterr().err
        assert expected in err and err.count("\n") == 1


# ---------------------------------------------------------------- the run fails


def test_a_killed_loop_is_on_record_to_its_last_tick(tmp_path: Path) -> None:
    session, recorder = recorded(tmp_path / "run.mcap", "real")
    session.next_request = killing(session, "loop", after=RATE)
    with virtual_time(), pytest.raises(DriverError, match=r"the control loop's process died \(signal 9\)"):
        session.run()
    log = read_log(recorder.path)
    assert log.whole and recorder.result() == str(recorder.path)
    np.testing.assert_array_equal(log.rows["tick"], session.telemetry.ticks.reader().read()["tick"])
    assert log.events[-1].message.startswith(
        f"the log ends in {State(log.rows['state'][-1]).name}: the loop died there"
    )


def test_a_driver_that_fails_in_lockstep_leaves_a_whole_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session, recorder = recorded(tmp_path / "run.mcap", "lockstep")

    def fail(seconds: float) -> None:
        if session.telemetry.ticks.count == RATE:
            raise DriverError("port /dev/ttyUSB0: gone")

    monkeypatch.setattr(session.driver, "advance", fail)
    with pytest.raises(DriverError):
        session.run()
    log = read_log(recorder.path)
    assert log.whole and len(log.rows) == RATE


def test_when_the_program_is_killed_the_parking_is_still_on_record(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    program = str(Path(__file__).parents[2] / "virtual_program.py")
    command = [sys.executable, program, "run", "-r", "op3", "-d", "sim", "--no-realtime", "--log", str(file)]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_until(lambda: file.exists() and file.stat().st_size > 300_000, "a log of some length")
    run.kill()
    run.wait()
    wait_until(lambda: read_log(file).whole, "the recorder to close its log", every_s=0.2)
    log = read_log(file)
    assert log.rows["state"][-1] == State.OFF
    assert "END" in [event.message for event in log.events if event.kind == "request"]


# ---------------------------------------------------------------- both go on


def test_ticks_that_were_overwritten_are_counted_and_noted(tmp_path: Path) -> None:
    session, recorder = recorded(tmp_path / "run.mcap", "real")
    follow = recorder.follow()
    ticks = int(KEPT_S * RATE)
    for tick in range(ticks + 100):
        session.telemetry.row.tick[...] = tick
        session.telemetry.commit()
    follow(True)
    log = read_log(recorder.path)
    lost = ticks + 100 - len(log.rows)
    assert lost >= 100
    assert [event.message for event in log.events] == [f"recorder: {lost} ticks were overwritten before they were read"]
    assert recorder.result() == f"{recorder.path} ({lost} ticks lost)"


@pytest.fixture(scope="module")
def plans(tmp_path_factory: pytest.TempPathFactory) -> PlanBuffer:
    """The plans of a finished run; treat as read-only."""
    session, _ = recorded(tmp_path_factory.mktemp("plans") / "run.mcap", "lockstep")
    session.run()
    return session.plans


def test_an_observer_of_plans_gets_copies(plans: PlanBuffer) -> None:
    seen = plans.observe(0)
    assert seen is not None and seen.ticket.id == plans.newest_id
    assert plans.observe(seen.ticket.id) is None
    offered = plans.newest(0)
    assert offered is not None
    np.testing.assert_array_equal(seen.plan.q, offered.plan.q)
    assert not np.shares_memory(seen.plan.q, offered.plan.q)


def test_an_observer_drops_a_plan_that_was_written_over_meanwhile(
    plans: PlanBuffer, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = PlanBuffer._offer

    def lapped(buffer: PlanBuffer, slot: int) -> Offer:
        """The planner comes round to this slot while it is read."""
        offer = read(buffer, slot)
        buffer._heads[slot].id += 5
        return offer

    monkeypatch.setattr(PlanBuffer, "_offer", lapped)
    assert plans.observe(0) is None
