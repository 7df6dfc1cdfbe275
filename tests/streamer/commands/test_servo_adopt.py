"""`flexmotion servo adopt` makes a factory-new servo that of a joint, or leaves it as it is."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from flexmotion.streamer.cli import execute

from .conftest import KNEE, PORT, Wired


def test_a_new_servo_is_adopted_among_the_others(
    wired: Callable[..., Wired], folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    it = wired()
    knee = next(servo for servo in it.bus.servos if servo.id == KNEE)
    configured = it.memories()
    command = ["servo", "adopt", *PORT, "--robot", str(folder), "--joint", "l_knee", "--yes", "--json"]
    assert execute(command) == 3
    assert "l_knee has a servo already" in capsys.readouterr().err
    knee.factory_reset(0xFF, it.world.now)
    knee.put("model_number", 1060)
    it.world.advance(0.5)
    assert execute(command) == 3
    assert "is XL430-W250, l_knee needs XM430-W350" in capsys.readouterr().err
    knee.put("model_number", 1020)
    assert execute(command) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["id"] == {"old": 1, "new": KNEE} and told["baud"] == {"old": 57_600, "new": 2_000_000}
    assert told["changes"]["return_delay_time"] == {"old": 250, "new": 0}
    assert it.memories() == configured
    assert execute(["servo", "configure", *PORT, "--robot", str(folder), "--check"]) == 0


def test_a_servo_that_cannot_be_adopted_keeps_its_id(
    wired: Callable[..., Wired], folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Id and bit rate were written before its torque was looked at, and before its old settings were kept in a file."""
    it = wired()
    knee = next(servo for servo in it.bus.servos if servo.id == KNEE)
    knee.factory_reset(0xFF, it.world.now)
    it.world.advance(0.5)
    command = ["servo", "adopt", *PORT, "--robot", str(folder), "--joint", "l_knee", "--yes"]
    knee.put("torque_enable", 1)
    assert execute(command) == 3
    assert "torque is on, which locks its settings" in capsys.readouterr().err
    knee.put("torque_enable", 0)
    taken = tmp_path / "taken.yaml"
    taken.write_text("mine", encoding="utf-8")
    assert execute([*command, "--backup", str(taken)]) == 2
    assert (knee.id, knee.baud) == (1, 57_600) and taken.read_text(encoding="utf-8") == "mine"
    kept = tmp_path / "kept.yaml"
    assert execute([*command, "--backup", str(kept)]) == 0
    assert yaml.safe_load(kept.read_text(encoding="utf-8"))["joints"]["l_knee"]["settings"]["return_delay_time"] == 250
    assert knee.id == KNEE


def test_an_adopted_servo_is_restored_alone(
    wired: Callable[..., Wired], folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: to restore one servo, all of the robot's had to be connected."""
    it, kept = wired(factory=True, new=["l_knee"]), tmp_path / "kept.yaml"
    (knee,) = (servo for servo in it.bus.servos if servo.id == 1 and servo.baud == 57_600)
    it.bus.dead.update(servo.id for servo in it.bus.servos if servo.id not in (1, KNEE))
    here = [*PORT, "--robot", str(folder), "--yes", "--backup"]
    assert execute(["servo", "adopt", "--joint", "l_knee", *here, str(kept)]) == 0
    assert knee.id == KNEE and knee.get("return_delay_time") == 0
    assert execute(["servo", "restore", str(kept), *here, str(tmp_path / "adopted.yaml")]) == 0
    assert knee.id == KNEE and knee.get("return_delay_time") == 250


def test_of_two_new_servos_none_is_adopted(
    wired: Callable[..., Wired], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They answer pings alike; written at once, both would be the joint's."""
    it = wired(new=["l_knee", "r_knee"])
    before = it.memories()
    assert execute(["servo", "adopt", "--joint", "l_knee", *PORT, "--robot", str(folder), "--yes"]) == 3
    assert "perhaps two servos have this id" in capsys.readouterr().err
    assert it.memories() == before and not it.tap.writes("dynamixel2")
