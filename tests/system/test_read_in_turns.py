"""A whole run on a bus whose servos are read one after the other."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.lockstep import LockstepBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.registry import create

from ..drivers.bus.robots import op3_with
from .bus_runs import Run, through


@pytest.fixture
def lx(tmp_path: Path) -> Robot:
    file = Path(op3_with(tmp_path, servo="LX-16A", baud=115_200).file)
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    content["safety"]["voltage_min"] = 4.8
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return load_robot(file.parent)


def over_lx16a(robot: Robot, *faults: str) -> Run:
    body = SimBody(robot)
    world = Loopback(body, faults=[Fault.parse(text) for text in faults])
    driver = create("lx16a", robot, port="main")
    assert isinstance(driver, BusDriver) and driver.turns > 30
    return through(robot, LockstepBus(driver, world, body), body)


def test_arms_that_move_follow_their_goals(lx: Robot) -> None:
    """On a simulated clock, which begins at 0, the first reading had a speed that cannot be: no start."""
    run = over_lx16a(lx)
    assert run.states[-1] == "PARK -> OFF" and not run.faults


def test_a_blocked_shoulder_is_found(lx: Robot) -> None:
    """Joints that are read in turns were not judged, and no document said so."""
    run = over_lx16a(lx, "blocked:1@1.0")
    assert "servo of r_sho_pitch (id 1) does not follow its goals" in run.end
