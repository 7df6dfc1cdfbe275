"""The serial IMU: measurements, settings, and faults."""

from __future__ import annotations

import logging
import math
import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest
import witmotion
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers import plugins
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.emulator import Emulator
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.witmotion import WitMotionLine
from flexmotion.drivers.imu import registry as imus
from flexmotion.drivers.imu.interface import StandaloneImu
from flexmotion.drivers.imu.witmotion.protocol import Kind, frame
from flexmotion.drivers.imu.witmotion.sensor import WitMotion
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.port import SerialPort
from flexmotion.drivers.registry import create

from ...waiting import wait_until
from .robots import looped, op3_with_imu

TICK = 0.008
TILTED = [math.cos(0.3), math.sin(0.3), 0.0, 0.0]
"""Mounting: rotated by 0.6 rad about the torso's x."""


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return op3_with_imu(tmp_path, driver="witmotion", quaternion=TILTED)


def ticks(driver: BusDriver, world: Loopback, many: int) -> RobotState:
    state, command = RobotState(driver.robot.n), JointCommand(driver.robot.n)
    command.position[:] = driver.robot.stand_pose
    for _ in range(many):
        begin = world.now
        driver.read(state)
        driver.write(command)
        world.advance(begin + TICK - world.now)
    return state


def imu_line(world: Loopback) -> WitMotionLine:
    line = world.emulator.lines[-1]
    assert isinstance(line, WitMotionLine)
    return line


@pytest.mark.parametrize("sensor", [{"driver": "witmotion"}, {"driver": "opencr", "id": 200, "bus": "main"}])
def test_every_imu_measures_in_the_torso_frame_at_every_tick(tmp_path: Path, sensor: dict[str, Any]) -> None:
    driver, world = looped(op3_with_imu(tmp_path, quaternion=TILTED, **sensor))
    body = world.emulator.body
    body.gyro[:], body.accel[:] = [0.1, -0.2, 0.3], [1.0, -2.0, 9.0]
    with driver:
        assert driver.capabilities.imu
        for _ in range(20):
            state = ticks(driver, world, 1)
            assert state.imu_stale == 0
        np.testing.assert_allclose(state.gyro, body.gyro, atol=math.radians(2000) / 32768)
        np.testing.assert_allclose(state.accel, body.accel, atol=16 * 9.81 / 32768)


def test_it_sends_two_hundred_samples_for_a_loop_of_125_hertz(robot: Robot) -> None:
    driver, world = looped(robot)
    with driver:
        before, begin = imu_line(world).samples, world.now
        ticks(driver, world, 125)
        assert imu_line(world).samples - before == pytest.approx(200 * (world.now - begin), abs=2)


def test_broken_frames_are_counted_and_the_last_good_sample_stays(
    robot: Robot, caplog: pytest.LogCaptureFixture
) -> None:
    driver, world = looped(robot)
    with driver:
        ticks(driver, world, 2)
        imu_line(world).damage.bad_packets = 0.03
        state, stale = RobotState(robot.n), 0
        for _ in range(250):
            state = ticks(driver, world, 1)
            stale = max(stale, state.imu_stale)
            np.testing.assert_allclose(state.accel, [0, 0, 9.81], atol=0.01)
        assert isinstance(driver._imu, WitMotion) and driver._imu.bad > 3
        assert 0 < stale <= 3 and not state.stale.any()
    assert f"{driver._imu.bad} broken frames: check its cable" in caplog.text


def test_a_pulled_imu_cable_affects_the_imu_alone(robot: Robot) -> None:
    driver, world = looped(robot)
    with driver:
        ticks(driver, world, 2)
        world.emulator.faults[:] = [Fault.parse("imu")]
        world.advance(0.015)
        state = ticks(driver, world, 7)
        assert state.imu_stale >= 6 and not state.stale.any()
        world.emulator.faults[:] = []
        world.advance(0.015)
        assert ticks(driver, world, 15).imu_stale == 0


