from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.configs.robot import load_robot
from flexmotion.drivers.dynamixel.packet import BROADCAST, Error, Instruction, encode, split_fast_status

from .conftest import Host

ROBOT = load_robot("op3")  # hypothesis takes no fixtures

KNEE = 14


def sync_read(address: int, size: int, *ids: int) -> bytes:
    return address.to_bytes(2, "little") + size.to_bytes(2, "little") + bytes(ids)


def test_ping_returns_model_and_firmware(host: Host) -> None:
    (answer,) = host.send(1, Instruction.PING)
    assert (answer.id, answer.params) == (1, bytes([0, 0xFC, 0x03, 46]))
    assert host.send(77, Instruction.PING) == []


def test_a_broadcast_ping_is_answered_by_all_in_order(host: Host) -> None:
    assert [answer.id for answer in host.send(BROADCAST, Instruction.PING)] == [*range(1, 21), 200]


def test_another_baud_rate_is_not_received(host: Host) -> None:
    host.baud = 1_000_000
    assert host.send(1, Instruction.PING) == []


def test_sync_read_answers_in_the_order_asked_with_a_packet_each(host: Host) -> None:
    answers = host.send(BROADCAST, Instruction.SYNC_READ, sync_read(132, 4, 5, 3, 9))
    assert [answer.id for answer in answers] == [5, 3, 9]
    ticks = {joint.id: tick for joint, tick in zip(ROBOT.joints, ROBOT.to_ticks(ROBOT.stand_pose), strict=True)}
    assert [int.from_bytes(answer.params[1:], "little") for answer in answers] == [ticks[i] for i in (5, 3, 9)]


def test_a_missing_servo_is_skipped_in_a_sync_read_and_ends_a_fast_one(host: Host) -> None:
    host.bus.dead = {3}
    answers = host.send(BROADCAST, Instruction.SYNC_READ, sync_read(132, 4, 5, 3, 9))
    assert [answer.id for answer in answers] == [5, 9]
    (reply,) = host.raw(encode(BROADCAST, Instruction.FAST_SYNC_READ, sync_read(132, 4, 5, 3, 9)))
    assert [id_ for _, id_, _ in split_fast_status(reply, 4)] == [5]
    assert int.from_bytes(reply[5:7], "little") + 7 - len(reply) == 2 * 8  # the header promised all three


def test_old_firmware_does_not_answer_a_fast_read(host: Host) -> None:
    host.servo(1).put("firmware_version", 44)
    assert host.raw(encode(BROADCAST, Instruction.FAST_SYNC_READ, sync_read(132, 4, 1, 2))) == []


def test_sync_write_moves_servos_whose_torque_is_on(host: Host) -> None:
    before = host.body.position.copy()
    for id_ in (1, 2):
        assert host.write(id_, "torque_enable", 1) == 0
    goals = b"".join(bytes([id_]) + (2200).to_bytes(4, "little") for id_ in (1, 2, 3))
    assert host.send(BROADCAST, Instruction.SYNC_WRITE, sync_read(116, 4) + goals) == []
    host.live(1.0)
    assert host.read(1, "present_position") == pytest.approx(2200, abs=8)
    assert host.read(2, "present_position") == pytest.approx(2200, abs=8)
    joint = ROBOT.index("r_sho_roll")  # id 3, off
    assert host.body.position[joint] == before[joint]


def test_eeprom_is_locked_while_torque_is_on(host: Host) -> None:
    assert host.write(1, "return_delay_time", 10) == 0
    host.write(1, "torque_enable", 1)
    assert host.write(1, "return_delay_time", 20) == Error.ACCESS
    assert host.read(1, "return_delay_time") == 10


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("return_delay_time", 255, Error.RANGE),
        ("operating_mode", 1, Error.RANGE),
        ("present_position", 5, Error.ACCESS),
        ("goal_position", 4096, Error.LIMIT),
        ("goal_current", 1200, Error.LIMIT),
        ("goal_pwm", 886, Error.RANGE),
    ],
)
def test_what_a_servo_refuses(host: Host, name: str, value: int, error: Error) -> None:
    assert host.write(1, name, value) == error


