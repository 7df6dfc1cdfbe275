"""Two runs of one robot: the second begins in the pose in which the first ended."""

from __future__ import annotations

import pytest

from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.lockstep import LockstepBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import PICKED_UP_S, SimBody
from flexmotion.drivers.registry import create

from .bus_runs import Run, through


@pytest.fixture(scope="module")
def runs(op3: Robot) -> list[Run]:
    """Two runs of the same emulated robot, some seconds apart."""
    body = SimBody(op3)
    world, done = Loopback(body), []
    for _ in range(2):
        driver = create("dynamixel", op3, port="main")
        assert isinstance(driver, BusDriver)
        done.append(through(op3, LockstepBus(driver, world, body), body))
        world.advance(PICKED_UP_S + 0.5)
    return done


def test_the_same_emulated_robot_can_be_run_again(runs: list[Run]) -> None:
    """The second was once refused: a joint that had sagged stood outside its limits."""
    for run in runs:
        assert run.faults == [] and run.states[-1] == "PARK -> OFF"
        assert run.driver.violations == 0
    first, second = (run.body for run in runs)
    assert first is second and first is not None and not first.fell