@pytest.mark.parametrize("hertz", [10, 50, 100])
def test_a_sensor_that_falls_back_to_a_lower_rate_is_not_fresh(robot: Robot, hertz: int) -> None:
    """Regression: after a dip of its supply it loses its rate; every sample was fresh, and the tilt was halved."""
    driver, world = looped(robot)
    with driver:
        assert ticks(driver, world, 20).imu_stale == 0
        line = imu_line(world)
        asked, line._period = line._period, 1.0 / hertz
        assert ticks(driver, world, 13).imu_stale > 0
        before = ticks(driver, world, 1).imu_stale
        assert ticks(driver, world, 250).imu_stale == before + 250
        assert isinstance(driver._imu, WitMotion) and len(driver._imu._window) <= 14
        line._period = asked
        assert ticks(driver, world, 30).imu_stale == 0


def test_old_samples_are_not_fresh(robot: Robot) -> None:
    """The loop pauses; the cable is pulled early in the pause, and the last samples are still in the buffer."""
    driver, world = looped(robot)
    with driver:
        ticks(driver, world, 2)
        world.advance(0.05)
        imu_line(world).cut = True
        world.advance(0.5)
        assert ticks(driver, world, 1).imu_stale == 1


def test_a_stream_that_continued_during_a_pause_is_fresh(robot: Robot) -> None:
    driver, world = looped(robot)
    with driver:
        ticks(driver, world, 2)
        world.advance(0.5)
        assert ticks(driver, world, 1).imu_stale == 0


@pytest.mark.parametrize("required", [False, True])
def test_a_missing_imu_is_an_error_only_if_it_is_required(
    tmp_path: Path, required: bool, caplog: pytest.LogCaptureFixture
) -> None:
    robot = op3_with_imu(tmp_path, driver="witmotion", required=required)
    driver, world = looped(robot)
    world.emulator.faults[:] = [Fault.parse("imu")]
    world.advance(0.02)
    if required:
        with pytest.raises(DriverError, match="no sample at 115200 baud: no IMU, which the robot file requires"):
            driver.open()
        return
    with driver:
        assert ticks(driver, world, 3).imu_stale == -1
    assert "IMU witmotion on imu: no sample at 115200 baud: no IMU" in caplog.text


def test_no_sample_arrives_at_another_bit_rate(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = op3_with_imu(tmp_path, driver="witmotion", options={"baud": 230_400})
    driver, world = looped(robot)
    imu_line(world)._baud = 115_200
    with driver, caplog.at_level(logging.WARNING):
        pass
    assert "no sample at 230400 baud" in caplog.text


def test_a_bit_rate_too_low_for_the_loop_is_refused(tmp_path: Path) -> None:
    robot = op3_with_imu(tmp_path, driver="witmotion", options={"baud": 9600}, required=True)
    driver, _ = looped(robot)
    with pytest.raises(DriverError, match="200 samples a second need more than 44000 baud, it has 9600"):
        driver.open()


def test_it_can_be_closed_and_opened_again(robot: Robot) -> None:
    driver, world = looped(robot)
    for _ in range(2):
        with driver:
            assert ticks(driver, world, 1).imu_stale == 0
        driver.close()


# ---------------------------------------------------------------- the robot file


@pytest.mark.parametrize(
    ("imu", "says"),
    [
        ({"driver": "bno"}, r"imu\.driver: unknown IMU 'bno', expected one of: witmotion; or opencr, on a dynamixel"),
        ({"driver": "opencr", "bus": "main"}, "unknown IMU 'opencr'"),
        ({"driver": "witmotion"}, r"field imu\.options: field port: missing"),
        ({"driver": "witmotion", "options": {"port": "/dev/x", "speed": 1}}, r"field speed: unknown field, .* baud"),
    ],
)
def test_an_error_in_the_robot_file_is_named(tmp_path: Path, imu: dict[str, object], says: str) -> None:
    robot = op3_with_imu(tmp_path, **imu)
    with pytest.raises(ConfigError, match=says) as error:
        create("dynamixel", robot, port="main")
    assert "robot.yaml" in str(error.value)


def test_the_port_option_takes_precedence_over_the_file(tmp_path: Path) -> None:
    robot = op3_with_imu(tmp_path, driver="witmotion", options={"port": "/dev/imu", "baud": 921_600})
    assert imus.create(robot).options == imus.create(robot, "/dev/imu").options
    assert imus.create(robot, "/dev/other").options.port == "/dev/other"


def test_servo_tools_need_no_imu(tmp_path: Path) -> None:
    robot = op3_with_imu(tmp_path, driver="witmotion", required=True)
    driver, world = create("dynamixel", robot, port="main", imu=False), Loopback(BenchBody(robot))
    assert isinstance(driver, BusDriver) and not driver.capabilities.imu
    driver.open_port = world.open_port
    with driver:
        assert ticks(driver, world, 2).imu_stale == -1


class Sensor(StandaloneImu):
    """IMU of a plug-in: no port, always the same sample."""

    name = "mine"

    def open(self, open_port: object, rate_hz: float) -> None:
        self.gyro[:] = [0.0, 0.0, rate_hz]

    def read(self, now: float) -> bool:
        return True

    def close(self) -> None:
        self.gyro[:] = 0.0


def test_a_plug_in_is_found_by_its_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("somebodys_imu")
    module.Sensor = Sensor  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "somebodys_imu", module)
    entry = EntryPoint("mine", "somebodys_imu:Sensor", imus.GROUP)
    monkeypatch.setattr(plugins, "entry_points", lambda group: (entry,) if group == imus.GROUP else ())
    robot = op3_with_imu(tmp_path, driver="mine")
    driver, world = create("dynamixel", robot, port="main"), Loopback(BenchBody(robot))
    assert isinstance(driver, BusDriver)
    driver.open_port = world.open_port
    with driver:
        state = ticks(driver, world, 1)
        assert state.imu_stale == 0 and state.gyro[2] == robot.rate_hz


