"""What a run over a servo bus leaves behind, however it ends: the robot's servos are read afterwards, in bytes.

Servos, run and clock are real here, so that a machine without time for them ends a run in one of the ways that
docs/faults.md lists. Each test accepts these, and no servo that goes on moving.
"""

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

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.dynamixel.registers import table_of
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.port import SerialPort

from ..waiting import HANGING_S

TRIPPED = -1
STOPPED_S = 1.0
"""Servos that were asked for nothing for so long have stopped: their watchdog trips after 0.16 s [s]."""
STARTING_S = 60.0
"""How long a run is started anew that ended before it streamed [s]."""
STARVED = "this machine has no time for a run on its clock; each one that was tried ended with all servos motionless"
TABLE = table_of("XM430-W350")


class Bench:
    """`flexmotion emulate`, and `flexmotion run` on the same port.

    Attributes:
        run: the process of the run that was started last.
    """

    def __init__(self, robot: Robot, link: Path, *options: str) -> None:
        self.robot, self.link = robot, link
        folder = ("--robot", str(robot.folder))
        self._emulator = _start("emulate", *folder, "--port-link", str(link), "--json", *options)
        assert self._emulator.stderr is not None
        assert str(robot.name) in self._emulator.stderr.readline()  # its port is there, and signals end it
        self.run: subprocess.Popen[str]

    def start(self, *options: str) -> None:
        """Drive."""
        folder = ("--robot", str(self.robot.folder))
        self.run = _start("run", *folder, "-d", "dynamixel", "--port", str(self.link), "--json", *options)

    def start_streaming(self) -> bool:
        """Drive, and come back once a plan plays; False where the machine has no time for it.

        A start at which servos seemed silent, or that the robot did not survive, is repeated for `STARTING_S`.
        """
        end = time.monotonic() + STARTING_S
        while True:
            self.start()
            assert self.run.stderr is not None
            seen = ""
            while line := self.run.stderr.readline():
                seen += line
                if "READY -> STREAMING" in line:
                    return True
            assert self.run.wait(HANGING_S) in (1, 3) and "Traceback" not in seen, seen
            time.sleep(STOPPED_S)
            assert self.motionless
            if time.monotonic() > end:
                return False

    def end(self) -> tuple[dict[str, Any], str]:
        """The run's report (empty where it printed none) and messages."""
        out, err = self.run.communicate(timeout=HANGING_S)
        return json.loads(out) if out else {}, err

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
        """The run has ended in a documented way; where no fault was seen, parked, all torque off."""
        assert "Traceback" not in messages
        if report and not report["safety"]["faults"]:
            assert report["safety"] == {"final_state": "OFF", "faults": [], "hardware_failed": False}
            assert set(self.servos("torque_enable")) == {0} and set(self.servos("bus_watchdog")) == {0}
        else:
            assert self.run.returncode in (1, 3, 130)
            time.sleep(STOPPED_S)
            assert self.motionless
        assert not report or report["limits"]["violations_sent"] == 0

    def close(self) -> dict[str, Any]:
        """End what still runs; the emulator's figures."""
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
    """OP3 that takes a servo for dead after 20 s without an answer."""
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    content = yaml.safe_load((folder / "op3.yaml").read_text(encoding="utf-8"))
    content["safety"]["max_stale_reads"] = 2500
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
    if report:
        assert bench.run.returncode in ({0} if report["ok"] else {1, 3})


def test_ctrl_c_parks_the_robot_and_leaves_torque_off(bench: Bench) -> None:
    if not bench.start_streaming():
        pytest.skip(STARVED)
    for process in (psutil.Process(bench.run.pid), *_family(bench.run)):  # a terminal's reaches all of them
        process.send_signal(signal.SIGINT)
    report, messages = bench.end()
    bench.check_end(report, messages)
    if report and not report["safety"]["faults"]:
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
    if not standing.start_streaming():
        pytest.skip(STARVED)
    ends(standing)
    _, messages = standing.end()
    time.sleep(STOPPED_S)  # nothing is asked meanwhile: what is read feeds the watchdogs
    if any(f"-> {state}" in messages for state in ("PARK", "DAMPED", "FAULT")):
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
