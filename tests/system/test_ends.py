"""How a run that a person started ends: by Ctrl-C, by a second one, by force; and what it leaves behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

Run = subprocess.Popen[str]
ChildNamed = Callable[..., psutil.Process]


def wait_for(run: Run, words: str, patience_s: float = 30.0) -> None:
    """Read the run's messages until `words` come."""
    assert run.stderr is not None
    end = time.monotonic() + patience_s
    seen = ""
    while time.monotonic() < end:
        line = run.stderr.readline()
        seen += line
        if words in line:
            return
        assert line, f"it ended before {words!r}: {seen}"
    pytest.fail(f"no {words!r} in {patience_s} s: {seen}")


@pytest.fixture
def walking(tmp_path: Path) -> Iterator[Run]:
    """`flexmotion run` on the shipped motion, some seconds after it began to stream."""
    command = [sys.executable, "-m", "flexmotion.streamer", "run", "-r", "op3", "-d", "sim", "--json"]
    run = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"COLUMNS": "200"},
        process_group=0,  # as a terminal would have it
    )
    try:
        wait_for(run, "READY -> STREAMING")
        yield run
    finally:
        family = psutil.Process(run.pid).children(recursive=True) if psutil.pid_exists(run.pid) else []
        for process in family:
            process.kill()
        run.kill()
        run.communicate()


def gone(processes: list[psutil.Process], within_s: float) -> bool:
    """Whether all of them have ended in time."""
    _, alive = psutil.wait_procs(processes, timeout=within_s)
    return not [p for p in alive if p.status() != psutil.STATUS_ZOMBIE]


def test_ctrl_c_parks_the_robot_and_ends_within_5_s(walking: Run) -> None:
    time.sleep(8.9)  # in mid-step
    family = psutil.Process(walking.pid).children(recursive=True)
    for process in (walking, *family):  # a terminal's Ctrl-C reaches the whole group
        os.kill(process.pid, signal.SIGINT)
    out, err = walking.communicate(timeout=8.0)
    assert walking.returncode == 130
    report = json.loads(out)
    assert report["safety"] == {"final_state": "OFF", "faults": [], "hardware_failed": False}
    assert not report["motion"]["fell"]
    assert "HOLD -> PARK" in err and gone(family, 0.5)
    parked = report["duration_s"]
    assert parked < 1.1 + 8.9 + 5.5


def test_a_second_ctrl_c_ends_at_once(walking: Run) -> None:
    family = psutil.Process(walking.pid).children(recursive=True)
    os.kill(walking.pid, signal.SIGINT)
    time.sleep(0.3)
    os.kill(walking.pid, signal.SIGINT)
    walking.communicate(timeout=4.0)
    assert walking.returncode == 130 and gone(family, 0.5)


def test_a_loop_killed_by_force_leaves_nothing_behind(
    walking: Run, shared_memory: Callable[[], set[str]], child_named: ChildNamed
) -> None:
    before = shared_memory()
    family = psutil.Process(walking.pid).children(recursive=True)
    child_named("fm-loop", walking.pid).kill()
    _, err = walking.communicate(timeout=2.0)
    assert gone(family, 0.1)
    assert walking.returncode == 3
    assert "the control loop's process died (signal 9)" in err and "Traceback" not in err
    assert shared_memory() <= before


def test_a_supervisor_killed_by_force_leaves_a_loop_that_parks_the_robot(walking: Run, child_named: ChildNamed) -> None:
    family = psutil.Process(walking.pid).children(recursive=True)
    loop = child_named("fm-loop", walking.pid)
    walking.kill()
    walking.wait()
    assert loop.is_running()  # it still has a robot to bring down
    assert gone(family, 8.0)


@pytest.mark.usefixtures("hears_hangup")
def test_a_terminal_that_is_closed_parks_the_robot(walking: Run) -> None:
    """A dropped connection once killed every process in mid-walk, with the torque on."""
    os.killpg(os.getpgid(walking.pid), signal.SIGHUP)
    out, err = walking.communicate(timeout=10.0)
    assert walking.returncode == 130
    assert json.loads(out)["safety"] == {"final_state": "OFF", "faults": [], "hardware_failed": False}
    assert "HOLD -> PARK" in err


def test_a_loop_that_hangs_is_ended_and_so_is_everything(walking: Run, child_named: ChildNamed) -> None:
    """Two Ctrl-Cs once left it hanging for ever: only the loop itself could hear them."""
    family = psutil.Process(walking.pid).children(recursive=True)
    os.kill(child_named("fm-loop", walking.pid).pid, signal.SIGSTOP)
    _, err = walking.communicate(timeout=5.0)
    assert walking.returncode == 3 and gone(family, 0.5)
    assert "the control loop's process was ended: it did not tick for 2 s" in err


def test_a_reader_that_goes_away_does_not_stop_the_robot(walking: Run) -> None:
    """A message to a pipe that nobody reads any more once killed the loop in mid-walk."""
    assert walking.stderr is not None
    walking.stderr.close()
    os.kill(walking.pid, signal.SIGUSR1)
    time.sleep(3.0)
    assert walking.poll() is None
    os.kill(walking.pid, signal.SIGINT)
    assert walking.wait(timeout=10.0) == 130
    assert walking.stdout is not None
    assert json.loads(walking.stdout.read())["safety"]["final_state"] == "OFF"
    walking.stderr = None
