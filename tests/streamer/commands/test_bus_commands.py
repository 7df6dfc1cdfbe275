from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot import ROBOTS, load_robot
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.build import build_emulator
from flexmotion.streamer.checks.bus_check import check_buses
from flexmotion.streamer.cli import execute

from ...waiting import HANGING_S, wait_until

pytestmark = pytest.mark.wall_clock


@pytest.fixture
def port(tmp_path: Path) -> Iterator[Path]:
    """The bus of OP3's servos, new from the shop, emulated on a bench by the command itself."""
    link = tmp_path / "emulated"
    command = [sys.executable, "-m", "flexmotion.streamer", "emulate", "--bench", "--no-realtime", "--json"]
    process = subprocess.Popen([*command, "--port-link", str(link)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stderr is not None
    assert b"op3" in process.stderr.readline()  # the port is there, and signals end it
    yield link
    process.send_signal(signal.SIGTERM)
    output, _ = process.communicate(timeout=HANGING_S)
    assert process.returncode == 0
    assert json.loads(output)["violations"] == 0
    assert not os.path.lexists(link)


def succeed(capsys: pytest.CaptureFixture[str], *command: str) -> str:
    """Repeat a command until its exit code is 0; its output. A machine may keep answers from it for too long."""

    def succeeds() -> bool:
        capsys.readouterr()
        return execute([*command]) == 0

    wait_until(succeeds, " ".join(command))
    return capsys.readouterr().out


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
    assert execute(["check", "bus", "--port", "/dev/nowhere"]) == 3
    assert capfd.readouterr().err == "flexmotion: port /dev/nowhere: there is no such device\n"


def test_servos_are_audited_found_renamed_and_watched(port: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bus = ["--port", str(port), "--baud", "2000000"]

    def found() -> list[int]:
        """What a scan finds."""
        capsys.readouterr()
        execute(["servo", "scan", *bus, "--json"])
        out = capsys.readouterr().out
        return [each["id"] for each in json.loads(out)] if out else []

    def rename(old: int, new: int) -> None:
        def renamed() -> bool:
            return execute(["servo", "set-id", str(old), str(new), *bus]) == 0 or new in found()

        wait_until(renamed, f"servo {old} to be servo {new}")

    assert execute(["check", "bus", "--port", str(port), "--json"]) == 3  # new servos: their limits are wide open
    succeed(capsys, "check", "bus", "--port", str(port), "--configure", "--json")
    servos = json.loads(succeed(capsys, "check", "bus", "--port", str(port), "--json"))["servos"]
    assert len(servos) == 20 and {servo["voltage"] for servo in servos} == {12.0}

    wait_until(lambda: found() == [*range(1, 21), 200], "all servos to answer a scan")
    # Went wrong: a scan that found no servo exited with 0.
    assert execute(["servo", "scan", "--port", str(port), "--baud", "57600"]) == 1
    assert "no servo answers" in capsys.readouterr().err
    rename(14, 77)
    assert execute(["servo", "watch", "--port", str(port), "--seconds", "0.2", "--json"]) == 3  # id 14 is missing
    rename(77, 14)

    def fresh() -> bool:
        capsys.readouterr()
        if execute(["servo", "watch", "--port", str(port), "--seconds", "1", "--json"]):
            return False
        rows = json.loads(capsys.readouterr().out)
        assert [row["id"] for row in rows] == [joint.id for joint in load_robot("op3").joints]
        return max(row["missed_reads"] for row in rows) < 10

    # Went wrong: read ten times a second, no answer could be told from an old one, and no value shown was fresh.
    wait_until(fresh, "values that are fresh")
    succeed(capsys, "servo", "reboot", "14", *bus)


class _Slow(io.StringIO):
    """An operator who takes some time."""

    def readline(self, *size: int) -> str:
        time.sleep(0.4)
        return super().readline(*size)


def test_a_joint_is_calibrated_by_hand(
    port: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    wanted = ["servo", "calibrate", "--port", str(port), "--robot", str(folder), "--joint", "l_ank_pitch", "--json"]
    monkeypatch.setattr("sys.stdin", io.StringIO("q\n"))
    assert execute(wanted) == 0 and not (folder / "calibration.yaml").exists()
    capsys.readouterr()

    def calibrated() -> bool:
        monkeypatch.setattr("sys.stdin", _Slow("\n"))
        return execute(wanted) == 0

    # The operator presses Enter with the ankle at its angle of the stand pose, after a while. Went wrong: after a while
    # the first answer is not believed, and the servo was said to be silent.
    wait_until(calibrated, "the calibration")
    robot = load_robot(folder)
    ankle = robot.index("l_ank_pitch")
    assert robot.zero[ankle] == pytest.approx(load_robot("op3").stand_pose[ankle], abs=0.002)


def test_an_imu_is_calibrated_from_two_attitudes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    sits, up = Rotation.from_euler("zy", [90, 20], degrees=True), np.array([0.0, 0.0, 9.81])
    emulator = build_emulator(BenchBody(load_robot(folder)))
    attitudes: list[float] = []

    def show(what: str, **_: object) -> str:
        """The operator brings the torso there; the robot file does not know yet how the sensor sits in it."""
        torso = Rotation.from_euler("y", attitudes.pop(0), degrees=True)
        emulator.body.accel[:] = sits.inv().apply(torso.inv().apply(up))
        return ""

    monkeypatch.setattr("typer.prompt", show)
    thread = threading.Thread(target=emulator.run, daemon=True)
    thread.start()
    try:
        port = emulator.lines[0].terminal.path

        def calibrated() -> bool:
            attitudes[:] = 0.0, 40.0
            return execute(["servo", "calibrate-imu", "--port", port, "--robot", str(folder), "--json"]) == 0

        wait_until(calibrated, "the calibration")
    finally:
        emulator.stop()
        thread.join()
        emulator.close()
    assert json.loads(capsys.readouterr().out)["driver"] == "opencr"
    imu = load_robot(folder).config.imu
    assert imu is not None
    assert (Rotation.from_quat(imu.quaternion, scalar_first=True) * sits.inv()).magnitude() < 0.005


def test_an_unknown_fault_is_bad_usage(capfd: pytest.CaptureFixture[str]) -> None:
    assert execute(["emulate", "--fault", "fire"]) == 2
    assert "KIND one of: lost, corrupt" in capfd.readouterr().err


def test_a_link_that_exists_is_not_replaced(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    precious = tmp_path / "precious"
    precious.write_text("mine", encoding="utf-8")
    assert execute(["emulate", "--bench", "--port-link", str(precious)]) == 2
    assert precious.read_text(encoding="utf-8") == "mine"
