"""Every rule of `rules.yaml`: a packet that it forbids is refused, with the error of the manual, and counted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.packet import to_sign_magnitude
from flexmotion.drivers.dynamixel.packet import BROADCAST, Decoder, Error, Instruction, encode
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.build import make_bus
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.feetech_bus import EmulatedFeetechBus, StsServo
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.lx16a_bus import EmulatedLx16aBus
from flexmotion.drivers.emulator.rules import rules_of
from flexmotion.drivers.emulator.servo import CURRENT_POSITION, Joints
from flexmotion.drivers.feetech.registers import FORMAT as STS
from flexmotion.drivers.feetech.registers import Instruction as StsInstruction
from flexmotion.drivers.lx16a.protocol import FORMAT as LX
from flexmotion.drivers.lx16a.protocol import Command as LxCommand

from ..bus.robots import op3_with
from .conftest import Host

KNEE = 14


def _error(host: Host, instruction: int, params: bytes = b"") -> int | None:
    """Error of the knee's answer; None: it does not answer."""
    answers = host.send(KNEE, instruction, params)
    return answers[0].params[0] & 0x7F if answers else None


def _broken(host: Host) -> int:
    whole = bytearray(encode(KNEE, Instruction.PING))
    whole[-1] ^= 1
    (answer,) = host.send_bytes(bytes(whole))
    return answer.params[0] & 0x7F


def _locked(host: Host) -> int:
    host.write(KNEE, "torque_enable", 1)
    return host.write(KNEE, "return_delay_time", 20)


def _trip(host: Host) -> None:
    host.write(KNEE, "bus_watchdog", 5)
    host.servo(KNEE).trip()


def _tripped(host: Host) -> int:
    _trip(host)
    refused = {host.write(KNEE, name, 0) for name in ("goal_pwm", "goal_current", "goal_velocity")}
    assert refused == {Error.RANGE} and host.read(KNEE, "bus_watchdog") == -1
    return host.write(KNEE, "goal_position", 2048)


def _cleared(host: Host) -> int:
    _trip(host)
    refused = host.write(KNEE, "bus_watchdog", 8)
    assert host.write(KNEE, "bus_watchdog", 0) == 0 and host.write(KNEE, "goal_position", 2048) == 0
    return refused


def _shutdown(host: Host) -> int:
    host.servo(KNEE).fail(0x20)
    return host.write(KNEE, "torque_enable", 1)


def _group(host: Host) -> int | None:
    host.servo(KNEE).put("secondary_id", 77)
    answers = host.send(77, Instruction.WRITE, bytes([9, 0, 33]))
    assert answers == [] and host.read(KNEE, "return_delay_time") == 0
    return None


def _broadcast_reset(host: Host) -> int | None:
    host.servo(KNEE).put("moving_threshold", 99)
    assert host.send(BROADCAST, Instruction.FACTORY_RESET, b"\xff") == []
    assert host.read(KNEE, "moving_threshold") == 99
    return None


def _reset(host: Host) -> int | None:
    return _error(host, Instruction.FACTORY_RESET, b"\x07")


BREACHES: dict[str, Callable[[Host], int | None]] = {
    "undefined_instruction": lambda host: _error(host, 0x42),
    "action_without_reg_write": lambda host: _error(host, Instruction.ACTION),
    "crc_error": _broken,
    "out_of_range": lambda host: host.write(KNEE, "return_delay_time", 255),
    "written_in_part": lambda host: _error(host, Instruction.WRITE, bytes([116, 0, 1, 0])),
    "over_limit": lambda host: host.write(KNEE, "goal_velocity", 201),
    "read_only": lambda host: host.write(KNEE, "present_position", 0),
    "undefined_address": lambda host: _error(host, Instruction.READ, bytes([0, 9, 4, 0])),
    "eeprom_locked": _locked,
    "tripped": _tripped,
    "cleared_by_zero": _cleared,
    "in_shutdown": _shutdown,
    "mode_not_emulated": lambda host: host.write(KNEE, "operating_mode", 1),
    "eeprom_by_secondary_id": _group,
    "broadcast_reset": _broadcast_reset,
    "bad_reset": _reset,
    "clear_in_motion": lambda host: _error(host, Instruction.CLEAR, b"\x01\x00\x00\x00\x00"),
}


def test_every_rule_is_here_and_has_a_source() -> None:
    assert set(BREACHES) == set(rules_of("dynamixel2"))
    for protocol in ("dynamixel2", "feetech", "lx16a"):
        assert all(rule.source and rule.text for rule in rules_of(protocol).values())


