"""What the driver notices about servos that do not receive, refuse, or are set up to protect nothing."""

from __future__ import annotations

import logging
import os
import select
from collections.abc import Callable

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.servo_bus import WATCHDOG_TRIPS
from flexmotion.drivers.dynamixel import exchange
from flexmotion.drivers.dynamixel.packet import Error
from flexmotion.drivers.emulator.dynamixel_bus import EmulatedDynamixelBus
from flexmotion.drivers.port import SerialPort

from .test_driver import KNEE, Rig, rig  # noqa: F401 - a fixture

Rigs = Callable[..., Rig]
HANGING_S = 60.0
"""Bound against hanging."""


def trip(it: Rig) -> None:
    it.servo(KNEE).put("bus_watchdog", -1)
    it.servo(KNEE).put("goal_position", 2048)


def test_a_servo_that_refuses_goals_behind_its_watchdog_is_named_and_takes_them_again(
    rig: Rigs,  # noqa: F811
    caplog: pytest.LogCaptureFixture,
) -> None:
    """It refused 1,188 goals, without a message."""
    it = rig()
    it.start()
    it.tick(6)
    trip(it)
    it.tick(8)
    assert "servo of l_knee (id 14): its bus watchdog has tripped, goals were refused: cleared" in caplog.text
    assert it.servo(KNEE).get("bus_watchdog") == 8 and not it.state.hardware_error.any()
    assert it.servo(KNEE).get("goal_position") == it.robot.to_ticks(it.command.position)[it.robot.index("l_knee")]


def test_after_its_watchdog_tripped_a_servos_goals_begin_where_it_stopped(rig: Rigs) -> None:  # noqa: F811
    """It was sent to the newest goal in one tick, from where it had stopped."""
    it = rig()
    it.start()
    it.tick(6)
    it.driver.take_pins(np.zeros(it.robot.n))  # of the start
    knee = it.robot.index("l_knee")
    it.emulator.body.block(knee, True)
    stopped = it.emulator.body.position[knee]
    trip(it)
    it.command.position[knee] += 0.3  # the plan moves on
    pins = np.full(it.robot.n, np.nan)
    for _ in range(8):
        it.tick()
        it.driver.take_pins(pins)
    assert abs(pins[knee] - stopped) < 0.01 and np.isnan(np.delete(pins, knee)).all()
    assert abs(pins[knee] - it.command.position[knee]) > 0.25


def test_the_goals_of_a_tripped_servo_begin_inside_the_envelope(rig: Rigs) -> None:  # noqa: F811
    """A knee that the load had pressed out of its limits was pinned there: the driver's own guard refused the goals."""
    it = rig()
    knee, body = it.robot.index("l_knee"), it.emulator.body
    limit = it.robot.lower[knee]
    it.command.position[knee] = limit
    it.start()
    it.tick(200)
    body.position[knee] = limit - 0.02
    body.block(knee, True)
    it.tick(5)
    trip(it)
    pins = np.full(it.robot.n, np.nan)
    it.driver.take_pins(np.zeros(it.robot.n))
    for _ in range(8):
        it.tick()
        it.driver.take_pins(pins)
        np.copyto(it.command.position, pins, where=np.isfinite(pins))  # as the loop does
    assert pins[knee] == pytest.approx(limit, abs=it.robot.tick_rad[knee])
    assert it.driver.violations == 0 and body.receiver.position_violations == 0


def test_a_watchdog_that_trips_again_and_again_is_an_error(rig: Rigs) -> None:  # noqa: F811
    it = rig()
    it.start()
    for _ in range(4):
        trip(it)
        it.tick(8)
    trip(it)
    seen = set()
    for _ in range(8):
        it.tick()
        seen.add(int(it.state.hardware_error[it.robot.index("l_knee")]))
    assert WATCHDOG_TRIPS in seen


def test_the_torque_switch_is_read_as_often_as_before_but_in_every_fourth_tick(rig: Rigs) -> None:  # noqa: F811
    it = rig()
    it.start()
    it.tick(10)
    it.servo(KNEE).put("torque_enable", 0)
    it.tick(2)
    assert it.state.hardware_error[it.robot.index("l_knee")] == 0x100


