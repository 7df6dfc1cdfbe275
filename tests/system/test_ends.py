"""How a run ends: by Ctrl-C, by a second signal, by a kill; and what it leaves behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.log.reader import read_log

from ..waiting import HANGING_S, wait_until

ChildNamed = Callable[..., psutil.Process]

PROGRAM = Path(__file__).parents[1] / "virtual_program.py"
MID_WALK_S = 2.0
"""Seconds of the shipped motion after which it walks."""
PARKED_WITHIN_S = 5.5
"""A robot that walks stops, stands and is parked within this, in seconds of the loop."""


class Walk:
    """`flexmotion run` on the shipped motion, on virtual time: it goes on until it is told to end.

    Attributes:
        process: the supervisor.
        log: where the run is recorded.
    """

    def __init__(self, log: Path) -> None:
        self.log = log
        command = [sys.executable, str(PROGRAM), "run", "-r", "op3", "-d", "sim", "--no-realtime", "--json", "--log"]
        self.process = subprocess.Popen(
            [*command, str(log)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"COLUMNS": "200"},
            process_group=0,  # as a terminal would have it
        )

    @property
    def pid(self) -> int:
        return self.process.pid

    @property
    def family(self) -> list[psutil.Process]:
        """Processes that it started, and those that they started."""
        return psutil.Process(self.pid).children(recursive=True) if psutil.pid_exists(self.pid) else []

    def wait_for_message(self, words: str) -> None:
        """Read the run's messages until `words` come."""
        assert self.process.stderr is not None
        seen = ""
        while words not in seen:
            line = self.process.stderr.readline()
            seen += line
            assert line, f"it ended before {words!r}: {seen}"

    def wait_for_rows(self, reached: Callable[[Any], np.bool], what: str) -> None:
        """Wait until `reached` is true of the rows that were recorded so far."""

        def happens() -> bool:
            rows = read_log(self.log).rows if self.log.exists() else []
            return len(rows) > 0 and bool(reached(rows))

        wait_until(happens, what, every_s=0.2)

    def end(self) -> tuple[str, str]:
        """What it printed on stdout and stderr until its end."""
        return self.process.communicate(timeout=HANGING_S)

    def ticks_between(self, *messages: str) -> int:
        """Ticks of the loop between two events of the log."""
        first, second = (
            next(event.tick for event in read_log(self.log).events if words in event.message) for words in messages
        )
        return second - first


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Virtual time that passes at half the speed of the real one at most: a test has time to act within it."""
    monkeypatch.setenv("FASTEST", "0.5")


@pytest.fixture
def walking(tmp_path: Path) -> Iterator[Walk]:
    """A run whose robot walks, or has walked."""
    walk = Walk(tmp_path / "run.mcap")
    try:
        walk.wait_for_message("READY -> STREAMING")
        walk.wait_for_rows(lambda rows: rows["source_s"][-1] > MID_WALK_S, "the robot to walk")
        yield walk
    finally:
        for process in [*walk.family, walk.process]:
            process.kill()
        walk.process.communicate()


def gone(processes: list[psutil.Process]) -> bool:
    """Whether all of them end."""
    _, alive = psutil.wait_procs(processes, timeout=HANGING_S)
    return not [p for p in alive if p.status() != psutil.STATUS_ZOMBIE]


@pytest.mark.wall_clock
def test_on_the_wall_clock_it_ends_in_a_documented_way() -> None:
    """A machine that is slow at the wrong moment makes a robot fall or go stale, and never moves a goal too far.

    A planner that never makes a plan in time is no such machine: a plan that came late is made again, further ahead.
    """
    command = [sys.executable, "-m", "flexmotion.streamer", "run", "-r", "op3", "-d", "sim", "--seconds", "1", "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert "Traceback" not in done.stderr
    if done.returncode == 3:  # it had no processor for seconds
        starved = ("it did not tick for", "the simulated robot's process did not start")
        assert any(message in done.stderr for message in starved), done.stderr
        return
    report = json.loads(done.stdout)
    assert done.returncode == (0 if report["ok"] else 1), done.stderr
    assert report["clock"] == "real" and report["limits"]["violations_sent"] == 0
    safety = report["safety"]
    assert safety["final_state"] == "OFF" or (safety["final_state"] == "FAULT" and safety["faults"])
    assert "no plan for" not in done.stderr + str(safety["faults"])
    if "OFF -> READY" in done.stderr:
        assert report["planner"]["plans"] > 0, done.stderr


PARKED = {"final_state": "OFF", "faults": [], "hardware_failed": False}


def test_ctrl_c_parks_the_robot_and_ends(walking: Walk) -> None:
    family = walking.family
    for process in (walking, *family):  # a terminal's Ctrl-C reaches the whole group
        os.kill(process.pid, signal.SIGINT)
    out, err = walking.end()
    assert walking.process.returncode == 130
    report = json.loads(out)
    assert report["safety"] == PARKED and not report["motion"]["fell"]
    assert "HOLD -> PARK" in err and gone(family)
    assert walking.ticks_between("END", "PARK -> OFF") < PARKED_WITHIN_S * report["loop"]["rate_hz"]


def test_a_second_interrupt_ends_at_once(unhurried: None, walking: Walk) -> None:
    family = walking.family
    walking.process.send_signal(signal.SIGINT)
    walking.wait_for_message("END")
    walking.process.send_signal(signal.SIGINT)
    _, err = walking.end()
    assert walking.process.returncode == 130 and gone(family)
    assert "PARK -> OFF" not in err
    assert State.OFF not in read_log(walking.log).rows["state"]


def test_a_loop_killed_by_force_leaves_nothing_behind(
    walking: Walk, shared_memory: Callable[[], set[str]], child_named: ChildNamed
) -> None:
    before = shared_memory()
    family = walking.family
    child_named("fm-loop", walking.pid).kill()
    _, err = walking.end()
    assert gone(family)
    assert walking.process.returncode == 3
    assert "the control loop's process died (signal 9)" in err and "Traceback" not in err
    assert shared_memory() <= before


def test_a_supervisor_killed_by_force_leaves_a_loop_that_parks_the_robot(
    walking: Walk, child_named: ChildNamed
) -> None:
    family = walking.family
    walking.process.kill()
    walking.process.wait()
    assert gone(family)
    log = read_log(walking.log)
    assert log.events[-1].message.startswith("PARK -> OFF") and log.rows["state"][-1] == State.OFF


@pytest.mark.usefixtures("hears_hangup")
def test_a_terminal_that_is_closed_parks_the_robot(walking: Walk) -> None:
    """A dropped connection once killed every process in mid-walk, with the torque on."""
    os.killpg(os.getpgid(walking.pid), signal.SIGHUP)
    out, err = walking.end()
    assert walking.process.returncode == 130
    assert json.loads(out)["safety"] == PARKED
    assert "HOLD -> PARK" in err


def test_a_loop_that_hangs_is_ended_and_so_is_everything(walking: Walk, child_named: ChildNamed) -> None:
    """Two Ctrl-Cs once left it hanging for ever: only the loop itself took requests."""
    family = walking.family
    os.kill(child_named("fm-loop", walking.pid).pid, signal.SIGSTOP)
    _, err = walking.end()
    assert walking.process.returncode == 3 and gone(family)
    assert "the control loop's process was ended: it did not tick for 2 s" in err


def test_a_reader_that_goes_away_does_not_stop_the_robot(walking: Walk) -> None:
    """A message to a pipe without a reader once killed the loop in mid-walk."""
    assert walking.process.stderr is not None and walking.process.stdout is not None
    walking.process.stderr.close()
    walking.process.send_signal(signal.SIGUSR1)
    walking.wait_for_rows(lambda rows: (rows["state"][-200:] == State.HOLD).all(), "the robot to stand")
    assert walking.process.poll() is None
    walking.process.send_signal(signal.SIGINT)
    report = json.loads(walking.process.stdout.read())
    assert walking.process.wait(HANGING_S) == 130
    assert report["safety"]["final_state"] == "OFF"
    walking.process.stderr = None
