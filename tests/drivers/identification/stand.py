"""A robot on a stand whose servos differ from its file, on an emulated bus or driven directly."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.identification.excitation import Excitation, plan
from flexmotion.drivers.identification.experiment import Experiment
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.registry import create
from flexmotion.drivers.sim.options import SimOptions


@dataclass
class Stand:
    """An emulated robot on a stand, limp, and its driver.

    Attributes:
        robot: as its file says; the emulated one may differ.
        delay: that goals wait in addition to the bus [s].
    """

    robot: Robot
    body: SimBody
    world: Loopback
    driver: BusDriver

    @classmethod
    def of(cls, robot: Robot, hidden: Robot, *, delay: float = 0.0, timestep: float = 0.002) -> Stand:
        """`hidden` moves; what is known of it is `robot`."""
        body = SimBody(hidden, SimOptions(suspended=True, extra_latency_s=delay, timestep=timestep))
        world = Loopback(body)
        world.advance(1.5)
        driver = create("dynamixel", robot, port="main")
        assert isinstance(driver, BusDriver)
        driver.open_port = world.open_port
        driver.open()
        return cls(robot, body, world, driver)

    def plan(self, joint: str, amplitude: float | None = None) -> Excitation:
        """The motion from the present pose."""
        state = RobotState(self.robot.n)
        for _ in range(4):
            self.driver.read(state)
            self.world.advance(0.008)
        up = state.accel if state.imu_stale == 0 else None
        return plan(self.robot, self.robot.index(joint), state.position, amplitude=amplitude, up=up)

    def experiment(self) -> Experiment:
        """On the emulator's clock."""
        budget = self.driver.Bus.budget(self.robot, "main")
        bus_s = budget.write_s - budget.asked_s
        return Experiment(self.driver, bus_s=bus_s, clock=lambda: self.world.now, sleep=self.world.advance)

    @property
    def limp(self) -> bool:
        """Whether the torque of every servo is off."""
        return not self.body.plant.enabled.any()


def op3() -> Robot:
    """OP3 as it is shipped."""
    return load_robot("op3")


def plain_copy(folder: Path) -> Path:
    """A folder with OP3 of which nothing was identified."""
    return Path(shutil.copytree(ROBOTS / "op3", folder / "op3"))
