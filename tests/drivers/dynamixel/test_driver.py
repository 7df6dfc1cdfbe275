"""The driver with emulated servos, byte by byte, on a simulated clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.inspection import NotConfiguredError
from flexmotion.drivers.bus.servo_bus import TORQUE_LOST
from flexmotion.drivers.dynamixel.driver import DynamixelDriver
from flexmotion.drivers.dynamixel.packet import Decoder, Instruction
from flexmotion.drivers.dynamixel.registers import Register, table_of
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.dynamixel_bus import EmulatedDynamixelBus
from flexmotion.drivers.emulator.emulator import Emulator
from flexmotion.drivers.emulator.faults import Fault, FaultKind
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.servo import XServo
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.port import SerialPort
from flexmotion.drivers.registry import create

from ..bus.lost_packets import lose
from ..bus.robots import op3_with

KNEE = 14
TABLE = 120
"""Registers up to the goal position and its profile: what a host can change."""
ON_THE_WIRE_S = 0.004
"""Time after which the last bytes have reached the servos [s]."""


class Rig:
    """A driver on the port of an emulated bus.

    Attributes:
        driver, emulator: both ends.
        state, command: messages.
    """

    def __init__(self, robot: Robot, **options: object) -> None:
        self.robot, self.world = robot, Loopback(BenchBody(robot))
        self.emulator = self.world.emulator
        driver = create("dynamixel", robot, port="main", **options)
        assert isinstance(driver, DynamixelDriver)
        driver.open_port = self.world.open_port
        self.driver = driver
        self.state, self.command = RobotState(robot.n), JointCommand(robot.n)
        self.command.position[:] = robot.stand_pose

    @property
    def bus(self) -> EmulatedDynamixelBus:
        bus = self.emulator.lines[0].bus
        assert isinstance(bus, EmulatedDynamixelBus)
        return bus

    def servo(self, id_: int) -> XServo:
        return next(servo for servo in self.bus.servos if servo.id == id_)

    def start(self) -> None:
        self.driver.open()
        self.driver.read(self.state)
        self.driver.set_torque(True)

    def tick(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            begin = self.world.now
            self.driver.read(self.state)
            self.driver.write(self.command)
            self.world.advance(begin + 0.008 - self.world.now)

    def suffer(self, *faults: str) -> None:
        """Set the active faults."""
        self.emulator.faults[:] = [Fault.parse(text) for text in faults]
        self.world.advance(0.015)


@pytest.fixture
def rig(op3: Robot) -> Iterator[Callable[..., Rig]]:
    """Call with options of the driver: a rig, not yet open."""
    rigs: list[Rig] = []

    def make(**options: object) -> Rig:
        rigs.append(Rig(op3, **options))
        return rigs[-1]

    yield make
    for each in rigs:
        each.driver.close()


def test_what_it_reads_is_what_the_servos_have(op3: Robot, rig: Callable[..., Rig]) -> None:
    it = rig()
    it.emulator.body.plant.temperature[:] = 41.0
    it.driver.open()
    it.driver.read(it.state)
    np.testing.assert_allclose(it.state.position, op3.stand_pose, atol=op3.tick_rad[0] / 2 + 1e-9)
    assert (it.state.voltage == 12.0).all() and (it.state.temperature == 41.0).all()
    assert not it.state.stale.any() and not it.state.hardware_error.any()
    np.testing.assert_allclose(it.state.accel, [0, 0, 9.81], atol=0.01)
    assert it.state.imu_stale == 0


def test_opening_leaves_torque_off_and_writes_ram_only_where_it_differs(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.servo(KNEE).put("profile_velocity", 30)
    it.driver.open()
    assert it.servo(KNEE).get("profile_velocity") == 0
    assert not it.emulator.body.plant.enabled.any()
    assert not any(servo.eeprom_writes for servo in it.bus.servos)


def test_servos_that_are_not_configured_are_refused_before_anything_is_set_up(rig: Callable[..., Rig]) -> None:
    """Regression: the servos before the one that was refused had been changed already."""
    it = rig()
    last = it.bus.servos[-1]
    last.put("return_delay_time", 250)
    it.servo(KNEE).put("profile_velocity", 30)
    with pytest.raises(
        ConfigError, match=r"is not configured: return_delay_time is 250, the robot file wants 0; .*servo conf"
    ):
        it.driver.open()
    assert not any(servo.eeprom_writes for servo in it.bus.servos)
    assert it.servo(KNEE).get("profile_velocity") == 30


def test_a_servo_that_obeys_the_id_of_another_is_not_configured(rig: Callable[..., Rig]) -> None:
    """Regression: a joint obeyed the goals of the knee, whose id was its secondary id."""
    it = rig()
    it.servo(3).put("secondary_id", KNEE)
    with pytest.raises(ConfigError, match=r"r_sho_roll|l_sho|\(id 3\).*secondary_id is 14, the robot file wants 255"):
        it.driver.open()


def test_servos_that_answer_pings_only_are_made_to_answer(rig: Callable[..., Rig]) -> None:
    """Regression: at status return level 1 the first write was refused as not answered."""
    it = rig()
    it.servo(KNEE).put("status_return_level", 0)
    it.servo(3).put("status_return_level", 1)
    it.servo(3).put("profile_velocity", 30)
    it.driver.open()
    assert it.servo(KNEE).get("status_return_level") == 2 and it.servo(3).get("profile_velocity") == 0


def test_a_look_passes_servos_that_answer_nothing_before_a_write(rig: Callable[..., Rig]) -> None:
    """A board that has switched their power off, and a status return level of 0: `open` changes both."""
    it = rig()
    board = next(device for device in it.bus.devices if device.id == 200)
    board.put("dynamixel_power", 0)
    it.driver.look()
    assert board.get("dynamixel_power") == 0
    it.driver.open()
    it.driver.close()
    assert board.get("dynamixel_power") == 1
    before = [bytes(servo.memory[:TABLE]) for servo in it.bus.servos]
    it.servo(KNEE).put("status_return_level", 0)
    it.driver.look()
    assert it.servo(KNEE).get("status_return_level") == 0
    it.servo(KNEE).put("status_return_level", 2)
    assert [bytes(servo.memory[:TABLE]) for servo in it.bus.servos] == before
    it.servo(KNEE).put("homing_offset", 1)
    with pytest.raises(NotConfiguredError, match="homing_offset is 1"):
        it.driver.look()
    it.servo(KNEE).put("homing_offset", 0)
    it.start()
    it.tick()
    assert not it.state.stale.any()


def test_a_goal_pwm_of_another_program_is_raised_to_the_limit(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.servo(KNEE).put("goal_pwm", 100)
    it.driver.open()
    assert it.servo(KNEE).get("goal_pwm") == 885


def test_at_torque_on_no_goal_is_more_than_a_tick_from_where_the_joint_is(op3: Robot, rig: Callable[..., Rig]) -> None:
    it = rig()
    it.driver.open()
    for servo in it.bus.servos:
        servo.put("goal_position", 3000)  # left by an earlier program
    it.driver.read(it.state)
    it.driver.set_torque(True)
    for servo in it.bus.servos:
        assert abs(servo.get("goal_position") - op3.to_ticks(it.emulator.body.position)[servo.index]) <= 1
        assert servo.get("bus_watchdog") == 8
    it.command.position[:] = it.state.position
    it.tick(3)
    assert it.emulator.body.plant.enabled.all()
    assert np.abs(it.emulator.body.velocity).max() < 0.05
    assert not it.state.hardware_error.any()


@pytest.mark.parametrize("step", ["open", "torque on"])
def test_torque_on_retries_after_a_short_silence_of_the_bus(rig: Callable[..., Rig], step: str) -> None:
    """Regression: a busy host delayed replies by 20 ms before torque on; all servos counted as dead, the run ended."""
    it = rig()
    if step == "torque on":
        it.driver.open()
        it.driver.read(it.state)
    silent_until = it.world.now + 0.15

    class Moment(Fault):
        def active(self, since_torque: float) -> bool:
            return it.world.now < silent_until

    it.emulator.faults[:] = [Moment(FaultKind.CABLE)]
    it.world.advance(0.015)
    it.start() if step == "open" else it.driver.set_torque(True)
    it.tick(3)
    assert it.emulator.body.plant.enabled.all() and not it.state.stale.any()


def test_goals_arrive_in_the_units_and_directions_of_the_servos(op3: Robot, rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.command.position[:] = 0.5 * (op3.stand_pose + op3.rest_pose)
    for _ in range(60):
        it.command.position += np.clip(op3.rest_pose - it.command.position, -0.02, 0.02)
        it.tick()
    goals = np.array([servo.get("goal_position") for servo in it.bus.servos])
    np.testing.assert_array_equal(goals, op3.to_ticks(it.command.position))
    assert it.emulator.body.receiver.position_violations == 0


def test_closing_switches_torque_off_and_can_be_repeated(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.driver.close()
    it.driver.close()
    it.world.advance(ON_THE_WIRE_S)
    assert not any(servo.torque for servo in it.bus.servos)
    assert all(servo.get("bus_watchdog") == 0 for servo in it.bus.servos)


def test_after_a_crash_the_robot_stands_and_can_be_taken_over(op3: Robot, rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.tick(5)
    for bus in it.driver.buses:  # as after kill -9
        bus.close()
    it.driver.buses = []
    it.world.advance(0.4)
    assert all(servo.get("bus_watchdog") == -1 and servo.torque for servo in it.bus.servos)

    it.start()
    it.tick(3)
    assert all(servo.get("bus_watchdog") == 8 for servo in it.bus.servos)
    it.command.position[0] += 0.1
    it.tick(3)
    head = it.servo(19)
    assert head.get("goal_position") == op3.to_ticks(it.command.position)[0]


def test_a_loop_that_paused_clears_the_watchdog(rig: Callable[..., Rig], caplog: pytest.LogCaptureFixture) -> None:
    it = rig()
    it.start()
    it.tick(2)
    it.world.advance(0.3)
    assert it.servo(KNEE).get("bus_watchdog") == -1
    it.driver.write(it.command)
    it.tick(2)
    assert it.servo(KNEE).get("bus_watchdog") == 8
    assert "silent for longer than the bus watchdog" in caplog.text


def test_damping_pins_softens_and_is_undone_by_torque_on(op3: Robot, rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.tick(2)
    it.driver.damp()
    it.tick(0)
    it.driver.read(it.state)
    knee = it.servo(KNEE)
    assert (knee.get("position_p_gain"), knee.get("goal_pwm")) == (80, 88)
    it.driver.set_torque(True)
    it.driver.read(it.state)
    assert (knee.get("position_p_gain"), knee.get("goal_pwm")) == (800, 885)


def writes(name: str) -> Callable[[bytes], bool]:
    """Chooses sync writes of a register of the knee's servo, alone or among others."""

    def chosen(data: bytes) -> bool:
        return any(
            packet.instruction == Instruction.SYNC_WRITE
            and int.from_bytes(packet.params[:2], "little") == table_of("XM430-W350")[name].address
            and KNEE in packet.params[4 :: int.from_bytes(packet.params[2:4], "little") + 1]
            for packet in Decoder().feed(data)
        )

    return chosen


