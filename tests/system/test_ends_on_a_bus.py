"""What a run over a servo bus leaves behind, however it ends: the robot's servos are read afterwards, in bytes.

Servos, run and clock are real here, so that a machine without time for them ends a run in one of the ways that
docs/faults.md lists. A test accepts these, and no servo that goes on moving, only where it measured that the machine
was late; else the run must be undisturbed.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
import yaml

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.dynamixel.registers import table_of
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.port import SerialPort

from ..waiting import HANGING_S

TRIPPED = -1
STOPPED_S = 1.0
"""Servos that were asked for nothing for so long have stopped: their watchdog trips after 0.16 s [s]."""
LATE_S = 0.024
"""A machine that lets a program sleep this much too long, three ticks, may end a run [s]."""
STARVED = "this machine has no time for a run on its clock; the one that was tried ended with all servos motionless: "
TABLE = table_of("XM430-W350")


class Lateness(threading.Thread):
    """Measures how much longer than asked this machine lets a program sleep.

    Attributes:
        worst_s: greatest lateness since it was set to 0 [s].
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.worst_s, self.ended = 0.0, False

    def run(self) -> None:
        due = time.perf_counter()
        while not self.ended:
            due += 0.002
            time.sleep(max(due - time.perf_counter(), 0.0))
            late = time.perf_counter() - due
            self.worst_s = max(self.worst_s, late)
            due += max(late, 0.0)


class Bench:
    """`flexmotion emulate`, and `flexmotion run` on the same port.

    Attributes:
        run: the process of the run.
        starved: evidence that the machine was late during the run; empty: there is none.
    """

    def __init__(self, robot: Robot, link: Path, *options: str) -> None:
        self.robot, self.link = robot, link
        folder = ("--robot", str(robot.folder))
        self._emulator = _start("emulate", *folder, "--port-link", str(link), "--json", *options)
        assert self._emulator.stderr is not None
        assert str(robot.name) in self._emulator.stderr.readline()  # its port is there, and signals end it
        self.run: subprocess.Popen[str]
        self.starved: list[str] = []
        self._lateness = Lateness()

    def start(self, *options: str) -> None:
        """Drive."""
        self._lateness.start()
        folder = ("--robot", str(self.robot.folder))
        self.run = _start("run", *folder, "-d", "dynamixel", "--port", str(self.link), "--json", *options)

    def start_streaming(self) -> None:
        """Drive, and come back once a plan plays. Skips the test where the machine was late and the run ended."""
        self.start()
        assert self.run.stderr is not None
        seen = ""
        while "READY -> STREAMING" not in seen:
            line = self.run.stderr.readline()
            seen += line
            if not line:
                report, _ = self.end()
                self.check_end(report, seen)
                assert self.starved, seen
                pytest.skip(STARVED + ", ".join(self.starved))

    def end(self) -> tuple[dict[str, Any], str]:
        """The run's report (empty where it printed none) and messages."""
        out, err = self.run.communicate(timeout=HANGING_S)
        report = json.loads(out) if out else {}
        self._lateness.ended = True
        if self._lateness.worst_s > LATE_S:
            self.starved.append(f"a program slept {1e3 * self._lateness.worst_s:.0f} ms too long")
        if report and report["loop"]["missed_deadlines"] > report["loop"]["missed_allowed"]:
            self.starved.append(f"the loop missed {report['loop']['missed_deadlines']} deadlines")
        return report, err

    def servos(self, register: str) -> list[int]:
        """What every servo has in a register now."""
        port = SerialPort(str(self.link), self.robot.config.buses["main"].baud)
        try:
            client = Client(port)
            return [self._read(client, joint.id, register) for joint in self.robot.joints]
        finally:
            port.close()

    @staticmethod
    def _read(client: Client, id_: int, register: str) -> int:
        """Ask a servo until it answers."""
        end = time.monotonic() + HANGING_S
        while True:
            try:
                return client.read(id_, TABLE[register])
            except DriverError:
                assert time.monotonic() < end

    @property
    def motionless(self) -> bool:
        """Whether every servo is off, or was stopped by its watchdog."""
        states = zip(self.servos("torque_enable"), self.servos("bus_watchdog"), strict=True)
        return all(torque == 0 or watchdog == TRIPPED for torque, watchdog in states)

    def check_end(self, report: dict[str, Any], messages: str) -> None:
        """The run has parked the robot without a fault, all torque off; where the machine was late, a fault will do."""
        assert "Traceback" not in messages
        assert not report or report["limits"]["violations_sent"] == 0
        if not self.undisturbed(report):
            assert self.starved, messages
            assert self.run.returncode in (1, 3, 130)
            time.sleep(STOPPED_S)
            assert self.motionless
            return
        assert set(self.servos("torque_enable")) == {0} and set(self.servos("bus_watchdog")) == {0}

    @staticmethod
    def undisturbed(report: dict[str, Any]) -> bool:
        """Whether the run has ended parked, without a fault or a fall."""
        parked = {"final_state": "OFF", "faults": [], "hardware_failed": False}
        return bool(report) and report["safety"] == parked and not report["motion"]["fell"]

    def close(self) -> dict[str, Any]:
        """End what still runs; the emulator's figures."""
        self._lateness.ended = True
        if hasattr(self, "run"):
            for process in [*_family(self.run), self.run]:
                process.kill()
            self.run.communicate()
        self._emulator.send_signal(signal.SIGTERM)
        out, _ = self._emulator.communicate(timeout=HANGING_S)
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
    """OP3 that takes a servo for dead after 0.32 s without an answer."""
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
    report, messages = bench.end()
    bench.check_end(report, messages)
    if bench.undisturbed(report):  # a busy machine misses deadlines, which is all that may be wrong
        assert bench.run.returncode == (0 if report["ok"] else 1)