@pytest.mark.parametrize("rule", BREACHES)
def test_a_breach_is_refused_with_the_error_of_the_manual(host: Host, rule: str) -> None:
    expected = rules_of("dynamixel2")[rule].error
    assert BREACHES[rule](host) == (None if expected is None else Error[expected])
    assert host.servo(KNEE).refusals[rule] >= 1


def test_a_change_of_the_mode_resets_gains_profile_and_goals(host: Host) -> None:
    """Regression: the driver set the gains first and then the mode: on a servo the gains were lost."""
    wanted = {"position_p_gain": 400, "position_d_gain": 30, "profile_velocity": 50, "goal_pwm": 300}
    wanted |= {"pwm_limit": 700, "current_limit": 900, "goal_current": 100}
    for name, value in wanted.items():
        assert host.write(KNEE, name, value) == 0
    assert host.write(KNEE, "operating_mode", CURRENT_POSITION) == 0
    now = {name: host.read(KNEE, name) for name in wanted}
    assert now == wanted | {"position_p_gain": 800, "position_d_gain": 0, "profile_velocity": 0} | {
        "goal_pwm": 700,
        "goal_current": 900,
    }
    host.write(KNEE, "position_p_gain", 400)
    assert host.write(KNEE, "operating_mode", CURRENT_POSITION) == 0  # no change
    assert host.read(KNEE, "position_p_gain") == 400


def test_position_limits_count_in_position_mode_only(host: Host) -> None:
    host.write(KNEE, "max_position_limit", 3000)
    assert host.write(KNEE, "goal_position", 3001) == Error.LIMIT
    host.write(KNEE, "operating_mode", CURRENT_POSITION)
    assert host.write(KNEE, "goal_position", 3001) == 0
    assert host.write(KNEE, "goal_position", 1_048_576) == Error.RANGE


def test_at_power_up_goals_are_at_their_limits(host: Host) -> None:
    host.write(KNEE, "pwm_limit", 500)
    host.write(KNEE, "current_limit", 400)
    host.send(KNEE, Instruction.REBOOT)
    host.live(0.3)
    assert (host.read(KNEE, "goal_pwm"), host.read(KNEE, "goal_current")) == (500, 400)


def test_a_homing_offset_is_added_to_the_position_and_ignored_beyond_a_quarter_turn(host: Host) -> None:
    true = host.read(KNEE, "present_position")
    host.write(KNEE, "homing_offset", 300)
    assert host.read(KNEE, "present_position") == true + 300
    host.write(KNEE, "homing_offset", 1025)
    assert host.read(KNEE, "present_position") == true
    host.write(KNEE, "operating_mode", CURRENT_POSITION)
    assert host.read(KNEE, "present_position") == true + 1025


def test_startup_configuration_switches_torque_on(host: Host) -> None:
    host.write(KNEE, "startup_configuration", 1)
    host.send(KNEE, Instruction.REBOOT)
    host.live(0.3)
    assert host.read(KNEE, "torque_enable") == 1


def test_a_write_to_a_secondary_id_moves_its_group_and_nobody_answers(host: Host) -> None:
    """The knee obeys the goals of id 3, the other knee those of 77, which no servo has."""
    host.servo(KNEE).put("secondary_id", 3)
    host.servo(13).put("secondary_id", 77)
    (answer,) = host.send(3, Instruction.WRITE, bytes([116, 0]) + (2100).to_bytes(4, "little"))
    assert answer.id == 3 and answer.params[0] == 0
    assert host.read(KNEE, "goal_position") == 2100 == host.read(3, "goal_position")
    both = b"".join(bytes([id_]) + (2200).to_bytes(4, "little") for id_ in (3, 77))
    host.send(BROADCAST, Instruction.SYNC_WRITE, bytes([116, 0, 4, 0]) + both)
    assert [host.read(id_, "goal_position") for id_ in (3, KNEE, 13)] == [2200] * 3
    assert host.send(77, Instruction.READ, bytes([132, 0, 4, 0])) == []
    host.servo(13).put("secondary_id", 13)  # its own id has priority: it acts once
    assert host.write(13, "goal_position", 2000) == 0


