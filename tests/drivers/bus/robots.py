"""OP3 with other servos, and drivers on emulated buses in this process."""

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


def op3_with(folder: Path, *, servo: str, **bus: Any) -> Robot:
    """OP3 without IMU, with another servo on its only bus, and limits inside the range of that servo."""
    place = folder / servo
    shutil.copytree(ROBOTS / "op3", place)
    content = yaml.safe_load((place / "op3.yaml").read_text(encoding="utf-8"))
    content.pop("imu")
    content["buses"]["main"] = bus
    for joint in content["joints"]:
        joint["servo"] = servo
        joint["limits"] = [max(joint["limits"][0], -2.0), min(joint["limits"][1], 2.0)]
    content["rest_pose"]["l_knee"], content["rest_pose"]["r_knee"] = 1.9, -1.9
    (place / "op3.yaml").unlink()
    (place / "robot.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return load_robot(place)


def looped(name: str, robot: Robot) -> tuple[BusDriver, Loopback]:
    """The driver `name` on emulated servos on a bench, and their emulated buses."""
    driver, world = create(name, robot, port="main"), Loopback(BenchBody(robot))
    assert isinstance(driver, BusDriver)
    driver.open_port = world.open_port
    return driver, world
