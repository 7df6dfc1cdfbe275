"""`flexmotion servo calibrate` takes the zeros that it is shown, and writes torque enable alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.streamer.cli import execute

from .conftest import KNEE, PORT, TORQUE_ENABLE, Wired

WRITE = 3


def test_only_enter_takes_a_zero(
    wired: Callable[..., Wired], folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: every other word, such as "no" or "quit", took the angle as Enter does."""
    it = wired()
    ankle = it.robot.index("l_ank_pitch")
    it.world.emulator.body.position[ankle] = 0.1
    answers = ["no", "quit", " ", "q"]
    monkeypatch.setattr("typer.prompt", lambda *_, **__: answers.pop(0))
    names = ["--joint", "l_ank_pitch", "--joint", "head_pan"]
    assert execute(["servo", "calibrate", *PORT, "--robot", str(folder), *names]) == 0
    err = capsys.readouterr().err
    assert not answers and "'no': expected Enter, s or q" in err and "'quit': expected Enter, s or q" in err
    assert err.count("zero at") == 1 and "+5.7° from the zero before" in err
    assert not (folder / "calibration.yaml").exists()


def test_calibrate_writes_torque_enable_only(
    wired: Callable[..., Wired], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    it = wired()
    for id_ in (KNEE, 3):
        next(servo for servo in it.bus.servos if servo.id == id_).write(TORQUE_ENABLE, b"\x01")
    asked: list[str] = []

    def answer(text: str, **_: object) -> str:
        asked.append(text)
        return ""

    monkeypatch.setattr("typer.prompt", answer)
    command = ["servo", "calibrate", *PORT, "--robot", str(folder), "--joint", "l_ank_pitch"]
    assert execute(command) == 0
    assert "hold the robot" in asked[0] and "l_knee" in asked[0] and len(asked) == 2
    assert it.tap.writes("dynamixel2") == {(WRITE, TORQUE_ENABLE): 2}
    assert not it.world.emulator.body.plant.enabled.any()
    it.tap.clear()
    assert execute(command) == 0
    assert not it.tap.writes("dynamixel2"), "torque is off already"


def test_a_zero_that_the_servo_cannot_have_is_not_stored(
    wired: Callable[..., Wired],
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Regression: a zero of 2.05 rad was stored, and the folder could not be loaded any more."""
    it = wired()
    knee = it.robot.index("l_knee")
    body = it.world.emulator.body
    body.position[knee] = 2.05
    answers = ["", "q"]
    monkeypatch.setattr("typer.prompt", lambda *_, **__: answers.pop(0))
    assert execute(["servo", "calibrate", *PORT, "--robot", str(folder), "--joint", "l_knee"]) == 0
    told = capsys.readouterr()
    assert "exceed the range of XM430-W350" in told.err and "not taken" in told.err and not answers
    assert not (folder / "calibration.yaml").exists()
    assert load_robot(folder).zero[knee] == it.robot.zero[knee]


def test_a_joint_that_moves_is_not_taken_for_its_zero(
    wired: Callable[..., Wired], folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    it = wired()
    ankle = it.robot.index("l_ank_pitch")
    body = it.world.emulator.body
    answers = ["", "q"]

    def swing(*_: object, **__: object) -> str:
        body.velocity[ankle] = 6.0
        return answers.pop(0)

    monkeypatch.setattr("typer.prompt", swing)
    assert execute(["servo", "calibrate", *PORT, "--robot", str(folder), "--joint", "l_ank_pitch"]) == 0
    assert "l_ank_pitch: moves: hold it still" in capsys.readouterr().err
    assert not (folder / "calibration.yaml").exists()
