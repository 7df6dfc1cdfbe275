"""A robot on several ports, read in parallel on one clock."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.bus.driver import CONFIRM_S, BusDriver
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.registry import create
from flexmotion.streamer.cli import execute


@pytest.fixture
def split(tmp_path: Path) -> Robot:
    """OP3 with its legs on a fast bus, and the other joints and the board on a slow one."""
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    content = yaml.safe_load((folder / "op3.yaml").read_text(encoding="utf-8"))
    content["buses"] = {"legs": {"baud": 4_000_000}, "upper": {"baud": 1_000_000}}
    content["imu"]["bus"] = "upper"
    for number, joint in enumerate(content["joints"]):
        joint["bus"] = "legs" if number >= 8 else "upper"
    (folder / "op3.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return load_robot(folder)


class Split:
    """The driver on both buses."""

    def __init__(self, robot: Robot) -> None:
        self.world = Loopback(BenchBody(robot))
        driver = create("dynamixel", robot, ports={"legs": "legs", "upper": "upper"})
        assert isinstance(driver, BusDriver)
        driver.open_port = self.world.open_port
        self.driver, self.state, self.command = driver, RobotState(robot.n), JointCommand(robot.n)
        self.command.position[:] = robot.stand_pose

    def tick(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            begin = self.world.now
            self.driver.read(self.state)
            self.driver.write(self.command)
            self.world.advance(begin + 0.008 - self.world.now)


def test_both_are_read_at_once_and_stamped_once(split: Robot) -> None:
    it = Split(split)
    with it.driver:
        it.driver.read(it.state)
        it.driver.set_torque(True)
        it.tick(3)
        begin = it.world.now
        it.driver.read(it.state)
        took = it.world.now - begin
        budgets = [it.driver.Bus.budget(split, name) for name in ("legs", "upper")]
        slower = max(budget.read_s for budget in budgets)
        assert slower - 1e-9 <= took < slower + 0.0003 < sum(budget.read_s for budget in budgets)
        assert it.state.stamp_ns == round(begin * 1e9)
        assert not it.state.stale.any() and it.state.imu_stale == 0
        np.testing.assert_allclose(it.state.position, split.stand_pose, atol=0.002)
        assert it.world.emulator.body.plant.enabled.all()


def test_goals_reach_both(split: Robot) -> None:
    it = Split(split)
    with it.driver:
        it.driver.read(it.state)
        it.driver.set_torque(True)
        for joint in ("head_pan", "l_knee"):
            it.command.position[split.index(joint)] += 0.1
        it.tick(125)
        np.testing.assert_allclose(it.state.position, it.command.position, atol=0.02)


def test_an_unplugged_bus_leaves_the_other_fresh(split: Robot) -> None:
    it = Split(split)
    with it.driver:
        it.driver.read(it.state)
        it.driver.set_torque(True)
        it.tick(3)
        it.world.emulator.lines[1].act([Fault.parse("port")])
        it.tick(7)
        assert it.state.stale[8:].max() == 0 and it.state.stale[:8].min() >= 6


def test_a_silent_bus_does_not_delay_torque_off_of_the_others(split: Robot) -> None:
    """Each bus was asked to confirm before the next was switched off: a kill waited .17 s for every silent bus."""
    it = Split(split)
    with it.driver:
        it.driver.read(it.state)
        it.driver.set_torque(True)
        it.tick(3)
        legs, upper = (line.bus for line in it.world.emulator.lines)
        legs.dead = {servo.id for servo in legs.servos}
        begin, off = it.world.now, []
        switched = type(it.driver.buses[1]).torque_is_off
        it.driver.buses[0].torque_is_off = lambda asked, until: (  # type: ignore[method-assign]
            off.append(not any(servo.get("torque_enable") for servo in upper.servos))
            or switched(it.driver.buses[0], asked, until)
        )
        it.world.advance(0.002)
        it.driver.set_torque(False)
        assert off and off[-1] and it.world.now > begin
        assert len(it.driver.holding) == len(legs.servos)


def test_silent_buses_share_the_time_in_which_torque_off_is_confirmed(split: Robot) -> None:
    """Each bus had a time of its own, one after the other."""
    it = Split(split)
    with it.driver:
        it.driver.read(it.state)
        it.driver.set_torque(True)
        it.tick(3)
        for line in it.world.emulator.lines:
            line.bus.dead = {servo.id for servo in line.bus.servos}
        it.world.advance(0.002)
        begin = it.world.now
        it.driver.set_torque(False)
        assert it.world.now - begin < CONFIRM_S + 0.01
        assert len(it.driver.holding) == split.n


def test_tools_take_a_port_for_each_bus(
    split: Robot, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: no command but `run` took more than one port, so that such a robot could not be configured."""
    world = Loopback(BenchBody(split))
    for module in ("flexmotion.drivers.bench", "flexmotion.drivers.bus.driver"):
        monkeypatch.setattr(f"{module}.SerialPort", world.open_port)
    audit = ["check", "bus", "--robot", str(split.folder), "--json", "--port"]
    assert execute([*audit, "legs=legs,upper=upper"]) == 0
    assert [row["voltage"] for row in json.loads(capsys.readouterr().out)["servos"]] == [12.0] * 20
    assert execute([*audit, "legs"]) == 2
    assert "expected one for each bus: --port legs=DEVICE,upper=DEVICE" in capsys.readouterr().err
    assert execute([*audit, "legs=legs,upper"]) == 2
    assert "--port legs=legs,upper: expected DEVICE, or BUS=DEVICE,BUS=DEVICE" in capsys.readouterr().err
