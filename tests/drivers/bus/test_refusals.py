"""Unsupported hardware is refused before anything moves, with the reason in one line."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
import yaml

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.configs.servo import find_servo
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.port import SerialPort
from flexmotion.drivers.registry import create

from .robots import op3_with


@pytest.mark.parametrize(
    ("servo", "why"),
    [
        ("AX-12A", "has Dynamixel Protocol 1"),
        ("XL-320", "with another control table"),
        ("YM070-210-R051-RH", "error codes in the place of error bits"),
        ("H54-200-S500-R(A)", "with another control table"),
        ("MX-64", r"Protocol 1, or after an update 2.0, then name it with \(2.0\), as MX-64\(2.0\)"),
        ("AK60-6", "is on a CAN bus"),
        ("SCS0009", "no sync read"),
    ],
)
def test_servos_without_a_driver(servo: str, why: str) -> None:
    with pytest.raises(ConfigError, match=f"servo '{re.escape(servo)}' .*{why}.*: it needs a driver plug-in"):
        find_servo(servo)


def test_a_can_interface_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "can0").mkdir()
    monkeypatch.setattr("flexmotion.drivers.port.NETWORK", tmp_path)
    with pytest.raises(DriverError, match="port can0: is a CAN or network interface, not a serial port"):
        SerialPort("can0", 1_000_000)


def test_a_servo_with_protocol_1_is_named(tmp_path: Path) -> None:
    """Feetech's packets have the format of Protocol 1."""
    world = Loopback(BenchBody(op3_with(tmp_path, servo="STS3215-12V", baud=1_000_000)))
    driver = create("dynamixel", op3_with(tmp_path, servo="XM430-W350", baud=1_000_000), port="main")
    driver.open_port = world.open_port  # type: ignore[attr-defined]
    with pytest.raises(DriverError, match=r"head_pan \(id 19\) on main: uses Protocol 1, or is a Feetech servo"):
        driver.open()


@pytest.fixture
def coupled(tmp_path: Path) -> Robot:
    """OP3 with the joints of its head coupled, as by a differential."""
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    mjcf = folder / "op3.xml"
    text = mjcf.read_text(encoding="utf-8")
    differential = '<equality><joint name="neck" joint1="head_pan" joint2="head_tilt"/></equality>'
    mjcf.write_text(text.replace("</mujoco>", f"{differential}</mujoco>"), encoding="utf-8")
    return load_robot(folder)


def test_coupled_joints(coupled: Robot) -> None:
    with pytest.raises(ConfigError, match=r"op3\.xml couples joints \(neck\): differentials and linkages need a"):
        create("dynamixel", coupled, port="main")
    assert create("sim", coupled).robot is coupled  # the simulation supports couplings


def test_two_joints_of_one_servo(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    content = yaml.safe_load((folder / "op3.yaml").read_text(encoding="utf-8"))
    content["joints"][1]["id"] = content["joints"][0]["id"]
    (folder / "op3.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(ConfigError, match="joint 'head_tilt': id 19 on bus 'main' already belongs to 'head_pan'"):
        load_robot(folder)
