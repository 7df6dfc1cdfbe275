"""What a device reports is false; the device itself and its joint are as they are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.false_readings import FalseReadings
from flexmotion.drivers.emulator.faults import FALSE_OF_IMU, FALSE_OF_SERVO, Fault
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.random_errors import RANDOM_SIZE
from flexmotion.drivers.registry import create

from ..bus.robots import op3_with

KNEE = 14


class Bench:
    """A driver on emulated servos, torque on."""

    def __init__(self, driver: str, robot: Robot) -> None:
        self.robot, self.world = robot, Loopback(BenchBody(robot))
        made = create(driver, robot, port="main")
        assert isinstance(made, BusDriver)
        self.driver = made
        made.open_port = self.world.open_port
        self.state, self.command = RobotState(robot.n), JointCommand(robot.n)
        self.command.position[:] = robot.stand_pose
        made.open()
        self.driver.read(self.state)
        self.driver.set_torque(True)
        self.tick()

    @property
    def knee(self) -> int:
        return next(index for index, joint in enumerate(self.robot.joints) if joint.id == KNEE)

    def tick(self) -> None:
        begin = self.world.now
        self.driver.read(self.state)
        self.driver.write(self.command)
        self.world.advance(begin + 1 / self.robot.rate_hz - self.world.now)

    def suffer(self, *faults: str) -> None:
        self.world.emulator.faults[:] = [Fault.parse(text) for text in faults]
        self.world.advance(0.015)


@pytest.fixture(params=["dynamixel", "feetech", "lx16a"])
def bench(request: pytest.FixtureRequest, op3: Robot, tmp_path: Path) -> Bench:
    if request.param == "dynamixel":
        return Bench("dynamixel", op3)
    if request.param == "feetech":
        return Bench("feetech", op3_with(tmp_path, servo="STS3215-12V", baud=1_000_000))
    return Bench("lx16a", op3_with(tmp_path, servo="LX-16A", baud=115_200))


def test_a_false_voltage_or_temperature_is_in_the_next_readings_for_good(bench: Bench) -> None:
    true = bench.state.voltage[bench.knee], bench.state.temperature[bench.knee]
    bench.suffer(f"false_voltage:{KNEE}:-3", f"false_temperature:{KNEE}:40")
    for _ in range(130):  # an LX-16A is asked for these in turns
        bench.tick()
    assert bench.state.voltage[bench.knee] == pytest.approx(true[0] - 3, abs=0.11)
    assert bench.state.temperature[bench.knee] == pytest.approx(true[1] + 40, abs=1)
    others = np.arange(bench.robot.n) != bench.knee
    np.testing.assert_allclose(bench.state.voltage[others], true[0], atol=0.11)
    bench.suffer()
    for _ in range(130):
        bench.tick()
    assert bench.state.voltage[bench.knee] == pytest.approx(true[0], abs=0.11)


def reads_of(bench: Bench, register: str) -> list[int]:
    """Readings of a register of the knee, by a client that reads nothing else."""
    from flexmotion.drivers.emulator.dynamixel_bus import EmulatedDynamixelBus

    bus = bench.world.emulator.lines[0].bus  # type: ignore[attr-defined]
    assert isinstance(bus, EmulatedDynamixelBus)
    servo = next(servo for servo in bus.servos if servo.id == KNEE)
    seen = []
    for _ in range(3):
        bus.joints.measure()
        servo.refresh(bench.world.now)
        seen.append(servo.get(register))
    return seen


@pytest.mark.parametrize(
    ("fault", "register", "units"),
    [
        ("false_position:14:400", "present_position", 400),
        ("false_position:14:-4096", "present_position", -4096),
        ("false_speed:14:10", "present_velocity", 417),
        ("false_temperature:14:-30", "present_temperature", -25),  # it cannot report less than 0
    ],
)
def test_once_is_one_reading(op3: Robot, fault: str, register: str, units: int) -> None:
    bench = Bench("dynamixel", op3)
    bench.driver.let_go()  # nothing else reads
    (before, *_) = reads_of(bench, register)
    bench.suffer(f"{fault}@0+once")
    false, *after = reads_of(bench, register)
    assert false - before == pytest.approx(units, abs=1) and after == [before, before]
    bench.world.advance(0.1)
    assert reads_of(bench, register) == [before] * 3, "it acted again"


def test_the_gyroscope_and_the_accelerometer_lie(op3: Robot) -> None:
    bench = Bench("dynamixel", op3)
    gyro, accel = bench.state.gyro.copy(), bench.state.accel.copy()
    bench.suffer("false_gyro:3", "false_accel:-20")
    bench.tick()
    np.testing.assert_allclose(bench.state.gyro - gyro, 3.0, atol=0.01)
    # The sensor's range ends at 2 g.
    assert (bench.state.accel - accel)[:2] == pytest.approx([-19.6, -19.6], abs=0.5)


def test_a_random_share_of_readings_is_false_in_every_quantity_and_within_its_bounds() -> None:
    false = FalseReadings(0.01, seed=2)
    errors = [error for _ in range(20_000) if (error := false.of_servo(0)) is not None]
    boards = [error for _ in range(20_000) if (error := false.of_imu()) is not None]
    assert len(errors) == pytest.approx(200, abs=50) and len(boards) == pytest.approx(200, abs=50)
    assert all(false.told[kind] > 10 for kind in (*FALSE_OF_SERVO, *FALSE_OF_IMU))
    for kind in FALSE_OF_SERVO:
        sizes = [abs(value) for e in errors if (value := getattr(e, kind.removeprefix("false_")))]
        assert len(sizes) == false.told[kind]
        assert RANDOM_SIZE[kind][0] <= min(sizes) and max(sizes) <= RANDOM_SIZE[kind][1]
    assert all(np.count_nonzero([*error.gyro, *error.accel]) == 1 for error in boards)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("false_position", "needs an argument"),
        ("false_position:14", "needs a VALUE"),
        ("false_gyro:1:2", "has no VALUE"),
        ("dead:14@1+once", "only a false reading can be for once"),
    ],
)
def test_what_is_not_a_false_reading_is_refused(text: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        Fault.parse(text)


def test_a_false_reading_of_an_unknown_servo_is_refused(op3: Robot) -> None:
    with pytest.raises(ConfigError, match="no servo has id 99"):
        Loopback(BenchBody(op3), faults=[Fault.parse("false_speed:99:3")])


@pytest.mark.parametrize("make", [BenchBody, SimBody])
def test_a_blocked_joint_stays_where_it_is_until_it_is_released(
    op3: Robot, make: Callable[[Robot], BenchBody | SimBody]
) -> None:
    body = make(op3)
    knee = op3.index("l_knee")
    every = np.ones(op3.n, np.bool_)
    body.set_torque(every, True)
    body.block(knee, True)
    goal = op3.stand_pose + np.where(np.arange(op3.n) == knee, 0.2, 0.0)
    start = float(body.position[knee])

    def moved() -> float:
        for _ in range(100):
            body.receive(goal, every, np.full(op3.n, np.inf))
            body.step(0.004)
        return abs(float(body.position[knee]) - start)

    assert moved() < 0.005
    body.block(knee, False)
    assert moved() > 0.1


def test_a_tripped_watchdog_refuses_goals_until_it_is_cleared(op3: Robot) -> None:
    bench = Bench("dynamixel", op3)
    body, knee = bench.world.emulator.body, bench.knee
    bench.suffer(f"tripped:{KNEE}")
    start, held = float(body.position[knee]), []
    for _ in range(40):
        bench.command.position[knee] = start + 0.2
        bench.tick()
        held.append(abs(float(body.position[knee]) - start) < 0.01)
    assert held[0] and not held[-1]  # the driver finds and clears it
