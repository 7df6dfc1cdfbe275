"""Drivers of Feetech and LX-16A servos: capabilities, goals, torque, and faults on their buses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.bus.driver import CONFIRM_S, BusDriver
from flexmotion.drivers.bus.goal_guard import GoalGuard
from flexmotion.drivers.bus.packet import SumDecoder, SumPacket
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.feetech_bus import EmulatedFeetechBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.feetech.bus import FeetechBus
from flexmotion.drivers.feetech.registers import FORMAT as STS_FORMAT
from flexmotion.drivers.feetech.registers import Instruction
from flexmotion.drivers.feetech.registers import sts as sts_table
from flexmotion.drivers.feetech.tools import FeetechTools
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.lx16a.bus import Lx16aBus
from flexmotion.drivers.lx16a.protocol import FORMAT, Command
from flexmotion.drivers.registry import create

from .lost_packets import lose
from .robots import looped, op3_with
from .wire_tap import WireTap


def ticks(driver: BusDriver, world: Loopback, state: RobotState, command: JointCommand, many: int) -> None:
    for _ in range(many):
        driver.read(state)
        driver.write(command)
        world.advance(0.008)


@pytest.fixture
def sts(tmp_path: Path) -> Robot:
    return op3_with(tmp_path, servo="STS3215-12V", baud=1_000_000)


@pytest.fixture
def lx(tmp_path: Path) -> Robot:
    return op3_with(tmp_path, servo="LX-16A", baud=115_200)


def test_a_driver_refuses_servos_of_another_protocol(sts: Robot) -> None:
    with pytest.raises(ConfigError, match=r"servo STS3215-12V on bus 'main' has protocol feetech.* dynamixel2"):
        create("dynamixel", sts, port="main")
    with pytest.raises(ConfigError, match="has protocol dynamixel2, this driver supports lx16a"):
        create("lx16a", load_robot("op3"), port="main")


def test_capabilities_match_the_servos(sts: Robot, lx: Robot) -> None:
    assert create("feetech", sts, port="main").capabilities.effort
    poor = create("lx16a", lx, port="main").capabilities
    assert not (poor.effort or poor.torque_bound or poor.imu)


def test_the_budget_says_that_twenty_lx16a_are_slow(sts: Robot, lx: Robot) -> None:
    assert FeetechBus.budget(sts, "main").cycle_s == pytest.approx(0.0052, rel=0.1)
    assert Lx16aBus.budget(lx, "main").cycle_s > 0.035


def test_lx16a_servos_are_read_in_turns_and_do_not_go_stale(lx: Robot) -> None:
    driver, world = looped("lx16a", lx)
    state, command = RobotState(lx.n), JointCommand(lx.n)
    with driver:
        command.position[:] = lx.stand_pose
        ticks(driver, world, state, command, 100)
        assert not state.stale.any()
        assert np.isfinite(state.voltage).all() and np.isnan(state.effort).all()


def test_a_feetech_servo_that_is_not_configured_is_refused_and_not_written(sts: Robot) -> None:
    driver, world = looped("feetech", sts)
    bus = world.emulator.lines[0].bus
    assert isinstance(bus, EmulatedFeetechBus)
    bus.servos[3].put("homing_offset", -80)
    with pytest.raises(ConfigError, match=r"l_sho_roll \(id 4\).*homing_offset is -80, the robot file wants 0"):
        driver.open()
    assert not any(servo.eeprom_writes for servo in bus.servos)


@pytest.mark.parametrize(
    ("setting", "held", "wanted"),
    [("phase", 28, 12), ("angle_resolution", 3, 1), ("homing_offset", -80, 0), ("max_position_limit", 0, 4095)],
)
def test_a_feetech_servo_that_counts_turns_is_found_and_configured_and_restored(
    sts: Robot, setting: str, held: int, wanted: int
) -> None:
    """Its position was taken for that of one turn: the joint stood 4096 steps from where it was."""
    driver, world = looped("feetech", sts)
    bus = world.emulator.lines[0].bus
    assert isinstance(bus, EmulatedFeetechBus)
    servo = bus.servos[11]
    servo.put(setting, held)
    with pytest.raises(ConfigError, match=rf"l_knee \(id 14\).*{setting} is {held}, the robot file wants {wanted}"):
        driver.open()
    assert not servo.eeprom_writes
    tools = FeetechTools(world.open_port("main", 1_000_000))
    (old,) = [tools.inspect(sts, joint) for joint in range(sts.n) if sts.joints[joint].id == servo.get("id")]
    assert old.changes == {setting: wanted}
    joint = sts.joint_names.index(old.joint)
    tools.write_settings(sts, joint, old.changes)
    assert servo.get(setting) == wanted and servo.get("lock") == 1
    with driver:
        driver.read(state := RobotState(sts.n))
        assert not state.stale.any()
    tools.write_settings(sts, joint, {setting: old.held[setting]})
    assert servo.get(setting) == held


def test_a_position_before_zero_has_its_sign_in_bit_15(sts: Robot) -> None:
    driver, world = looped("feetech", sts)
    with driver:
        servo = world.emulator.lines[0].bus.servos[0]
        servo.put("homing_offset", 2047)
        servo.put("phase", servo.get("phase") | 16)
        before = float(world.emulator.body.robot.to_ticks(world.emulator.body.position)[0])
        world.emulator.body.position[0] -= 0.5 * world.emulator.body.robot.direction[0]
        driver.read(RobotState(sts.n))
        ticks = float(driver.buses[0].measured.ticks[0])
        assert ticks < 0 and ticks == pytest.approx(before - 0.5 / sts.tick_rad[0] - 2047, abs=1)


@pytest.mark.parametrize("name", ["feetech", "lx16a"])
def test_a_missing_servo_is_named(name: str, sts: Robot, lx: Robot) -> None:
    driver, world = looped(name, sts if name == "feetech" else lx)
    world.emulator.lines[0].bus.dead = {14}
    with pytest.raises(DriverError, match=r"servo of l_knee \(id 14\) on main: does not answer"):
        driver.open()


@pytest.mark.parametrize("name", ["feetech", "lx16a"])
def test_a_dead_servo_goes_stale_alone_and_a_pulled_cable_takes_all(name: str, tmp_path: Path) -> None:
    kind = {"feetech": ("STS3215-12V", 1_000_000), "lx16a": ("LX-16A", 115_200)}[name]
    robot = op3_with(tmp_path, servo=kind[0], baud=kind[1])
    driver, world = looped(name, robot)
    state, command = RobotState(robot.n), JointCommand(robot.n)
    with driver:
        driver.read(state)
        driver.set_torque(True)
        command.position[:] = state.position
        ticks(driver, world, state, command, 3)
        world.emulator.faults[:] = [Fault.parse("dead:14")]
        ticks(driver, world, state, command, 150)
        knee = robot.index("l_knee")
        assert state.stale[knee] > 5 and np.delete(state.stale, knee).max() == 0
        world.emulator.faults[:] = [Fault.parse("cable")]
        ticks(driver, world, state, command, 150)
        assert state.stale.min() > 5


@pytest.mark.parametrize("name", ["feetech", "lx16a"])
def test_torque_goes_on_with_goals_pinned_and_goals_past_a_limit_are_counted(name: str, sts: Robot, lx: Robot) -> None:
    robot = sts if name == "feetech" else lx
    driver, world = looped(name, robot)
    state, command = RobotState(robot.n), JointCommand(robot.n)
    servos = world.emulator.lines[0].bus.servos
    if name == "feetech":
        for servo in servos:
            servo.put("goal_position", 900)  # left by an earlier program
    with driver:
        ticks(driver, world, state, command, 20)
        driver.set_torque(True)
        present = robot.to_ticks(world.emulator.body.position)
        goals = [servo.get("goal_position") if name == "feetech" else servo.goal for servo in servos]
        assert np.abs(np.array(goals) - present).max() <= 1
        command.position[:] = robot.stand_pose
        ticks(driver, world, state, command, 20)
        assert driver.violations == 0
        bus = driver.buses[0]
        bus.guard.limit(3, 0, 10)  # a servo whose limits are narrower than the file's
        command.position[:] += 0.01
        ticks(driver, world, state, command, 20)
        assert driver.violations > 0


def test_an_lx16a_outside_its_own_limits_is_pinned_to_the_nearest(lx: Robot) -> None:
    """Regression: without the servo's own limits its first goal was not a number, and torque stayed on."""
    driver, world = looped("lx16a", lx)
    with driver:
        driver.read(RobotState(lx.n))
        bus = driver.buses[0]
        assert isinstance(bus, Lx16aBus)
        limit = int(bus.measured.ticks[3]) - 5
        bus._position_limits[1, 3] = limit
        bus.guard.limit(3, 0, limit)
        driver.set_torque(True)
        assert bus.pins[3] == limit and driver.violations == 0
        assert world.emulator.body.plant.enabled.all()


