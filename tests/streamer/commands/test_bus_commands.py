from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.dynamixel_bus import EmulatedDynamixelBus
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.port import SerialPort
from flexmotion.streamer.checks.bus_check import check_buses
from flexmotion.streamer.cli import execute

from ...waiting import HANGING_S

OPERATOR_S = 0.4
"""How long an operator takes to answer [s]."""


@pytest.fixture
def connected(monkeypatch: pytest.MonkeyPatch) -> Callable[[Robot], Loopback]:
    """Function (robot) -> its servos on a bench, configured, on the port `main` of this process.

    Commands run on the simulated clock of the bus: no machine is too slow for an answer.
    """

    def connect(robot: Robot) -> Loopback:
        world = Loopback(BenchBody(robot))
        # Port last: a module that is imported while it is replaced would keep the replacement.
        for module in ("flexmotion.drivers.bench", "flexmotion.drivers.bus.driver", "flexmotion.drivers.port"):
            monkeypatch.setattr(f"{module}.SerialPort", world.open_port)
        monkeypatch.setattr(time, "sleep", world.advance)
        monkeypatch.setattr(time, "monotonic", lambda: world.now)
        monkeypatch.setattr(time, "perf_counter", lambda: world.now)
        return world

    return connect


@pytest.fixture
def succeed(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Function (command ...) -> what it prints; its exit code must be 0."""

    def run(*command: str) -> str:
        capsys.readouterr()
        code = execute([*command])
        out, err = capsys.readouterr()
        assert code == 0, err
        return out

    return run


def test_op3_fits_its_own_rate_and_not_a_thousand_hertz(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["check", "bus", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    (bus,) = report["buses"]
    assert report["ok"] and (bus["read_bytes"], bus["write_bytes"]) == (379, 114)
    assert bus["read_ms"] == pytest.approx(1.895) and 125 < bus["highest_rate_hz"] < 1000
    assert execute(["check", "bus", "--rate", "1000"]) == 1


def test_a_slower_loop_always_fits() -> None:
    robot = load_robot("op3")
    highest = check_buses(robot, 1.0)[0].highest_hz
    assert check_buses(robot, highest * 0.99)[0].fits and not check_buses(robot, highest * 1.01)[0].fits


def test_a_port_that_is_not_there_is_one_line_and_exit_code_3(capfd: pytest.CaptureFixture[str]) -> None:
    """Regression: the budget, which needs no port, was not printed."""
    assert execute(["check", "bus", "--port", "/dev/nowhere"]) == 3
    out, err = capfd.readouterr()
    assert err == "flexmotion: port /dev/nowhere: there is no such device\n" and "379 B, 1.90 ms" in out


def test_an_audit_that_fails_prints_what_it_has_read_first(
    connected: Callable[[Robot], Loopback], capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: it printed neither budget nor servos."""
    robot = load_robot("op3")
    world, knee = connected(robot), robot.index("l_knee")
    world.emulator.faults[:] = [Fault.parse("dead:14")]
    audit = ["check", "bus", "--port", "main"]
    assert execute([*audit, "--json"]) == 3
    out, err = capsys.readouterr()
    report = json.loads(out)
    assert not report["ok"] and report["buses"][0]["fits"]
    assert report["servos"][knee]["voltage"] is None and report["servos"][knee - 1]["voltage"] == 12.0
    assert "servo of l_knee (id 14) on main: does not answer" in report["failure"] and report["failure"] in err

    world.emulator.faults.clear()
    bus = world.emulator.lines[0].bus
    assert isinstance(bus, EmulatedDynamixelBus)
    next(servo for servo in bus.servos if servo.id == 14).put("secondary_id", 3)
    assert execute(audit) == 2
    out, err = capsys.readouterr()
    assert "379 B, 1.90 ms" in out and out.count("XM430-W350") == 20
    assert "is not configured: secondary_id is 3" in err


def test_servos_are_audited_found_renamed_and_watched(
    connected: Callable[[Robot], Loopback], succeed: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    world = connected(load_robot("op3"))
    port = ["--port", "main"]
    bus = [*port, "--baud", "2000000"]

    servos = json.loads(succeed("check", "bus", *port, "--json"))["servos"]
    assert len(servos) == 20 and {servo["voltage"] for servo in servos} == {12.0}

    found = json.loads(succeed("servo", "scan", *bus, "--json"))
    assert [each["id"] for each in found] == [*range(1, 21), 200]
    # Went wrong: a scan that found no servo exited with 0.
    assert execute(["servo", "scan", *port, "--baud", "57600"]) == 1
    assert "no servo of dynamixel2 answers" in capsys.readouterr().err
    assert execute(["servo", "scan", *port, "--baud", "12345"]) == 1
    assert "--baud 12345: no rate of servos of dynamixel2, theirs are 9600, 57600" in capsys.readouterr().err
    succeed("servo", "set-id", "14", "77", *bus)
    capsys.readouterr()
    # Went wrong: with one servo missing, none was shown.
    assert execute(["servo", "watch", *port, "--seconds", "0.2", "--json"]) == 3
    out, err = capsys.readouterr()
    rows = json.loads(out)
    assert {row["position_rad"] for row in rows if row["id"] == 14} == {None}
    missed = {row["id"]: row["missed_reads"] > 0 for row in rows}
    assert missed.pop(14) and len(missed) == 19 and not any(missed.values())
    assert "servo of l_knee (id 14) on main: does not answer at 2000000 baud" in err
    succeed("servo", "set-id", "77", "14", *bus)

    rows = json.loads(succeed("servo", "watch", *port, "--seconds", "1", "--json"))
    assert [row["id"] for row in rows] == [joint.id for joint in load_robot("op3").joints]
    assert {row["missed_reads"] for row in rows} == {0}
    succeed("servo", "reboot", "14", *bus)
    assert world.emulator.body.receiver.violations == 0


def test_a_joint_is_calibrated_by_hand(
    connected: Callable[[Robot], Loopback],
    succeed: Callable[..., str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    world = connected(load_robot(folder))
    wanted = ["servo", "calibrate", "--port", "main", "--robot", str(folder), "--joint", "l_ank_pitch", "--json"]
    answers = ["q", ""]

    def answer(*_: object, **__: object) -> str:
        world.advance(OPERATOR_S)
        return answers.pop(0)

    monkeypatch.setattr("typer.prompt", answer)
    succeed(*wanted)
    assert not (folder / "calibration.yaml").exists()
    # The operator presses Enter with the ankle at its angle of the stand pose, after a while. Went wrong: after a while
    # the first answer is not believed, and the servo was said to be silent.
    succeed(*wanted)
    robot = load_robot(folder)
    ankle = robot.index("l_ank_pitch")
    assert robot.zero[ankle] == pytest.approx(load_robot("op3").stand_pose[ankle], abs=0.002)


def test_an_imu_is_calibrated_from_two_attitudes(
    connected: Callable[[Robot], Loopback],
    succeed: Callable[..., str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    sits, up = Rotation.from_euler("zy", [90, 20], degrees=True), np.array([0.0, 0.0, 9.81])
    world = connected(load_robot(folder))
    attitudes = [0.0, 40.0]

    def show(what: str, **_: object) -> str:
        """The operator brings the torso there; the robot file does not know yet how the sensor sits in it."""
        torso = Rotation.from_euler("y", attitudes.pop(0), degrees=True)
        world.emulator.body.accel[:] = sits.inv().apply(torso.inv().apply(up))
        world.advance(OPERATOR_S)
        return ""

    monkeypatch.setattr("typer.prompt", show)
    out = succeed("servo", "calibrate-imu", "--port", "main", "--robot", str(folder), "--json")
    assert json.loads(out)["driver"] == "opencr"
    imu = load_robot(folder).config.imu
    assert imu is not None
    assert (Rotation.from_quat(imu.quaternion, scalar_first=True) * sits.inv()).magnitude() < 0.005


@pytest.mark.wall_clock
def test_the_emulator_serves_a_terminal_until_it_is_ended(tmp_path: Path) -> None:
    link = tmp_path / "emulated"
    command = [sys.executable, "-m", "flexmotion.streamer", "emulate", "--bench", "--no-realtime", "--json"]
    process = subprocess.Popen([*command, "--port-link", str(link)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        assert process.stderr is not None
        assert b"op3" in process.stderr.readline()  # the port is there, and signals end it
        assert link.exists()
        SerialPort(str(link), 2_000_000).close()
        process.send_signal(signal.SIGTERM)
        output, _ = process.communicate(timeout=HANGING_S)
    finally:
        process.kill()
    assert process.returncode == 0
    assert json.loads(output)["violations"] == 0
    assert not os.path.lexists(link)


def test_an_unknown_fault_is_bad_usage(capfd: pytest.CaptureFixture[str]) -> None:
    assert execute(["emulate", "--fault", "fire"]) == 2
    assert "KIND one of: lost, corrupt" in capfd.readouterr().err


def test_a_link_that_exists_is_not_replaced(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    precious = tmp_path / "precious"
    precious.write_text("mine", encoding="utf-8")
    assert execute(["emulate", "--bench", "--port-link", str(precious)]) == 2
    assert precious.read_text(encoding="utf-8") == "mine"