@pytest.mark.parametrize("register", ["position_p_gain", "goal_pwm"])
def test_a_servo_is_not_left_damped_by_a_lost_packet(rig: Callable[..., Rig], register: str) -> None:
    """After a fall, a lost packet left the knee at a tenth of its strength: it was armed, and nothing said so."""
    it = rig()
    it.start()
    it.tick(2)
    it.driver.damp()
    it.tick(0)
    it.driver.set_torque(False)
    lost = lose(it.driver.buses[0].port, writes(register))
    it.driver.set_torque(True)
    it.tick(2)
    knee = it.servo(KNEE)
    assert len(lost) == 1 and knee.torque
    assert (knee.get("position_p_gain"), knee.get("goal_pwm")) == (800, 885)


def test_a_servo_that_stays_damped_is_named_and_gets_no_torque(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.driver.damp()
    it.driver.set_torque(False)
    lose(it.driver.buses[0].port, writes("position_p_gain"), many=1000)
    with pytest.raises(DriverError, match=r"\(id \d+\) on main: does not confirm position_p_gain: torque stays off"):
        it.driver.set_torque(True)
    assert not it.emulator.body.plant.enabled.any()


def test_a_servo_that_was_damped_behind_its_watchdog_gets_its_pwm_back(rig: Callable[..., Rig]) -> None:
    """The goal PWM was written before the watchdog was cleared: a servo whose watchdog has tripped refused it."""
    it = rig()
    it.start()
    it.driver.damp()
    it.world.advance(0.3)
    it.driver.read(it.state)
    assert it.servo(KNEE).get("bus_watchdog") == -1
    it.driver.set_torque(True)
    it.world.advance(ON_THE_WIRE_S)
    assert it.servo(KNEE).get("goal_pwm") == 885


def test_a_joint_outside_its_limit_is_damped_at_the_limit(rig: Callable[..., Rig]) -> None:
    """Regression: its goal followed it outside, and the receiver counted it."""
    it = rig()
    it.start()
    it.tick(2)
    knee, body = it.robot.index("l_knee"), it.emulator.body
    body.position[knee] = it.robot.upper[knee] + 0.08
    it.driver.read(it.state)
    it.driver.damp()
    it.world.advance(ON_THE_WIRE_S)
    assert it.driver.violations == 0 and body.receiver.position_violations == 0
    assert abs(body.receiver.goal[knee] - it.robot.upper[knee]) <= it.robot.tick_rad[knee]


# ---------------------------------------------------------------- audit


@pytest.mark.parametrize(
    ("register", "value", "says"),
    [
        ("model_number", 1060, r"l_knee \(id 14\).*is XL430-W250 .*1060\), the robot file has XM430-W350"),
        ("protocol_type", 21, r"l_knee \(id 14\).*another protocol"),
        ("id", 99, r"l_knee \(id 14\).*does not answer at 2000000 baud"),
    ],
)
def test_a_servo_that_differs_from_the_file_is_named(
    rig: Callable[..., Rig], register: str, value: int, says: str
) -> None:
    it = rig()
    it.servo(KNEE).put(register, value)
    it.bus._index()
    with pytest.raises(DriverError, match=says):
        it.driver.open()


def test_an_unconfigured_servo_whose_torque_is_on_keeps_it(rig: Callable[..., Rig]) -> None:
    it = rig()
    knee = it.servo(KNEE)
    knee.put("drive_mode", 1)
    knee.write(64, b"\x01")
    with pytest.raises(ConfigError, match="drive_mode is 1, the robot file wants 0"):
        it.driver.open()
    assert knee.torque


def test_a_missing_port_is_named(op3: Robot) -> None:
    for path in ("/dev/null", str(Path(__file__)), str(Path(__file__).parent)):
        with pytest.raises(DriverError, match=rf"^port {path}: is not a serial port$"):
            SerialPort(path, 57600)
    with pytest.raises(DriverError, match=r"port /dev/nowhere: there is no such device"):
        create("dynamixel", op3, port="/dev/nowhere").open()


def test_a_port_in_use_is_named(op3: Robot, emulated: Callable[..., Emulator]) -> None:
    path = emulated().lines[0].terminal.path
    holder = SerialPort(path, 2_000_000)
    with pytest.raises(DriverError, match="another program holds it"):
        create("dynamixel", op3, port=path).open()
    holder.close()


def test_options_name_a_port_for_every_bus(op3: Robot) -> None:
    with pytest.raises(ConfigError, match="expected either port"):
        create("dynamixel", op3)
    with pytest.raises(ConfigError, match="no port for bus 'main'"):
        create("dynamixel", op3, ports={"other": "/dev/x"})


def test_the_board_switches_the_servos_on(rig: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexmotion.drivers.dynamixel.opencr.START_S", 0.3)
    it = rig()
    board = next(device for device in it.bus.devices if device.id == 200)
    board.write(24, b"\x00")
    it.bus._powered = False
    it.driver.open()
    assert it.bus._powered


def test_without_the_board_there_is_no_imu_and_a_warning(
    rig: Callable[..., Rig], caplog: pytest.LogCaptureFixture
) -> None:
    it = rig()
    it.suffer("dead:200")
    it.start()
    it.tick(2)
    assert it.state.imu_stale == -1 and not it.state.stale.any()
    assert "no OpenCR board answers at id 200" in caplog.text


def test_another_device_at_the_boards_address_is_refused(
    rig: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: after every error of the board, the robot started without an IMU, with a warning."""
    it = rig()
    ping = Client.ping
    monkeypatch.setattr(Client, "ping", lambda self, id_, **how: 1060 if id_ == 200 else ping(self, id_, **how))
    with pytest.raises(DriverError, match="id 200 is not an OpenCR board: model 1060, expected 29696"):
        it.driver.open()


def test_a_board_that_does_not_switch_the_power_is_refused(
    rig: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch
) -> None:
    it = rig()
    read = Client.read

    def no_power(self: Client, id_: int, register: Register) -> int:
        if id_ == 200 and register.address == 24:
            raise DriverError("id 200: does not tell dynamixel_power")
        return read(self, id_, register)

    monkeypatch.setattr(Client, "read", no_power)
    with pytest.raises(DriverError, match="dynamixel_power"):
        it.driver.open()


def test_a_bad_packet_while_opening_is_asked_again(rig: Callable[..., Rig]) -> None:
    it = rig()
    damage = it.emulator.lines[0].damage
    damage.bad_packets = 0.03
    it.driver.open()
    assert sum(damage.spoilt.values()) > 3


# ---------------------------------------------------------------- bus health


def test_old_firmware_is_read_by_sync_read(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.servo(KNEE).put("firmware_version", 40)
    it.start()
    it.tick(5)
    assert not it.state.stale.any()
    groups = it.driver.buses[0].cycle.groups
    assert sorted((group.fast, len(group.ids)) for group in groups) == [(False, 1), (True, 19)]


def test_fast_reads_without_answers_are_given_up(rig: Callable[..., Rig], caplog: pytest.LogCaptureFixture) -> None:
    """An adapter may lose the long reply though every servo supports it."""
    it = rig()
    it.start()
    for servo in it.bus.servos:
        servo.table = servo.table.model_copy(update={"fast_sync_read_firmware": 99})
    it.tick(6)
    assert not it.state.stale.any()
    assert "sync reads from now on" in caplog.text


def test_a_dead_servo_is_the_only_one_that_goes_stale(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.tick(3)
    it.suffer("dead:14")
    it.tick(10)
    knee = it.robot.index("l_knee")
    assert it.state.stale[knee] >= 8
    assert np.delete(it.state.stale, knee).max() <= 1
    it.suffer()
    it.tick(3)
    assert not it.state.stale.any()


@pytest.mark.parametrize("fault", ["cable", "port", "lost"])
def test_a_lost_port_goes_stale_without_an_exception(rig: Callable[..., Rig], fault: str) -> None:
    it = rig()
    it.start()
    it.tick(3)
    it.suffer(fault)
    it.tick(7)
    assert it.state.stale.min() >= 6 and it.state.imu_stale >= 6
    it.driver.set_torque(False)
    it.driver.close()


def test_values_that_are_a_tick_late_are_not_fresh(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.tick(3)
    it.suffer("late:0.009")
    it.tick(10)
    assert it.state.stale.min() >= 6


@pytest.mark.parametrize("fault", ["corrupt", "truncated"])
def test_broken_packets_are_not_taken(rig: Callable[..., Rig], fault: str) -> None:
    it = rig()
    it.start()
    it.tick(3)
    it.command.position[0] += 0.3
    before = it.servo(19).get("goal_position")
    it.suffer(fault)
    it.tick(8)
    assert it.state.stale.max() >= 5
    assert it.servo(19).get("goal_position") == before


def test_duplicated_packets_are_harmless(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.suffer("duplicated")
    it.tick(10)
    assert it.state.stale.max() <= 1 and it.state.imu_stale <= 1


def test_an_overheated_servo_is_reported_with_its_bits(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.suffer("overheat:14@0")
    it.tick(3)
    assert it.state.hardware_error[it.robot.index("l_knee")] & 0x04
    assert np.count_nonzero(it.state.hardware_error) == 1


def test_a_dip_of_the_supply_is_seen(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.suffer("voltage:9.1@0")
    it.tick(3)
    assert (it.state.voltage == 9.1).all()


def test_a_short_loss_of_power_is_detected(rig: Callable[..., Rig]) -> None:
    """Its indirect addresses are lost: it answers zeros, which must not be taken for a position."""
    it = rig()
    it.start()
    it.tick(3)
    it.suffer("reset:14@0")
    it.tick(50)
    knee = it.robot.index("l_knee")
    assert it.state.stale[knee] > 5
    assert it.state.position[knee] == pytest.approx(it.robot.stand_pose[knee], abs=0.05)
    assert np.delete(it.state.stale, knee).max() <= 1


def test_torque_that_goes_off_unasked_is_an_error(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.tick(10)
    it.servo(KNEE).write(64, b"\x00")
    it.tick(3)
    assert it.state.hardware_error[it.robot.index("l_knee")] & TORQUE_LOST
    assert np.count_nonzero(it.state.hardware_error) == 1


def test_a_goal_that_is_not_a_number_is_not_sent(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.tick(2)
    before = [servo.get("goal_position") for servo in it.bus.servos]
    it.command.position[3] = np.nan
    it.tick(2)
    assert [servo.get("goal_position") for servo in it.bus.servos] == before


# ---------------------------------------------------------------- what left for the servos


def test_goals_past_the_servos_own_limits_are_counted_as_by_the_servos(rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    it.tick(5)
    assert it.driver.violations == 0
    knee = it.robot.index("l_knee")
    it.command.position[knee] = it.robot.lower[knee] - 0.2
    it.tick(3)
    assert it.driver.violations == 3
    # None of them was sent.
    assert it.emulator.body.receiver.position_violations == 0
    assert abs(it.servo(KNEE).get("goal_position") - it.robot.to_ticks(it.robot.stand_pose)[knee]) <= 1
    it.driver.close()
    assert it.driver.violations == 3


def test_a_joint_outside_its_limit_is_pinned_there_and_goals_further_out_are_counted(
    rig: Callable[..., Rig],
) -> None:
    """Regression: the servos' limits were those of the joints, and a limp robot could not be started again."""
    it = rig()
    knee, body = it.robot.index("l_knee"), it.emulator.body
    body.position[knee] = it.robot.upper[knee] + 0.1
    it.start()
    assert abs(it.servo(KNEE).get("goal_position") - it.robot.to_ticks(body.position)[knee]) <= 1
    it.command.position[:] = it.state.position
    it.tick(3)
    assert it.driver.violations == 0 and body.receiver.violations == 0
    assert body.position[knee] == pytest.approx(it.robot.upper[knee] + 0.1, abs=0.005)
    it.command.position[knee] += 0.02
    it.tick(1)
    assert it.driver.violations == 1 and body.receiver.position_violations == 0


def test_a_servo_outside_its_own_limits_is_pinned_to_the_nearest(rig: Callable[..., Rig]) -> None:
    """Regression: the goal was sent clipped and compared unclipped: "does not take a goal at its present position"."""
    it = rig()
    it.driver.open()
    it.driver.read(it.state)
    bus, knee = it.driver.buses[0], it.robot.index("l_knee")
    limit = float(bus.measured.ticks[knee]) - 5
    bus.position_limits[1, knee] = limit
    bus.guard.limit(knee, 0, limit)
    it.driver.set_torque(True)
    assert it.servo(KNEE).get("goal_position") == limit
    it.tick(3)
    assert it.emulator.body.plant.enabled.all()


def test_goals_start_from_pins_not_from_the_last_read(rig: Callable[..., Rig]) -> None:
    """Regression: the driver reads again before it pins; the next goal was outside the pin, and counted."""
    it = rig()
    it.driver.open()
    it.driver.read(it.state)
    knee = it.robot.index("l_knee")
    it.world.advance(0.02)
    it.emulator.body.position[knee] += 0.05
    it.driver.set_torque(True)
    goal = it.state.position.copy()
    it.driver.take_pins(goal)
    assert abs(goal[knee] - it.emulator.body.position[knee]) <= it.robot.tick_rad[knee]
    others = np.arange(it.robot.n) != knee
    np.testing.assert_allclose(goal[others], it.state.position[others], atol=it.robot.tick_rad[0])
    untouched = np.full(it.robot.n, np.nan)
    it.driver.take_pins(untouched)
    assert np.isnan(untouched).all()


def test_goals_within_a_tick_of_a_limit_are_no_violation(op3: Robot, rig: Callable[..., Rig]) -> None:
    it = rig()
    it.start()
    for limit in (op3.lower, op3.upper):
        it.command.position[:] = limit
        it.tick(1)
    assert it.driver.violations == 0 and it.emulator.body.receiver.position_violations == 0


def test_a_current_limit_below_the_factorys_bounds_the_goal_current(tmp_path: Path) -> None:
    """Regression: the table's limit was sent as goal current; the servo refused it and the goal position after it."""
    robot = op3_with(tmp_path, servo="XC330-T288", baud=1_000_000, current_bound=True)
    it = Rig(robot)
    for servo in it.bus.servos:
        servo.put("current_limit", 300)
    with it.driver:
        it.driver.read(it.state)
        it.driver.set_torque(True)
        it.command.position[:] = it.state.position + 0.1
        it.tick(2)
        assert {servo.get("goal_current") for servo in it.bus.servos} == {300}
        goals = [servo.get("goal_position") for servo in it.bus.servos]
        assert goals == list(robot.to_ticks(it.command.position))
        assert it.driver.violations == 0


@pytest.mark.parametrize("servo", ["MX-28(2.0)", "MX-64(2.0)", "MX-106(2.0)"])
def test_mx_servos_with_protocol_2_are_configured_and_hold(tmp_path: Path, servo: str) -> None:
    """Regression: they were refused as servos with another control table."""
    robot = op3_with(tmp_path, servo=servo, baud=1_000_000)
    it = Rig(robot)
    assert it.servo(KNEE).get("position_p_gain") == 850
    it.start()
    it.tick(5)
    np.testing.assert_allclose(it.state.position, robot.stand_pose, atol=0.01)
    assert it.emulator.body.plant.enabled.all() and not it.state.stale.any()
    assert np.isfinite(it.state.effort).all() == (servo != "MX-28(2.0)")
    it.driver.close()


def test_an_answer_in_pieces_wakes_the_loop_for_the_first_and_the_last(
    rig: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An adapter passes an answer of 308 bytes on in pieces of 62: the loop woke for each of them."""
    it = rig()
    it.start()
    port = it.driver.buses[0].port
    receive, wait, sleep = port.receive, port.wait_any, port.sleep
    head, waits, slept = b"\xff\xff\xfd\x00\xfe", 0, 0.0

    def waited(ports: list[SerialPort], seconds: float) -> None:
        nonlocal waits
        waits += 1
        if waits == 1:  # half a millisecond later the first piece is there
            it.world.advance(0.0005)
        else:
            wait(ports, seconds)

    def received() -> bytes:
        if waits == 0:
            return b""
        return head if waits == 1 else receive().removeprefix(head)

    def asleep(seconds: float) -> None:
        nonlocal slept
        slept += seconds
        sleep(seconds)

    monkeypatch.setattr(port, "wait_any", waited)
    monkeypatch.setattr(port, "receive", received)
    monkeypatch.setattr(port, "sleep", asleep)
    it.driver.read(it.state)
    assert not it.state.stale.any() and it.state.imu_stale == 0
    assert waits <= 3  # two for the servos' answer, one for the IMU's
    assert slept > port.seconds(100)
