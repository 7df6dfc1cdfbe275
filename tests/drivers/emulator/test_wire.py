from __future__ import annotations

import pytest

from flexmotion.configs.robot import Robot
from flexmotion.drivers.dynamixel.packet import BROADCAST, Instruction, encode
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.dynamixel_bus import EmulatedDynamixelBus
from flexmotion.drivers.emulator.line import BusLine
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.wire import FRAME_S, Reply, Wire

BAUD = 1_000_000


def replies(*sizes: int, delay: float = 0.0, late: float = 0.0) -> list[tuple[Reply, bytes, float]]:
    return [(Reply(1, delay, bytes(size)), bytes(size), late) for size in sizes]


def test_bytes_take_ten_bits_in_each_direction() -> None:
    wire = Wire()
    assert wire.send(100, BAUD, now=1.0) == pytest.approx(1.001)
    wire.answer(replies(50, delay=0.0002), BAUD, after=1.001)
    assert wire.due == pytest.approx(1.0017)
    assert wire.take(1.0016) == b"" and len(wire.take(1.00171)) == 50 and wire.due is None


def test_packets_sent_at_once_are_sent_in_turn() -> None:
    wire = Wire()
    wire.send(100, BAUD, now=1.0)
    assert wire.send(100, BAUD, now=1.0) == pytest.approx(1.002)


def test_replies_come_in_frames_and_the_last_on_time() -> None:
    wire = Wire()
    wire.answer(replies(*[20] * 10), BAUD, after=0.0)
    due = []
    while wire.due is not None:
        due.append(wire.due)
        wire.take(due[-1])
    assert due[-1] == pytest.approx(0.002)
    assert len(due) == pytest.approx(0.002 / FRAME_S, abs=1)


def test_a_request_during_a_reply_destroys_the_reply() -> None:
    wire = Wire()
    wire.answer(replies(100), BAUD, after=0.0)
    wire.send(10, BAUD, now=0.0005)
    assert wire.collisions == 1 and wire.due is None


def test_a_host_that_still_sends_when_a_reply_is_due_destroys_it() -> None:
    wire = Wire()
    end = wire.send(10, BAUD, now=0.0)
    wire.send(10, BAUD, now=0.00005)
    wire.answer(replies(10), BAUD, after=end)
    assert wire.collisions == 1 and wire.due is None


def test_goals_act_after_their_last_byte(op3: Robot) -> None:
    """Regression: they acted when they were sent, and their computation delayed the next packet on the wire."""
    world = Loopback(BenchBody(op3))
    line = world.emulator.lines[0]
    assert isinstance(line, BusLine) and isinstance(line.bus, EmulatedDynamixelBus)
    servo = line.bus.servos[3]
    led = encode(BROADCAST, Instruction.SYNC_WRITE, bytes([65, 0, 1, 0, servo.id, 1]))
    world.open_port(line.name, servo.baud).send(led)
    takes = 10 * len(led) / servo.baud
    world.advance(takes - 1e-6)
    assert servo.get("led") == 0
    world.advance(2e-6)
    assert servo.get("led") == 1


def test_a_late_reply_is_no_collision() -> None:
    wire = Wire()
    wire.answer(replies(10, late=0.02), BAUD, after=0.0)
    wire.send(10, BAUD, now=0.01)
    assert wire.collisions == 0 and wire.due == pytest.approx(0.0201)


def test_without_timing_bytes_take_no_time() -> None:
    wire = Wire(timed=False)
    assert wire.send(100, BAUD, now=1.0) == 1.0
    wire.answer(replies(50, delay=0.5), BAUD, after=1.0)
    assert wire.due == 1.0
