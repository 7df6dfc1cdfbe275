"""OP3 with a serial IMU instead of the one on its OpenCR board, and its driver on emulated ports in this process."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import yaml

from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.registry import create


def op3_with_imu(folder: Path, *, rate_hz: float = 125, **imu: Any) -> Robot:
    """OP3 with these fields of `imu` in its robot file."""
    place = folder / "robot"
    shutil.copytree(ROBOTS / "op3", place)
    content = yaml.safe_load((place / "op3.yaml").read_text(encoding="utf-8"))
    content["rate_hz"] = rate_hz
    content["imu"] = {"body": "body_link"} | imu
    (place / "op3.yaml").rename(place / "robot.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return load_robot(place)


def looped(robot: Robot, **arguments: Any) -> tuple[BusDriver, Loopback]:
    """The Dynamixel driver of a robot with a WitMotion IMU, not yet open, and the emulated ports that it uses."""
    driver, world = create("dynamixel", robot, port="main", imu_port="imu"), Loopback(BenchBody(robot), **arguments)
    assert isinstance(driver, BusDriver)
    driver.open_port = world.open_port
    return driver, world
