"""What a run over a servo bus leaves behind, however it ends: the robot's servos are asked afterwards, in bytes."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
import yaml

from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.dynamixel.registers import table_of
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.port import SerialPort

ChildNamed = Callable[..., psutil.Process]

TRIPPED = -1
WATCHDOG_S = 0.16
PATIENCE_S = 90.0
TABLE = table_of("XM430-W350")


class Bench:
    """`flexmotion emulate`, and `flexmotion run` that walks it.

    Attributes:
        run: the process that drives; `report` what it printed, once it has ended.
    """

    def __init__(self, robot: Robot, link: Path, *options: str) -> None:
        self.robot, self.link = robot, link
        folder = ("--robot", str(robot.folder))
        self._emulator = _start("emulate", *folder, "--port-link", str(link), "--json", *options)
        end = time.monotonic() + PATIENCE_S
        while not link.exists() and time.monotonic() < end:
            time.sleep(0.05)
        self.run: subprocess.Popen[str]

    def start(self, *options: str) -> None:
        """Drive."""
        folder = ("--robot", str(self.robot.folder))
        self.run = _start("run", *folder, "-d", "dynamixel", "--port", str(self.link), "--json", *options)

    def wait_for_the_plan(self) -> None:
        """Come back once it plays."""
        assert self.run.stderr is not None
        seen = ""
        while "READY -> STREAMING" not in seen:
            line = self.run.stderr.readline()
            seen += line
            assert line, f"it ended before it streamed: {seen}"

    def end(self) -> tuple[dict[str, Any], str]:
        """The run's report (empty where it printed none) and messages."""
        out, err = self.run.communicate(timeout=PATIENCE_S)
        return json.loads(out) if out else {}, err

    def servos(self, register: str) -> list[int]:
        """What every servo has in a register now."""
        port = SerialPort(str(self.link), self.robot.config.buses["main"].baud)
        try:
            client = Client(port)
            return [client.read(joint.id, TABLE[register]) for joint in self.robot.joints]
        finally:
            port.close()

    def close(self) -> dict[str, Any]:
        """End what still runs; the emulator's figures."""
        if hasattr(self, "run"):
            for process in [*_family(self.run), self.run]:
                process.kill()
            self.run.communicate()
        self._emulator.send_signal(signal.SIGTERM)
        out, _ = self._emulator.communicate(timeout=PATIENCE_S)
        return json.loads(out)


def _start(*command: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "flexmotion.streamer", *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"COLUMNS": "200"},
        process_group=0,
    )


def _family(process: subprocess.Popen[str]) -> list[psutil.Process]:
    return psutil.Process(process.pid).children(recursive=True) if psutil.pid_exists(process.pid) else []


@pytest.fixture
def patient(tmp_path: Path) -> Robot:
    """OP3 with patience for a machine that is busy with other things."""
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    content = yaml.safe_load((folder / "op3.yaml").read_text(encoding="utf-8"))
    content["safety"]["max_stale_reads"] = 40
    (folder / "op3.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return load_robot(folder)


@pytest.fixture
def bench(patient: Robot, tmp_path: Path) -> Iterator[Bench]:
    """Servos on a bench."""
    made = Bench(patient, tmp_path / "bus", "--bench")
    yield made
    assert made.close()["violations"] == 0


@pytest.fixture
def standing(patient: Robot, tmp_path: Path) -> Iterator[Bench]:
    """Servos that carry the simulated robot."""
    made = Bench(patient, tmp_path / "bus")
    yield made
    made.close()


def test_a_run_to_its_end_leaves_torque_off(bench: Bench) -> None:
    bench.start("--seconds", "1.5")
    report, _ = bench.end()
    # A machine that is busy with other things misses deadlines, which is all that may be wrong.
    assert bench.run.returncode == (0 if report["ok"] else 1)
    assert report["safety"] == {"final_state": "OFF", "faults": [], "hardware_failed": False}
    assert not report["motion"]["fell"] and report["limits"]["violations_sent"] == 0
    assert set(bench.servos("torque_enable")) == {0} and set(bench.servos("bus_watchdog")) == {0}


def test_ctrl_c_parks_the_robot_and_leaves_torque_off(bench: Bench) -> None:
    bench.start()
    bench.wait_for_the_plan()
    time.sleep(2.0)
    for process in (psutil.Process(bench.run.pid), *_family(bench.run)):  # a terminal's reaches all of them
        process.send_signal(signal.SIGINT)
    report, err = bench.end()
    assert bench.run.returncode == 130 and "HOLD -> PARK" in err and report["safety"]["final_state"] == "OFF"
    assert set(bench.servos("torque_enable")) == {0} and set(bench.servos("bus_watchdog")) == {0}
    # The last goals were those of the rest pose (with what it takes to hold it); without torque it sinks on from there.
    parked = bench.robot.to_ticks(bench.robot.rest_pose)
    assert bench.servos("goal_position") == pytest.approx(parked, abs=150)


def _kill_all(bench: Bench, child_named: ChildNamed) -> None:
    for process in [*_family(bench.run), psutil.Process(bench.run.pid)]:
        process.kill()


def _crash_the_loop(bench: Bench, child_named: ChildNamed) -> None:
    child_named("fm-loop", bench.run.pid).send_signal(signal.SIGSEGV)


@pytest.mark.parametrize("ends", [_kill_all, _crash_the_loop], ids=["kill -9", "crash"])
def test_a_run_that_is_gone_leaves_a_robot_that_stands_stiff(
    standing: Bench, child_named: ChildNamed, ends: Callable[[Bench, ChildNamed], None]
) -> None:
    """No code of ours runs any more: it is the servos' bus watchdog that stops them."""
    standing.start()
    standing.wait_for_the_plan()
    ends(standing, child_named)
    standing.run.wait(timeout=PATIENCE_S)
    time.sleep(2 * WATCHDOG_S + 0.5)
    assert set(standing.servos("bus_watchdog")) == {TRIPPED}
    assert set(standing.servos("torque_enable")) == {1}
    goals, present = standing.servos("goal_position"), standing.servos("present_position")
    assert max(abs(a - b) for a, b in zip(goals, present, strict=True)) < 60  # its weight makes it sag a little


def test_a_port_that_another_program_holds_is_one_line_and_exit_code_3(bench: Bench) -> None:
    holder = SerialPort(str(bench.link), 2_000_000)
    try:
        for command in (
            ("run", "-r", "op3", "-d", "dynamixel", "--port", str(bench.link)),
            ("check", "bus", "--port", str(bench.link)),
            ("servo", "scan", "--port", str(bench.link)),
        ):
            done = _start(*command)
            _, err = done.communicate(timeout=PATIENCE_S)
            assert done.returncode == 3
            assert err.splitlines()[-1] == f"flexmotion: port {bench.link}: another program holds it"
            assert "Traceback" not in err
    finally:
        holder.close()