def test_a_register_written_in_part_is_refused(host: Host) -> None:
    params = (116).to_bytes(2, "little") + b"\x01\x02"
    (answer,) = host.send(1, Instruction.WRITE, params)
    assert answer.params[0] == Error.LENGTH


def test_status_levels_suppress_answers(host: Host) -> None:
    host.write(1, "status_return_level", 1)
    assert host.send(1, Instruction.WRITE, (65).to_bytes(2, "little") + b"\x01") == []
    assert host.read(1, "led") == 1
    host.send(1, Instruction.WRITE, (68).to_bytes(2, "little") + b"\x00")
    assert host.send(1, Instruction.READ, sync_read(132, 4)) == []
    assert len(host.send(1, Instruction.PING)) == 1


def test_indirect_addresses_reach_scattered_registers_for_reading_and_writing(host: Host) -> None:
    for slot, target in enumerate((132, 133, 146, 116, 117, 118, 119)):
        params = (168 + 2 * slot).to_bytes(2, "little") + target.to_bytes(2, "little")
        (answer,) = host.send(KNEE, Instruction.WRITE, params)
        assert answer.params[0] == 0
    (answer,) = host.send(KNEE, Instruction.READ, sync_read(224, 3))
    assert int.from_bytes(answer.params[1:3], "little") == host.read(KNEE, "present_position")
    assert answer.params[3] == 25
    (answer,) = host.send(KNEE, Instruction.WRITE, (227).to_bytes(2, "little") + (2100).to_bytes(4, "little"))
    assert answer.params[0] == 0 and host.read(KNEE, "goal_position") == 2100


def test_reg_write_waits_for_action(host: Host) -> None:
    host.send(1, Instruction.REG_WRITE, (65).to_bytes(2, "little") + b"\x01")
    assert host.read(1, "led") == 0
    host.send(BROADCAST, Instruction.ACTION)
    assert host.read(1, "led") == 1


def test_bulk_read_and_write_take_a_span_for_each(host: Host) -> None:
    host.send(BROADCAST, Instruction.BULK_WRITE, bytes.fromhex("01 41 00 01 00 01 02 74 00 04 00 D2 04 00 00"))
    answers = host.send(BROADCAST, Instruction.BULK_READ, bytes.fromhex("01 41 00 01 00 02 74 00 04 00"))
    assert [(answer.id, answer.params) for answer in answers] == [(1, b"\x00\x01"), (2, b"\x00\xd2\x04\x00\x00")]


def test_a_reboot_resets_ram_and_the_servo_is_off_meanwhile(host: Host) -> None:
    host.write(1, "position_p_gain", 400)
    host.write(1, "torque_enable", 1)
    (answer,) = host.send(1, Instruction.REBOOT)
    assert answer.params == b"\x00" and host.send(1, Instruction.PING) == []
    host.live(0.3)
    assert host.read(1, "position_p_gain") == 800 and host.read(1, "torque_enable") == 0


def test_the_bus_watchdog_stops_a_servo_that_receives_nothing(host: Host) -> None:
    host.write(KNEE, "torque_enable", 1)
    host.write(KNEE, "bus_watchdog", 8)  # 160 ms
    for _ in range(10):
        host.live(0.1)
        host.send(KNEE, Instruction.PING)  # any packet feeds it
    assert host.read(KNEE, "bus_watchdog") == 8
    host.live(0.25)
    assert host.read(KNEE, "bus_watchdog") == -1
    assert host.read(KNEE, "goal_position") == pytest.approx(host.read(KNEE, "present_position"), abs=1)
    assert host.write(KNEE, "goal_position", 2000) == Error.RANGE
    assert host.write(KNEE, "bus_watchdog", 0) == 0
    assert host.write(KNEE, "goal_position", 2500) == 0