def test_an_answer_with_an_error_is_no_measurement(
    rig: Rigs,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its error byte was not looked at: the data of a refused read were taken for a position."""
    it = rig()
    it.start()
    it.tick(3)
    knee, joint = it.servo(KNEE), it.robot.index("l_knee")
    before = it.state.position[joint]
    monkeypatch.setattr(knee, "read", lambda address, size: (Error.RANGE, bytes(size)))
    it.tick(3)
    assert it.state.stale[joint] > 0 and it.state.position[joint] == before
    assert not np.delete(it.state.stale, joint).any()


def test_torque_off_that_a_servo_does_not_confirm_is_told(rig: Rigs) -> None:  # noqa: F811
    it = rig()
    it.start()
    it.tick(2)
    it.suffer(f"dead:{KNEE}")
    it.driver.set_torque(False)
    assert it.driver.holding == ["l_knee (id 14)"]
    it.suffer()
    it.driver.set_torque(False)
    assert it.driver.holding == []


def test_answers_that_are_late_confirm_torque_off(rig: Rigs) -> None:  # noqa: F811
    it = rig()
    it.start()
    it.tick(2)
    it.suffer("late:0.02")
    it.driver.set_torque(False)
    assert it.driver.holding == [] and not it.emulator.body.plant.enabled.any()


def test_an_adapter_that_echoes_is_named(rig: Rigs) -> None:  # noqa: F811
    it = rig()
    it.suffer("echo")
    with pytest.raises(DriverError, match="port main: the adapter echoes what is sent"):
        it.driver.open()


def test_a_servo_that_protects_itself_from_nothing_is_not_driven(rig: Rigs) -> None:  # noqa: F811
    it = rig()
    it.servo(KNEE).put("shutdown", 0)
    with pytest.raises(ConfigError, match="l_knee .*shutdown is 0, the robot file wants 52"):
        it.driver.open()


def test_fast_reads_are_tried_again_after_a_while(
    rig: Rigs,  # noqa: F811
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One bad second, and the bus was slow for the rest of the day."""
    monkeypatch.setattr(exchange, "RETRY_CYCLES", 30)
    caplog.set_level(logging.WARNING)
    it = rig()
    it.start()
    it.tick(3)
    tables = {servo.id: servo.table for servo in it.bus.servos}
    for servo in it.bus.servos:
        servo.table = servo.table.model_copy(update={"fast_sync_read_firmware": 99})
    it.tick(20)
    assert "sync reads from now on" in caplog.text and not it.state.stale.any()
    it.tick(30)
    assert "are answered again" not in caplog.text
    for servo in it.bus.servos:
        servo.table = tables[servo.id]
    it.tick(80)
    assert "are answered again" in caplog.text and caplog.text.count("sync reads from now on") == 1
    assert not it.state.stale.any() and it.driver.buses[0].cycle.groups[0].fast  # type: ignore[attr-defined]


def test_servos_behind_a_silent_one_are_not_blamed(
    op3: Robot,
    rig: Rigs,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In a sync read the servos after a silent one waited for it in every tick, and all counted as silent."""
    real = EmulatedDynamixelBus._read_each

    def strict(self: EmulatedDynamixelBus, requests: list, listening: dict, now: float) -> list:
        silent = [place for place, (id_, _, _) in enumerate(requests) if id_ not in listening]
        return real(self, requests[: silent[0]] if silent else requests, listening, now)

    monkeypatch.setattr(EmulatedDynamixelBus, "_read_each", strict)
    it = rig()
    for servo in it.bus.servos:
        servo.put("firmware_version", 40)
    it.start()
    it.tick(2)
    it.suffer("dead:4")
    it.tick(8)
    dead = op3.index("l_sho_roll")
    assert it.state.stale[dead] >= 6
    assert np.delete(it.state.stale, dead).max() <= 1


def test_a_write_that_the_adapter_takes_in_parts_is_completed(monkeypatch: pytest.MonkeyPatch) -> None:
    master, slave = os.openpty()
    port = SerialPort(os.ttyname(slave), 1_000_000)
    write, turns = os.write, [0]

    def short(fd: int, data: bytes) -> int:
        turns[0] += 1
        if turns[0] % 3 == 0:
            raise BlockingIOError
        return write(fd, data[:7])

    monkeypatch.setattr(os, "write", short)
    packet = bytes(range(1, 101))
    port.send(packet)
    came = b""
    while len(came) < len(packet):
        assert select.select([master], (), (), HANGING_S)[0], f"only {len(came)} bytes came"
        came += os.read(master, 200)
    assert came == packet and port.lost is None
    port.close()
    os.close(master)
    os.close(slave)
