"""Tools that look write nothing; settings are written by `servo configure` alone, and brought back by `restore`.

Writes are counted in the bytes that the host sends.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
import yaml

from flexmotion.configs.robot import Robot
from flexmotion.drivers.bench import Bench
from flexmotion.drivers.dynamixel.packet import Error
from flexmotion.drivers.dynamixel.tools import DynamixelTools
from flexmotion.drivers.emulator.feetech_bus import EmulatedFeetechBus
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.registry import create
from flexmotion.streamer.cli import execute

from ...drivers.bus.robots import op3_with
from .conftest import KNEE, PORT, TORQUE_ENABLE, Wired


def test_watch_scan_and_audit_write_nothing(
    wired: Callable[..., Wired], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: `servo watch` wrote gains, limits and indirect addresses of every servo."""
    it = wired(factory=True)
    assert execute(["servo", "watch", *PORT, "--robot", str(folder), "--seconds", "1", "--json"]) == 0
    out, err = capsys.readouterr()
    rows = json.loads(out)
    assert [row["id"] for row in rows] == [joint.id for joint in it.robot.joints]
    assert rows[0]["missed_reads"] == 0 and rows[0]["voltage"] == 12.0
    assert rows[it.robot.index("l_knee")]["position_rad"] == pytest.approx(
        it.robot.stand_pose[it.robot.index("l_knee")], abs=0.002
    )
    assert "servo of l_knee (id 14) on main: is not configured" in err and "min_position_limit 0 (wanted" in err
    assert execute(["servo", "scan", *PORT, "--baud", "2000000"]) == 0
    assert execute(["check", "bus", *PORT, "--robot", str(folder)]) == 2
    assert execute(["servo", "configure", *PORT, "--robot", str(folder), "--check"]) == 1
    assert len(it.tap.sent) > 1000 and not it.tap.writes("dynamixel2")