def test_a_hot_servo_raises_the_alert_and_switches_off_until_a_reboot(host: Host) -> None:
    host.write(KNEE, "torque_enable", 1)
    joint = ROBOT.index("l_knee")
    host.body.plant.temperature[joint] = 85
    host.live(0.02)
    (answer,) = host.send(KNEE, Instruction.PING)
    assert answer.params[0] & 0x80
    assert host.read(KNEE, "hardware_error_status") == 0x04
    assert not host.body.plant.enabled[joint]
    assert host.write(KNEE, "torque_enable", 1) == Error.RESULT
    host.body.plant.temperature[joint] = 40
    host.send(KNEE, Instruction.REBOOT)
    host.live(0.3)
    assert host.write(KNEE, "torque_enable", 1) == 0


def test_a_voltage_outside_the_limits_is_reported_and_torque_stays_on(host: Host) -> None:
    host.write(KNEE, "torque_enable", 1)
    host.body.plant.set_supply(9.0)
    host.live(0.02)
    assert host.read(KNEE, "hardware_error_status") == 0x01
    assert host.read(KNEE, "present_input_voltage") == 90
    assert host.read(KNEE, "torque_enable") == 1


def test_goal_current_bounds_the_torque_in_its_mode_only(host: Host) -> None:
    joint = ROBOT.index("head_pan")
    host.write(19, "operating_mode", 5)
    host.write(19, "torque_enable", 1)
    host.write(19, "goal_current", 20)
    assert host.body.plant.torque_bound[joint] == pytest.approx(20 * 0.00269 * ROBOT.servos[joint].torque_constant)
    assert np.isinf(host.body.plant.torque_bound[ROBOT.index("head_tilt")])


def test_power_off_resets_the_servos_and_leaves_the_board(host: Host) -> None:
    host.write(1, "torque_enable", 1)
    host.send(200, Instruction.WRITE, (24).to_bytes(2, "little") + b"\x00")
    assert host.send(1, Instruction.PING) == []
    assert not host.body.plant.enabled.any()
    host.send(200, Instruction.WRITE, (24).to_bytes(2, "little") + b"\x01")
    host.live(0.3)
    assert host.read(1, "torque_enable") == 0


def test_the_imu_lies_as_the_board_does_in_the_robot(host: Host) -> None:
    host.body.gyro[:] = [0.1, -0.2, 0.3]
    (answer,) = host.send(200, Instruction.READ, sync_read(32, 12))
    raw = np.frombuffer(answer.params[1:], "<i2")
    per_rad = 16.4 * 180 / np.pi
    np.testing.assert_allclose(raw[:3], [-0.1 * per_rad, 0.2 * per_rad, 0.3 * per_rad], atol=0.5)
    assert raw[5] == 16384


def test_a_packet_with_a_wrong_crc_is_refused_and_counted(host: Host) -> None:
    packet = bytearray(encode(1, Instruction.WRITE, (65).to_bytes(2, "little") + b"\x01"))
    packet[9] ^= 1
    (answer,) = host.send_bytes(bytes(packet))
    assert answer.params[0] == Error.CRC
    assert host.bus.bad == 1 and host.read(1, "led") == 0


@settings(max_examples=150)
@given(st.lists(st.binary(max_size=40), max_size=4), st.integers(0, 255), st.integers(0, 255), st.binary(max_size=24))
def test_no_bytes_crash_the_bus(noise: list[bytes], id_: int, instruction: int, params: bytes) -> None:
    host = Host(ROBOT)
    for data in noise:
        host.send_bytes(data)
    host.bus.drop_incomplete()
    host.send(id_, instruction, params)
    host.bus.drop_incomplete()
    host.live(0.01)
    host.now += 1.0
    found = host.send(BROADCAST, Instruction.PING)
    assert all(answer.intact for answer in found)