def test_ctrl_c_parks_the_robot_and_leaves_torque_off(bench: Bench) -> None:
    bench.start_streaming()
    for process in (psutil.Process(bench.run.pid), *_family(bench.run)):  # a terminal's reaches all of them
        process.send_signal(signal.SIGINT)
    report, messages = bench.end()
    bench.check_end(report, messages)
    if bench.undisturbed(report):
        assert bench.run.returncode == 130 and "HOLD -> PARK" in messages
        # The last goals were those of the rest pose, with what it takes to hold it; without torque it sinks from there.
        parked = bench.robot.to_ticks(bench.robot.rest_pose)
        assert bench.servos("goal_position") == pytest.approx(parked, abs=150)


def _kill_all(bench: Bench) -> None:
    for process in [*_family(bench.run), psutil.Process(bench.run.pid)]:
        process.kill()


def _crash_the_loop(bench: Bench) -> None:
    for process in _family(bench.run):
        if process.name() == "fm-loop":
            process.send_signal(signal.SIGSEGV)


@pytest.mark.parametrize("ends", [_kill_all, _crash_the_loop], ids=["kill -9", "crash"])
def test_a_run_that_is_gone_leaves_a_robot_that_stands_stiff(standing: Bench, ends: Callable[[Bench], None]) -> None:
    """No code of ours runs any more: it is the servos' bus watchdog that stops them."""
    standing.start_streaming()
    ends(standing)
    _, messages = standing.end()
    time.sleep(STOPPED_S)  # nothing is asked meanwhile: what is read feeds the watchdogs
    if any(f"-> {state}" in messages for state in ("PARK", "DAMPED", "FAULT")):
        assert standing.starved, messages
        assert standing.motionless  # it had fallen, or was given up, before it was killed
        return
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
            _, err = done.communicate(timeout=HANGING_S)
            assert done.returncode == 3
            assert err.splitlines()[-1] == f"flexmotion: port {bench.link}: another program holds it"
            assert "Traceback" not in err
    finally:
        holder.close()
