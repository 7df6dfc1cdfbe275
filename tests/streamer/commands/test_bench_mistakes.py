"""What is told of a bus that is not as the robot file says: echoes, two servos with one id, servos that are not driven.

Two servos with one id answer alike where they are alike, and collide in bits where they are not.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from flexmotion.drivers.emulator.faults import Fault
from flexmotion.streamer.cli import execute

from ...drivers.bus.robots import op3_with
from .conftest import KNEE, PORT, Wired

BUSES = [("dynamixel2", "XM430-W350", 2_000_000), ("feetech", "STS3215-12V", 1_000_000), ("lx16a", "LX-16A", 115_200)]


@pytest.fixture(params=BUSES, ids=[protocol for protocol, _, _ in BUSES])
def bus(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[Wired, str, list[str]]:
    """A robot's servos, their protocol, and the options of tools for single servos on this bus."""
    protocol, servo, baud = request.param
    robot = op3_with(tmp_path, servo=servo, baud=baud)
    monkeypatch.chdir(tmp_path)
    options = [*PORT, "--protocol", protocol, "--baud", str(baud)]
    return Wired(robot, monkeypatch, factory=False), protocol, options


def share_an_id(it: Wired, protocol: str) -> None:
    """The servo of the right knee gets the id of the left one."""
    servos: list[Any] = it.world.emulator.lines[0].bus.servos  # type: ignore[attr-defined]
    servo = servos[it.robot.index("r_knee")]
    if protocol == "lx16a":
        servo.id = KNEE
    else:
        servo.put("id", KNEE)
        servo.renamed = True


def test_an_adapter_that_echoes_is_named_by_every_tool(
    bus: tuple[Wired, str, list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: scan found a servo at every id, check bus passed a bus that a run then refused."""
    it, protocol, options = bus
    it.world.emulator.faults[:] = [Fault.parse("echo")]
    it.world.advance(0.02)
    robot = ["--robot", str(it.robot.folder)]
    for command in (
        ["servo", "scan", *options],
        ["servo", "set-id", "14", "77", *options],
        ["servo", "watch", *PORT, *robot, "--seconds", "1"],
        ["servo", "configure", *PORT, *robot, "--yes"],
        ["servo", "adopt", "--joint", "l_knee", *PORT, *robot, "--yes"],
        ["check", "bus", *PORT, *robot],
    ):
        assert execute(command) == 3, command
        assert "port main: the adapter echoes what is sent" in capsys.readouterr().err
    assert it.tap.sent and not it.tap.writes(protocol)


def test_two_servos_with_one_id_are_told_from_a_silent_one(
    bus: tuple[Wired, str, list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: the message said that the status return level is 0, and `set-id` renamed both."""
    it, protocol, options = bus
    share_an_id(it, protocol)
    robot = ["--robot", str(it.robot.folder)]
    assert execute(["servo", "set-id", str(KNEE), "77", *options]) == 3
    err = capsys.readouterr().err
    assert "perhaps two servos have this id" in err and "nothing was written" in err
    assert not it.tap.writes(protocol)
    assert execute(["run", *robot, "--driver", protocol.removesuffix("2"), *PORT]) == 3
    assert "servo of l_knee (id 14) on main: every answer comes damaged" in capsys.readouterr().err


def test_a_servo_that_is_not_driven_is_named(
    wired: Callable[..., Wired], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: `scan` showed an XL-320 as `model 350`."""
    it = wired()
    next(servo for servo in it.bus.servos if servo.id == KNEE).put("model_number", 350)
    assert execute(["servo", "scan", *PORT, "--baud", "2000000"]) == 0
    assert "XL-320 (not supported)" in capsys.readouterr().out
    assert execute(["check", "bus", *PORT, "--robot", str(folder)]) == 3
    assert "is XL-320 (not supported) (model number 350), the robot file has XM430-W350" in capsys.readouterr().err


class _AskedForMotionError(Exception):
    """The run has looked at the bus, and goes on."""


def test_a_run_says_that_its_rate_does_not_fit_the_bus(
    bus: tuple[Wired, str, list[str]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: readings were missed without a word. Servos that are read in turns keep up with any rate."""
    it, protocol, _ = bus

    def ask(*_: object, **__: object) -> None:
        raise _AskedForMotionError

    monkeypatch.setattr("flexmotion.streamer.commands.choice.choose_source", ask)
    with pytest.raises(_AskedForMotionError):
        execute(["run", "--robot", str(it.robot.folder), "--driver", protocol.removesuffix("2"), *PORT])
    told = "bus main: 125 Hz does not fit, the highest rate is 120 Hz" in capsys.readouterr().err
    assert told is (protocol == "feetech")