def test_answers_of_two_servos_with_one_id_collide_in_bits(host: Host) -> None:
    """Equal answers pass unnoticed; different ones have the low bits of both, and a wrong CRC."""
    alone = host.raw(encode(KNEE, Instruction.PING))
    host.servo(13).put("id", KNEE)
    assert host.raw(encode(KNEE, Instruction.PING)) == alone
    twins = [servo for servo in host.bus.servos if servo.id == KNEE]
    read = encode(KNEE, Instruction.READ, bytes([132, 0, 4, 0]))
    twins[1].joints.body.position[twins[1].index] += 1.0
    (mixed,) = host.raw(read)
    before = host.bus.received
    assert host.send_bytes(read)[0].intact is False
    assert host.bus.received == before + 1
    each = []
    for twin in twins:
        other = next(servo for servo in twins if servo is not twin)
        other.off_until = 1e9
        each += host.raw(read)
        other.off_until = 0.0
    assert mixed == bytes(a & b for a, b in zip(*each, strict=True)) and mixed not in each
    # Both obey a write, and their equal acknowledgements look like one.
    assert host.write(KNEE, "goal_position", 2222) == 0
    assert [twin.get("goal_position") for twin in twins] == [2222, 2222]
    (reply,) = host.raw(encode(BROADCAST, Instruction.SYNC_READ, bytes([132, 0, 4, 0, KNEE])))
    assert reply == mixed
    assert len(host.send(BROADCAST, Instruction.PING)) == 20  # 21 devices, two with one id


def test_a_registered_write_is_shown_until_it_is_done(host: Host) -> None:
    host.send(KNEE, Instruction.REG_WRITE, bytes([116, 0]) + (2100).to_bytes(4, "little"))
    assert host.read(KNEE, "registered_instruction") == 1
    assert _error(host, Instruction.ACTION) == 0
    assert host.read(KNEE, "registered_instruction") == 0 and host.read(KNEE, "goal_position") == 2100


def test_an_adapter_without_a_direction_switch_returns_what_the_host_sends(op3: Robot) -> None:
    world = Loopback(BenchBody(op3), faults=[Fault.parse("echo")])
    port = world.open_port("main", op3.config.buses["main"].baud)
    world.advance(0.02)
    ping = encode(KNEE, Instruction.PING)
    port.send(ping)
    received = bytearray()
    for _ in range(5):
        received += port.wait(0.01)
    assert received.startswith(ping) and len(list(Decoder().feed(bytes(received[len(ping) :])))) == 1


@pytest.mark.parametrize("protocol", ["feetech", "lx16a"])
def test_answers_of_two_feetech_or_lewansoul_servos_with_one_id_collide(tmp_path: Path, protocol: str) -> None:
    servo, baud = {"feetech": ("STS3215-12V", 1_000_000), "lx16a": ("LX-16A", 115_200)}[protocol]
    robot = op3_with(tmp_path, servo=servo, baud=baud)
    bus = make_bus(Joints(BenchBody(robot)), "main")
    assert isinstance(bus, EmulatedFeetechBus | EmulatedLx16aBus)
    read = {
        "feetech": STS.encode(14, StsInstruction.READ, bytes([56, 2])),
        "lx16a": LX.encode(14, LxCommand.READ_POSITION),
    }[protocol]

    def asked() -> list[bytes]:
        return [reply.data for _, replies in bus.receive(read, baud, 0.0) for reply in replies]

    first, second = (next(servo for servo in bus.servos if servo.address == id_) for id_ in (13, 14))
    alone = asked()
    if isinstance(first, StsServo):
        first.put("id", 14)
    else:
        first.id = 14
    bus.joints.body.position[first.index] += 0.5
    (mixed,) = asked()
    second.off_until = 1.0
    other = asked()
    assert mixed == bytes(a & b for a, b in zip(*alone, *other, strict=True)) and mixed not in (*alone, *other)


def test_a_feetech_offset_is_taken_from_the_position_and_locked_eeprom_refuses(tmp_path: Path) -> None:
    robot = op3_with(tmp_path, servo="STS3215-12V", baud=1_000_000)
    bus = make_bus(Joints(BenchBody(robot)), "main")
    assert isinstance(bus, EmulatedFeetechBus)
    knee = next(servo for servo in bus.servos if servo.address == KNEE)
    knee.joints.refresh()
    knee.refresh()
    true = knee.get("present_position")
    offset = to_sign_magnitude(-100, 11).to_bytes(2, "little")
    knee.write(31, offset)
    assert knee.refusals["eeprom_locked"] == 1 and knee.get("homing_offset") == 0
    knee.write(55, b"\x00")
    knee.write(31, offset)
    knee.refresh()
    assert knee.get("present_position") == true + 100
    knee.write(42, (true + 100).to_bytes(2, "little"))
    angle = robot.stand_pose[robot.index("l_knee")]
    assert knee.joints.goal[knee.index] == pytest.approx(angle, abs=0.002)
    knee.write(56, b"\x00\x00")
    knee.write(42, b"\x00")
    assert knee.refusals["read_only"] == 1 and knee.refusals["written_in_part"] == 1