def test_a_first_goal_outside_goes_to_the_nearest_inside() -> None:
    guard = GoalGuard(np.zeros(2), np.full(2, 100.0))
    np.testing.assert_array_equal(guard.admit(np.array([0, 1]), np.array([150.0, 50.0])), [100.0, 50.0])
    assert guard.violations == 1


def test_a_bus_that_goes_silent_during_torque_on_does_not_block_the_loop(
    sts: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: every servo in turn was asked for 0.3 s; a loop blocked for 2 s is killed, with torque on."""
    driver, world = looped("feetech", sts)
    driver.open()
    driver.read(RobotState(sts.n))
    bus = driver.buses[0]
    assert isinstance(bus, FeetechBus)
    read = bus._read

    def cut_then_read(slot: int, names: Sequence[str]) -> dict[str, int]:
        world.emulator.faults[:] = [Fault.parse("cable")]
        world.advance(0.015)
        return read(slot, names)

    monkeypatch.setattr(bus, "_read", cut_then_read)
    begin = world.now
    with pytest.raises(DriverError, match="torque stays off"):
        driver.set_torque(True)
    assert world.now - begin < 1.0
    driver.close()


def test_a_servo_outside_its_own_limits_is_pinned_to_the_nearest(sts: Robot) -> None:
    """Regression: the measured position was sent as the goal, and the servo replaced it by its own limit."""
    driver, world = looped("feetech", sts)
    state = RobotState(sts.n)
    with driver:
        driver.read(state)
        bus = driver.buses[0]
        assert isinstance(bus, FeetechBus)
        limit = bus.measured.ticks[3] - 5
        bus._position_limits[1, 3] = limit
        bus.guard.limit(3, 0, limit)
        driver.set_torque(True)
        assert world.emulator.lines[0].bus.servos[3].get("goal_position") == limit
        assert driver.violations == 0


@pytest.mark.parametrize("name", ["feetech", "lx16a"])
def test_a_goal_past_a_limit_is_not_sent(name: str, sts: Robot, lx: Robot) -> None:
    """Regression: it was sent, and counted afterwards."""
    robot = sts if name == "feetech" else lx
    driver, world = looped(name, robot)
    state, command = RobotState(robot.n), JointCommand(robot.n)
    with driver:
        ticks(driver, world, state, command, 20)
        driver.set_torque(True)
        command.position[:] = state.position
        ticks(driver, world, state, command, 20)
        knee = robot.index("l_knee")
        command.position[knee] = robot.upper[knee] + 0.05
        ticks(driver, world, state, command, 20)
        assert driver.violations > 0
        assert world.emulator.body.receiver.position_violations == 0
        assert abs(world.emulator.body.receiver.goal[knee] - robot.stand_pose[knee]) < 0.02


@pytest.mark.parametrize("name", ["feetech", "lx16a"])
def test_torque_off_that_a_servo_does_not_confirm_is_told(name: str, sts: Robot, lx: Robot) -> None:
    """These buses sent torque off and asked nobody: a servo that still held was not named."""
    robot = sts if name == "feetech" else lx
    driver, world = looped(name, robot)
    state = RobotState(robot.n)
    with driver:
        driver.read(state)
        driver.set_torque(True)
        world.emulator.faults[:] = [Fault.parse("dead:14")]
        world.advance(0.02)
        driver.set_torque(False)
        assert driver.holding == ["l_knee (id 14)"]
        world.emulator.faults[:] = []
        world.advance(0.02)
        driver.set_torque(False)
        assert driver.holding == [] and not world.emulator.body.plant.enabled.any()


@pytest.mark.parametrize("name", ["feetech", "lx16a"])
def test_a_single_servo_is_switched_and_the_others_keep_their_goals(name: str, sts: Robot, lx: Robot) -> None:
    """A limp servo gets no goals, and the pin arrives with the torque."""
    robot = sts if name == "feetech" else lx
    driver, world = looped(name, robot)
    state, command, body = RobotState(robot.n), JointCommand(robot.n), world.emulator.body
    knee = robot.index("l_knee")
    with driver:
        ticks(driver, world, state, command, 30)
        driver.set_torque(True)
        command.position[:] = state.position
        ticks(driver, world, state, command, 30)
        driver.take_pins(np.zeros(robot.n))
        which = np.arange(robot.n) == knee
        driver.switch(which, False)
        command.position[knee] += 0.5
        ticks(driver, world, state, command, 40)
        assert not body.plant.enabled[knee] and body.plant.enabled.sum() == robot.n - 1
        assert abs(body.position[knee] - robot.stand_pose[knee]) < 0.02
        body.position[knee] += 0.3  # by hand
        command.position[knee] = body.position[knee]
        ticks(driver, world, state, command, 40)
        driver.switch(which, True)
        world.advance(0.02)
        assert body.plant.enabled.all()
        pins = np.full(robot.n, np.nan)
        driver.take_pins(pins)
        assert pins[knee] == pytest.approx(body.position[knee], abs=0.02) and np.isnan(np.delete(pins, knee)).all()
        ticks(driver, world, state, command, 40)
        assert abs(body.position[knee] - command.position[knee]) < 0.03
        assert driver.violations == 0 and body.receiver.violations == 0
    assert not driver.capabilities.reboot


@pytest.mark.parametrize("silent", [(), (14,), (3, 9, 14, 20), range(1, 21)], ids=["none", "one", "four", "all"])
@pytest.mark.parametrize("name", ["feetech", "lx16a"])
def test_torque_off_is_confirmed_within_a_bounded_time(name: str, silent: Sequence[int], sts: Robot, lx: Robot) -> None:
    """On a silent LX-16A bus every servo was asked alone, three times: a tick took 1.3 s, and `close` as much again.

    The supervisor ends a loop that does not tick for 2 s, and 1 s after a request to quit: torque would have stayed on.
    """
    robot = sts if name == "feetech" else lx
    driver, world = looped(name, robot)
    state = RobotState(robot.n)
    with driver:
        driver.read(state)
        driver.set_torque(True)
        world.emulator.faults[:] = [Fault.parse(f"dead:{id_}") for id_ in silent]
        world.advance(0.02)
        for _ in range(2):  # by the loop, and as the driver is closed
            begin = world.now
            driver.set_torque(False)
            assert world.now - begin < CONFIRM_S + 0.01  # and the packet that is on the wire
            assert sorted(driver.holding) == sorted(
                f"{joint.name} (id {joint.id})" for joint in robot.joints if joint.id in silent
            )


def lx16a_packets(sent: bytes, *commands: Command) -> list[SumPacket]:
    """Packets with these commands among sent bytes."""
    return [packet for packet in SumDecoder(FORMAT).feed(sent) if packet.code in commands]


def test_a_lost_goal_of_an_lx16a_that_does_not_change_is_sent_again(lx: Robot) -> None:
    """It was sent once: at the end of a motion one lost packet left the knee away from its goal for good."""
    driver, world = looped("lx16a", lx)
    state, command, knee = RobotState(lx.n), JointCommand(lx.n), lx.index("l_knee")
    with driver:
        driver.read(state)
        driver.set_torque(True)
        command.position[:] = state.position
        ticks(driver, world, state, command, 10)
        lost = lose(driver.buses[0].port, lambda data: any(p.id == 14 for p in lx16a_packets(data, Command.MOVE)))
        command.position[knee] += 0.3
        ticks(driver, world, state, command, driver.turns + 50)
        assert len(lost) == 1
        assert world.emulator.body.position[knee] == pytest.approx(command.position[knee], abs=0.02)


@pytest.mark.parametrize("moving", [0, 12, 20])
def test_lx16a_goals_that_are_sent_again_fit_the_tick_and_delay_others_little(moving: int, lx: Robot) -> None:
    driver, world = looped("lx16a", lx)
    tap = WireTap(world)
    driver.open_port = world.open_port
    state, command = RobotState(lx.n), JointCommand(lx.n)
    with driver:
        driver.read(state)
        driver.set_torque(True)
        command.position[:] = state.position
        ticks(driver, world, state, command, 20)
        tap.clear()
        many, ids = 5 * driver.turns, driver.buses[0].ids
        for tick in range(many):
            begin = world.now
            driver.read(state)
            command.position[:moving] += 0.05 * (-1) ** tick
            driver.write(command)
            assert driver.buses[0].port.busy_until - begin < 0.75 / lx.rate_hz
            world.advance(begin + 1 / lx.rate_hz - world.now)
        sent = Counter(packet.id for packet in lx16a_packets(bytes(tap.sent), Command.MOVE))
    assert all(4 <= sent[id_] <= 6 for id_ in ids[moving:])
    assert sum(sent[id_] for id_ in ids[:moving]) >= (3.5 * many if moving else 0)  # 4 fit a tick


def test_no_lx16a_gets_torque_while_another_does_not_answer(lx: Robot) -> None:
    """Each was switched on before the next was asked: 19 held for 0.4 s, and the message said torque stays off."""
    driver, world = looped("lx16a", lx)
    tap = WireTap(world)
    driver.open_port = world.open_port
    with driver:
        driver.read(RobotState(lx.n))
        port = driver.buses[0].port
        last = driver.buses[0].ids[-1]
        lose(port, lambda data: any(p.id == last for p in lx16a_packets(data, Command.READ_POSITION)), many=1000)
        tap.clear()
        with pytest.raises(DriverError, match=rf"\(id {last}\) on main: does not answer: torque stays off"):
            driver.set_torque(True)
        sent = lx16a_packets(bytes(tap.sent), Command.MOVE, Command.LOAD)
    assert not any(packet.code == Command.MOVE or packet.params[0] for packet in sent)


def test_lx16a_servos_that_have_confirmed_are_not_asked_again(lx: Robot) -> None:
    driver, world = looped("lx16a", lx)
    tap = WireTap(world)
    driver.open_port = world.open_port
    with driver:
        driver.read(RobotState(lx.n))
        driver.set_torque(True)
        world.emulator.faults[:] = [Fault.parse("dead:14")]
        world.advance(0.02)
        tap.clear()
        driver.set_torque(False)
        sent = bytes(tap.sent)
    asked = Counter(packet.id for packet in lx16a_packets(sent, Command.READ_LOAD))
    assert asked.pop(14) > 1 and set(asked.values()) == {1}


def test_answers_that_an_adapter_delays_confirm_torque_off(lx: Robot) -> None:
    """Without a low-latency mode an adapter keeps bytes for 16 ms: longer than each servo is waited for."""
    driver, world = looped("lx16a", lx)
    with driver:
        driver.read(RobotState(lx.n))
        driver.set_torque(True)
        world.emulator.faults[:] = [Fault.parse("late:0.016")]
        world.advance(0.02)
        driver.set_torque(False)
        assert driver.holding == []
        world.emulator.faults[:] = []
        world.advance(0.02)


def test_a_feetech_servo_has_a_position_before_the_first_read_of_a_run(sts: Robot) -> None:
    """Regression: a servo that missed the first read stood at tick 0, -3.14 rad, and the run did not start."""
    driver, world = looped("feetech", sts)
    state, shoulder = RobotState(sts.n), sts.index("r_sho_roll")
    with driver:
        world.emulator.faults[:] = [Fault.parse("dead:3")]
        world.advance(0.01)
        driver.read(state)
        assert state.stale[shoulder] == 1
        assert state.position[shoulder] == pytest.approx(sts.stand_pose[shoulder], abs=0.01)


@pytest.mark.parametrize(
    ("register", "what"),
    [
        ("goal_position", "does not take its goal position"),
        ("torque_limit", "does not take its torque limit"),
        ("torque_enable", "does not switch its torque on"),
    ],
)
def test_the_feetech_servo_that_refuses_a_start_is_blamed(
    register: str, what: str, sts: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: the first servo of the bus was named, whichever it was."""
    driver, world = looped("feetech", sts)
    bus, knee = world.emulator.lines[0].bus, sts.index("l_knee")
    assert isinstance(bus, EmulatedFeetechBus)
    servo, address = bus.servos[knee], sts_table()[register].address
    write = servo.write

    def wrong(at: int, data: bytes) -> None:
        """It takes another goal, and no torque."""
        write(at, data if at != address else bytes(1) if register == "torque_enable" else data[:1] + bytes(1))

    monkeypatch.setattr(servo, "write", wrong)
    with driver, pytest.raises(DriverError, match=rf"servo of l_knee \(id 14\) on main: {what}: torque stays off"):
        driver.set_torque(True)
    assert not world.emulator.body.plant.enabled.any()


def test_feetech_servos_are_not_left_damped_by_a_lost_packet(sts: Robot) -> None:
    """After a fall, one lost packet left all servos at a tenth of their torque: armed, and nothing said so."""
    driver, world = looped("feetech", sts)
    bus, register = world.emulator.lines[0].bus, sts_table()["torque_limit"]
    assert isinstance(bus, EmulatedFeetechBus)
    with driver:
        driver.read(RobotState(sts.n))
        driver.set_torque(True)
        driver.damp()
        world.advance(0.02)
        assert {servo.get("torque_limit") for servo in bus.servos} == {100}
        driver.set_torque(False)
        lost = lose(
            driver.buses[0].port,
            lambda data: any(
                packet.code == Instruction.SYNC_WRITE and packet.params[0] == register.address
                for packet in SumDecoder(STS_FORMAT).feed(data)
            ),
        )
        driver.set_torque(True)
        assert len(lost) == 1 and world.emulator.body.plant.enabled.all()
        assert {servo.get("torque_limit") for servo in bus.servos} == {1000}


def test_a_feetech_servo_keeps_the_maximum_torque_that_its_owner_has_set(
    sts: Robot, caplog: pytest.LogCaptureFixture
) -> None:
    """Torque on set every torque limit to 100 %: an owner's lower one was gone, without a message."""
    driver, world = looped("feetech", sts)
    bus, knee = world.emulator.lines[0].bus, sts.index("l_knee")
    assert isinstance(bus, EmulatedFeetechBus)
    servo, other = bus.servos[knee], bus.servos[knee - 1]
    servo.put("max_torque", 500)
    servo.restart(world.now)
    world.advance(0.3)
    assert servo.get("torque_limit") == 500
    for _ in range(2):  # the second run finds the servos damped
        with driver:
            driver.read(RobotState(sts.n))
            driver.set_torque(True)
            assert (servo.get("torque_limit"), other.get("torque_limit")) == (500, 1000)
            driver.damp()
            world.advance(0.02)
            assert (servo.get("torque_limit"), other.get("torque_limit")) == (50, 100)
    assert [record.getMessage() for record in caplog.records] == [
        "servo of l_knee (id 14): its maximum torque is set to 50 %: kept"
    ] * 2


def test_a_feetech_torque_limit_in_ram_is_replaced_with_a_warning(sts: Robot, caplog: pytest.LogCaptureFixture) -> None:
    driver, world = looped("feetech", sts)
    bus, knee = world.emulator.lines[0].bus, sts.index("l_knee")
    assert isinstance(bus, EmulatedFeetechBus)
    bus.servos[knee].put("torque_limit", 500)
    with driver:
        driver.read(RobotState(sts.n))
        driver.set_torque(True)
        assert bus.servos[knee].get("torque_limit") == 1000
    assert [record.getMessage() for record in caplog.records] == [
        "servo of l_knee (id 14): its torque limit of 50 % until power-off is replaced by its maximum torque, 100 %"
    ]


def test_a_feetech_servo_switches_itself_off_at_its_own_temperature(sts: Robot) -> None:
    """Regression: the catalogue's temperature counted, whatever the servo was set to."""
    driver, world = looped("feetech", sts)
    bus, knee = world.emulator.lines[0].bus, sts.index("l_knee")
    assert isinstance(bus, EmulatedFeetechBus)
    bus.servos[knee].put("temperature_limit", 55)
    with driver:
        assert driver.temperature_limit[knee] == 55 and driver.temperature_limit[knee - 1] == 70


def test_a_feetech_servo_with_an_integral_gain_is_not_configured(sts: Robot) -> None:
    """The servo plant has none: such a joint goes on turning after its goal has stopped."""
    driver, world = looped("feetech", sts)
    bus = world.emulator.lines[0].bus
    assert isinstance(bus, EmulatedFeetechBus)
    bus.servos[sts.index("l_knee")].put("i_gain", 5)
    with pytest.raises(ConfigError, match=r"l_knee \(id 14\).*i_gain is 5, the robot file wants 0"):
        driver.look()