@pytest.mark.parametrize(
    ("servo", "protocol", "baud"), [("STS3215-12V", "feetech", 1_000_000), ("LX-16A", "lx16a", 115_200)]
)
def test_other_servos_are_watched_without_a_write(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    servo: str,
    protocol: str,
    baud: int,
) -> None:
    robot = op3_with(tmp_path, servo=servo, baud=baud)
    it = Wired(robot, monkeypatch, factory=True)
    robot_file = str(robot.folder)
    assert execute(["servo", "watch", *PORT, "--robot", robot_file, "--seconds", "1", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    knee = robot.index("l_knee")
    assert rows[knee]["position_rad"] == pytest.approx(robot.stand_pose[knee], abs=0.01)
    assert rows[knee]["missed_reads"] == 0
    assert execute(["servo", "scan", *PORT, "--protocol", protocol, "--baud", str(baud)]) == 0
    assert it.tap.sent and not it.tap.writes(protocol)


@pytest.mark.parametrize(("missed", "told"), [(2, False), (99, True)])
def test_servos_that_were_not_read_are_marked_in_the_audit(
    missed: int,
    told: bool,
    wired: Callable[..., Wired],
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Regression: a servo that had lost one answer was shown at 0.0 rad and nan V."""
    knee, read, reads = wired().robot.index("l_knee"), Bench.read, []

    def lossy(bench: Bench, state: RobotState) -> None:
        reads.append(1)
        before = state.position[knee], state.voltage[knee]
        read(bench, state)
        if len(reads) <= missed:
            state.position[knee], state.voltage[knee] = before
            state.stale[knee] = len(reads)

    monkeypatch.setattr(Bench, "read", lossy)
    audit = ["check", "bus", *PORT, "--robot", str(folder)]
    assert execute([*audit, "--json"]) == 0
    servos = {servo["joint"]: servo for servo in json.loads(capsys.readouterr().out)["servos"]}
    assert (servos["l_knee"]["position_rad"] is None) is told and servos["r_knee"]["voltage"] == 12.0
    reads.clear()
    assert execute(audit) == 0
    assert ("not read" in capsys.readouterr().out) is told


def test_a_run_on_servos_from_the_shop_exits_2_and_names_one(
    wired: Callable[..., Wired], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: 11 servos were changed before the twelfth was refused."""
    it = wired(factory=True, simulated_clock=False)
    before = it.memories()
    command = ["run", "--robot", str(folder), "--driver", "dynamixel", *PORT, "--seconds", "1", "--no-realtime"]
    assert execute(command) == 2
    err = capsys.readouterr().err
    assert "is not configured: min_position_limit is 0, the robot file wants" in err
    assert "(19 other servos too); `flexmotion servo configure`" in err
    assert it.memories() == before


class _PreparedError(Exception):
    """The motion of a run was asked for."""


def test_the_bus_is_looked_at_before_a_run_prepares_anything(
    wired: Callable[..., Wired], folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: motion was loaded and planned first, which takes a slow machine a minute."""

    def prepare(*_: object, **__: object) -> None:
        raise _PreparedError

    monkeypatch.setattr("flexmotion.streamer.commands.choice.choose_source", prepare)
    monkeypatch.setattr("flexmotion.streamer.run.parts.Retargeter", prepare)
    command = ["run", "--robot", str(folder), "--driver", "dynamixel"]
    it = wired(factory=True)
    for options in ([], ["--wait"]):
        assert execute([*command, *PORT, *options]) == 2
        assert "is not configured" in capsys.readouterr().err
    assert it.tap.sent and not it.tap.writes("dynamixel2")

    it = wired()
    with pytest.raises(_PreparedError):
        execute([*command, *PORT])
    assert it.tap.sent and not it.tap.writes("dynamixel2")
    assert execute([*command, "--port", "elsewhere"]) == 3
    with pytest.raises(_PreparedError):
        execute([*command, "--port", "elsewhere", "--wait"])


def test_configure_shows_stores_and_writes_and_the_second_start_writes_no_eeprom(
    wired: Callable[..., Wired], folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    it = wired(factory=True)
    knee = next(servo for servo in it.bus.servos if servo.id == KNEE)
    for name, value in {"operating_mode": 5, "pwm_limit": 500, "goal_pwm": 500, "homing_offset": 77}.items():
        knee.put(name, value)
    knee.put("status_return_level", 1)
    before = it.memories()
    configure = ["servo", "configure", *PORT, "--robot", str(folder)]

    old = tmp_path / "old.yaml"
    assert execute([*configure, "--yes", "--backup", str(old), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["written"] and told["backup"] == str(old)
    mine = {row["setting"]: (row["old"], row["new"]) for row in told["changes"] if row["id"] == KNEE}
    assert mine["operating_mode"] == (5, 3) and mine["homing_offset"] == (77, 0) and mine["pwm_limit"] == (500, 885)
    assert list(mine)[0] == "operating_mode", "the mode resets what comes after it"
    kept = yaml.safe_load(old.read_text(encoding="utf-8"))["joints"]["l_knee"]
    assert (kept["id"], kept["settings"]["pwm_limit"], kept["settings"]["operating_mode"]) == (KNEE, 500, 5)
    assert execute([*configure, "--check"]) == 0

    # Two starts: RAM only.
    configured = it.memories()
    for _ in range(2):
        it.tap.clear()
        driver = create("dynamixel", it.robot, port="main")
        driver.open()
        driver.close()
        addresses = {address for (_, address) in it.tap.writes("dynamixel2")}
        assert addresses and min(addresses) >= TORQUE_ENABLE
    assert it.memories() == configured

    restore = ["servo", "restore", str(old), *PORT, "--robot", str(folder), "--yes"]
    last = it.bus.servos[-1]
    last.write(TORQUE_ENABLE, b"\x01")
    capsys.readouterr()
    # The servos before it were written already: torque was looked for in servos that differ from the robot file alone.
    assert execute(restore) == 3 and "torque is on, which locks" in capsys.readouterr().err
    last.write(TORQUE_ENABLE, b"\x00")
    assert it.memories() == configured
    assert execute(restore) == 0
    assert it.memories() == before
    assert len(list(tmp_path.glob("op3-servos-*.yaml"))) == 1, "restore keeps what it replaces too"


def test_configure_writes_nothing_where_it_is_declined_or_a_servo_is_locked_or_missing(
    wired: Callable[..., Wired],
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    it = wired(factory=True)
    before = it.memories()
    configure = ["servo", "configure", *PORT, "--robot", str(folder)]
    monkeypatch.setattr("typer.confirm", lambda *_, **__: False)
    assert execute(configure) == 1
    assert "min_position_limit" in capsys.readouterr().out
    last = it.bus.servos[-1]
    last.write(TORQUE_ENABLE, b"\x01")
    assert execute([*configure, "--yes"]) == 3
    assert "torque is on, which locks" in capsys.readouterr().err
    last.write(TORQUE_ENABLE, b"\x00")
    last.put("id", 99)
    assert execute([*configure, "--yes"]) == 3
    assert "does not answer" in capsys.readouterr().err
    last.put("id", it.robot.joints[-1].id)
    taken = tmp_path / "taken.yaml"
    taken.write_text("mine", encoding="utf-8")
    assert execute([*configure, "--yes", "--backup", str(taken)]) == 2
    assert it.memories() == before and taken.read_text(encoding="utf-8") == "mine"


def test_a_servo_that_refuses_in_the_middle_is_named_with_the_way_back(
    wired: Callable[..., Wired],
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    it = wired(factory=True)
    before = it.memories()
    stubborn = it.bus.servos[7]
    written = stubborn.written

    def refuse(name: str, value: int) -> int:
        return Error.RANGE if name == "max_position_limit" else written(name, value)

    monkeypatch.setattr(stubborn, "written", refuse)
    old = tmp_path / "old.yaml"
    common = [*PORT, "--robot", str(folder), "--yes"]
    assert execute(["servo", "configure", *common, "--backup", str(old)]) == 3
    err = capsys.readouterr().err
    joint = next(joint for joint in it.robot.joints if joint.id == stubborn.id)
    limit = yaml.safe_load(old.read_text(encoding="utf-8"))["joints"][joint.name]["settings"]["max_position_limit"]
    assert f"servo of {joint.name} (id {stubborn.id}) on main: max_position_limit " in err and limit == 4095
    assert "is not written" in err and "refused: range error" in err and f"servo restore {old}" in err
    assert it.memories() != before
    assert execute(["servo", "restore", str(old), *common]) == 0
    assert it.memories() == before


def test_an_interrupt_in_the_middle_names_the_way_back(
    wired: Callable[..., Wired],
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Regression: after Ctrl-C among the writes nothing was said: one servo was written, the others were not."""
    it = wired(factory=True)
    before, write, writes = it.memories(), DynamixelTools.write_settings, []

    def interrupted(tools: DynamixelTools, robot: Robot, joint: int, settings: Mapping[str, int]) -> None:
        writes.append(joint)
        if len(writes) == 2:
            raise KeyboardInterrupt
        write(tools, robot, joint, settings)

    monkeypatch.setattr(DynamixelTools, "write_settings", interrupted)
    old = tmp_path / "old.yaml"
    common = [*PORT, "--robot", str(folder), "--yes"]
    assert execute(["servo", "configure", *common, "--backup", str(old)]) == 130
    assert f"a part may be written; `flexmotion servo restore {old}`" in capsys.readouterr().err
    assert it.memories() != before
    assert execute(["servo", "restore", str(old), *common]) == 0
    assert it.memories() == before


def test_an_interrupt_while_old_values_are_stored_leaves_no_part_of_a_file(
    wired: Callable[..., Wired], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: a file of 20 lines of 283 stayed behind, which `servo restore` could not read."""
    it = wired(factory=True)
    before, old = it.memories(), tmp_path / "old.yaml"

    def interrupt(_descriptor: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("flexmotion.drivers.bus.settings_file.os.fsync", interrupt)
    configure = ["servo", "configure", *PORT, "--robot", str(folder), "--yes", "--backup", str(old)]
    assert execute(configure) == 130
    assert not old.exists() and it.memories() == before


def test_the_audit_of_a_watch_says_which_angles_may_be_wrong(
    wired: Callable[..., Wired], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: 20 servos that lacked only their position limits were said to show another angle."""
    it = wired(factory=True)
    next(servo for servo in it.bus.servos if servo.id == KNEE).put("homing_offset", 100)
    assert execute(["servo", "watch", *PORT, "--robot", str(folder), "--seconds", "0.1"]) == 0
    out, err = capsys.readouterr()
    wrong = [line for line in err.splitlines() if "the angle shown may be wrong" in line]
    assert len(wrong) == 1 and "l_knee" in wrong[0] and err.count("is not configured") == it.robot.n
    # Regression: on a terminal of 80 columns the table had l_hip_pit… and l_sho_pit….
    assert all(name in out for name in it.robot.joint_names) and "…" not in out


@pytest.mark.parametrize("amplitude", ["-3", "0", "nan"])
def test_an_amplitude_that_is_none_is_bad_usage(
    wired: Callable[..., Wired], folder: Path, capsys: pytest.CaptureFixture[str], amplitude: str
) -> None:
    """Regression: it was looked at after the whole bus had been read, and counted as a failure of the hardware."""
    it = wired()
    command = ["servo", "identify", *PORT, "--robot", str(folder), "--joint", "l_el", "--dry-run"]
    assert execute([*command, "--amplitude", amplitude]) == 2
    assert "--amplitude" in capsys.readouterr().err and not it.tap.sent


def test_a_feetech_servo_is_configured_and_restored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = op3_with(tmp_path, servo="STS3215-12V", baud=1_000_000)
    it = Wired(robot, monkeypatch, factory=False)
    monkeypatch.chdir(tmp_path)
    bus = it.world.emulator.lines[0].bus  # type: ignore[attr-defined]
    assert isinstance(bus, EmulatedFeetechBus)
    bus.servos[3].put("homing_offset", -80)
    old = tmp_path / "old.yaml"
    common = [*PORT, "--robot", str(robot.folder), "--yes"]
    assert execute(["servo", "configure", *common, "--backup", str(old)]) == 0
    assert bus.servos[3].get("homing_offset") == 0 and bus.servos[3].get("lock") == 1
    assert execute(["servo", "restore", str(old), *common]) == 0
    assert bus.servos[3].get("homing_offset") == -80 and bus.servos[3].get("lock") == 1


def test_servos_without_power_are_not_switched_on_by_looking(
    wired: Callable[..., Wired], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    it = wired()
    board = next(device for device in it.bus.devices if device.id == 200)
    board.write(24, b"\x00")
    it.bus._powered = False
    common = [*PORT, "--robot", str(folder)]
    assert execute(["servo", "watch", *common, "--seconds", "0.2"]) == 3
    assert "OpenCR (id 200) has the power of the servos switched off" in capsys.readouterr().err
    assert not it.tap.writes("dynamixel2")
    assert execute(["servo", "configure", *common]) == 0
    assert it.bus._powered