class Unplugged(Sensor):
    """IMU of a plug-in that raises `OSError`."""

    fails: ClassVar[str] = "open"

    def open(self, open_port: object, rate_hz: float) -> None:
        if self.fails == "open":
            raise OSError("no such device")

    def read(self, now: float) -> bool:
        if self.fails == "read":
            raise OSError("no such device")
        if self.fails == "interrupt":
            raise KeyboardInterrupt
        return True


def with_unplugged(folder: Path, fails: str, monkeypatch: pytest.MonkeyPatch, **imu: Any) -> tuple[BusDriver, Loopback]:
    monkeypatch.setattr(imus, "create", lambda robot, port: Unplugged(robot.config.imu))
    monkeypatch.setattr(Unplugged, "fails", fails)
    return looped(op3_with_imu(folder, driver="witmotion", **imu))


def test_an_error_of_a_plug_in_at_open_is_a_missing_imu(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Regression: an `OSError` in a plug-in's `open` ended in a traceback."""
    driver, world = with_unplugged(tmp_path / "may", "open", monkeypatch)
    with driver:
        assert ticks(driver, world, 2).imu_stale == -1
    assert "IMU mine: OSError: no such device: no IMU" in caplog.text
    driver, _ = with_unplugged(tmp_path / "must", "open", monkeypatch, required=True)
    with pytest.raises(DriverError, match="no such device: no IMU, which the robot file requires"):
        driver.open()
    assert not driver.buses


def test_an_error_of_a_plug_in_while_it_is_read_is_a_stale_imu(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Regression: an `OSError` in a plug-in's `read` ended the loop of a walking robot."""
    driver, world = with_unplugged(tmp_path, "", monkeypatch)
    with driver:
        assert ticks(driver, world, 1).imu_stale == 0
        monkeypatch.setattr(Unplugged, "fails", "read")
        assert ticks(driver, world, 8).imu_stale == 8
        monkeypatch.setattr(Unplugged, "fails", "")
        assert ticks(driver, world, 1).imu_stale == 0
    assert caplog.text.count("no such device") == 1


def test_ports_are_released_if_waiting_for_the_imu_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: after an error while waiting for the first sample, `open` left its ports open."""
    driver, _ = with_unplugged(tmp_path, "interrupt", monkeypatch)
    with pytest.raises(KeyboardInterrupt):
        driver.open()
    assert not driver.buses


# ---------------------------------------------------------------- bytes


class NoisyPort(SerialPort):
    """A port that receives the bytes that a test sets."""

    def __init__(self) -> None:
        self.path, self.baud, self.lost, self.sent, self.busy_until = "noise", 115_200, None, 0, 0.0
        self.pieces: list[bytes] = []
        self.time = 0.0

    def send(self, data: bytes) -> None:
        self._count(data)

    def receive(self) -> bytes:
        return self.pieces.pop(0) if self.pieces else b""

    def wait_any(self, ports: Sequence[SerialPort], seconds: float) -> None:
        self.time += max(seconds, 0.001)
        self.pieces.append(SAMPLE * 60)

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.time += seconds

    def close(self) -> None:
        self.lost = "closed"


SAMPLE = frame(Kind.ACCEL, (0, 0, 2048, 0)) + frame(Kind.GYRO, (1, 2, 3, 0))


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> tuple[StandaloneImu, NoisyPort]:
    port = NoisyPort()
    imu = imus.create(op3_with_imu(tmp_path_factory.mktemp("noise"), driver="witmotion"), "noise")
    imu.open(lambda path, baud: port, 125)
    return imu, port


_cut = st.integers(0, len(SAMPLE)).map(lambda at: SAMPLE[:at])
_tail = st.integers(0, len(SAMPLE)).map(lambda at: SAMPLE[at:])


@settings(max_examples=1000)
@given(pieces=st.lists(st.one_of(st.binary(max_size=60), _cut, _tail), max_size=4))
def test_no_bytes_crash_it(noisy: tuple[StandaloneImu, NoisyPort], pieces: list[bytes]) -> None:
    imu, port = noisy
    port.pieces = [piece for piece in pieces if piece]
    port.time += TICK
    imu.read(port.time)
    assert np.isfinite(imu.gyro).all() and np.isfinite(imu.accel).all()
    port.pieces = [SAMPLE * 3]
    assert imu.read(port.time + TICK)


# ---------------------------------------------------------------- a real port


@pytest.mark.wall_clock
def test_over_a_pseudo_terminal(tmp_path: Path, emulated: Callable[..., Emulator]) -> None:
    """Driver and emulator share the real clock. A slow machine may lose answers: the test repeats until all come.

    At a low rate, since the driver refuses a sensor that misses a fifth of its samples.
    """
    robot = op3_with_imu(tmp_path, rate_hz=50, driver="witmotion", required=True)
    emulator = emulated(robot)
    emulator.body.accel[:] = [1.0, -2.0, 9.0]
    bus, imu = emulator.lines
    driver = create("dynamixel", robot, port=bus.terminal.path, imu_port=imu.terminal.path)
    state = RobotState(robot.n)

    def opened() -> bool:
        try:
            driver.open()
        except DriverError:
            return False
        return True

    def fresh() -> bool:
        driver.read(state)
        return not state.stale.any() and state.imu_stale == 0

    wait_until(opened, "the driver opens")
    try:
        wait_until(fresh, "all joints and the IMU are fresh in one read")
        np.testing.assert_allclose(state.accel, [1.0, -2.0, 9.0], atol=0.01)
        np.testing.assert_allclose(state.position, robot.stand_pose, atol=robot.tick_rad.max())
    finally:
        driver.close()


class TheirImu(witmotion.IMU):  # type: ignore[misc]
    """Its thread starts before its constructor has set these."""

    subscribers: ClassVar[dict[object, list[object]]] = defaultdict(list)


@pytest.mark.wall_clock
def test_another_library_reads_the_emulated_sensor(tmp_path: Path, emulated: Callable[..., Emulator]) -> None:
    robot = op3_with_imu(tmp_path, driver="witmotion")
    emulator = emulated(robot)
    emulator.body.gyro[:] = [0.0, math.radians(50), 0.0]
    client = TheirImu(emulator.lines[-1].terminal.path, baudrate=115_200)
    try:
        wait_until(lambda: (client.get_angular_velocity() or (0, 0))[1], "the client has a sample of the gyro")
        assert client.get_acceleration()[2] == pytest.approx(9.8, abs=0.01)
        assert client.get_angular_velocity()[1] == pytest.approx(50, abs=0.1)
    finally:
        client.close()
