"""`servo identify`: says what will move, moves it once it may, stores what it found, and leaves the robot limp."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.shared.hidden_servos import hide
from flexmotion.configs.identification import FILE, read_identification
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.streamer.cli import execute

from ...drivers.bus.wire_tap import WireTap
from ...drivers.identification.stand import plain_copy

FIGURES = {"kp": 15.5, "back_emf": 0.7, "frictionloss": 0.06, "damping": 0.1, "armature": 0.06}
TORQUE_ENABLE, EEPROM_END, WRITE = 64, 64, 3


class Hung:
    """A limp robot on a stand, on the port `main` of this process, and what commands send to it."""

    def __init__(self, hidden: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
        self.body = SimBody(hidden, SimOptions(suspended=True, extra_latency_s=0.006, timestep=0.001))
        self.world = Loopback(self.body)
        self.world.advance(1.5)
        self.tap = WireTap(self.world)
        for module in ("flexmotion.drivers.bench", "flexmotion.drivers.bus.driver", "flexmotion.drivers.port"):
            monkeypatch.setattr(f"{module}.SerialPort", self.world.open_port)
        for clock in ("monotonic", "perf_counter"):
            monkeypatch.setattr(f"time.{clock}", lambda: self.world.now)
        monkeypatch.setattr("time.sleep", self.world.advance)

    @property
    def limp(self) -> bool:
        return not self.body.plant.enabled.any()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return plain_copy(tmp_path)


@pytest.fixture
def hung(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Hung]:
    return lambda: Hung(hide(load_robot(folder), "l_knee", tmp_path, FIGURES), monkeypatch)


def arguments(folder: Path, *more: str) -> list[str]:
    return ["servo", "identify", "--joint", "l_knee", "--robot", str(folder), *more]


def test_a_dry_run_says_what_would_move_and_writes_nothing(
    hung: Callable[[], Hung], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    it = hung()
    assert execute(arguments(folder, "--port", "main", "--dry-run")) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "l_knee (XM430-W350, id 14): moves between" in said and "m/s at its farthest point" in said
    assert execute(arguments(folder, "--port", "main", "--dry-run", "--json")) == 0
    (row,) = json.loads(capsys.readouterr().out)["joints"]
    assert row["joint"] == "l_knee" and row["tip_speed_m_s"] <= 0.25
    assert it.tap.sent and not it.tap.writes("dynamixel2")
    assert it.limp and not (folder / FILE).exists()


def test_nothing_moves_unless_it_is_confirmed(
    hung: Callable[[], Hung], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    it = hung()
    monkeypatch.setattr("typer.confirm", lambda *_, **__: False)
    assert execute(arguments(folder, "--port", "main")) == 1
    assert not it.tap.writes("dynamixel2") and it.limp


def test_what_was_found_is_stored_and_used(
    hung: Callable[[], Hung], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    it = hung()
    assert execute(arguments(folder, "--port", "main", "--yes", "--json")) == 0
    content = json.loads(capsys.readouterr().out)
    (row,) = content["joints"]
    assert content["schema"] == "flexmotion.identification/1" and content["stored"] == str(folder / FILE)
    assert not row["refused"] and row["figures"]["kp"]["unit"] == "N·m/rad"
    assert it.limp and it.body.receiver.violations == 0
    # Nothing that the servos keep without power was written.
    kept = [address for _, address in it.tap.writes("dynamixel2") if 0 <= address < EEPROM_END]
    assert not kept

    stored = read_identification(folder).joints["l_knee"]
    assert (stored.servo, stored.id) == ("XM430-W350", 14)
    robot = load_robot(folder)
    knee = robot.index("l_knee")
    assert robot.kp[knee] == pytest.approx(FIGURES["kp"], rel=0.1)
    assert robot.back_emf[knee] == pytest.approx(FIGURES["back_emf"], rel=0.1)
    assert robot.model.dof_armature[robot.dof_address[knee]] == pytest.approx(FIGURES["armature"], rel=0.1)
    assert robot.model.dof_frictionloss[robot.dof_address[knee]] == pytest.approx(FIGURES["frictionloss"], rel=0.1)


def test_a_robot_that_stands_is_not_touched(
    hung: Callable[[], Hung], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    it = hung()
    it.body.set_torque(np.ones(it.body.robot.n, np.bool_), on=True)
    for servo in it.world.emulator.lines[0].bus.servos:  # type: ignore[attr-defined]
        servo.put("torque_enable", 1)
    assert execute(arguments(folder, "--port", "main", "--yes")) == 3
    assert "torque is on in: head_pan" in capsys.readouterr().err
    assert not it.tap.writes("dynamixel2") and it.body.plant.enabled.all()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ([], "expected either --port"),
        (["--port", "main", "--log", "{log}"], "expected either --port"),
        (["--log", "{log}", "--amplitude", "0.3"], "--amplitude and --dry-run are for a motion"),
        (["--log", "{log}"], "damaged, or not a log of FlexMotion"),
        (["--port", "main", "--joint", "knee"], "unknown joint 'knee', did you mean"),
    ],
)
def test_wrong_arguments_are_named(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], message: str
) -> None:
    log = tmp_path / "no.mcap"
    log.write_bytes(b"no log")
    assert execute(arguments(folder, *(each.format(log=log) for each in more))) == 2
    assert message in capsys.readouterr().err


def test_figures_of_one_robot_are_not_stored_with_the_shipped_one(
    hung: Callable[[], Hung], capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: they were written to the program's folder, for every robot of this kind."""
    it = hung()
    shipped = ["servo", "identify", "--joint", "l_knee", "--robot", "op3", "--port", "main"]
    assert execute([*shipped, "--yes"]) == 2
    assert "--robot op3: a shipped robot, whose folder is the program's; copy" in capsys.readouterr().err
    assert not it.tap.sent
    assert execute([*shipped, "--dry-run"]) == 0
