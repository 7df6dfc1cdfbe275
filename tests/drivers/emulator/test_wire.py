from __future__ import annotations

import pytest

from drivers.emulator.wire import FRAME_S, Reply, Wire

BAUD = 1_000_000


def replies(*sizes: int, delay: float = 0.0, late: float = 0.0) -> list[tuple[Reply, bytes, float]]:
    return [(Reply(1, delay, bytes(size)), bytes(size), late) for size in sizes]


def test_bytes_take_ten_bits_each_way() -> None:
    wire = Wire()
    assert wire.send(100, BAUD, now=1.0) == pytest.approx(1.001)
    wire.answer(replies(50, delay=0.0002), BAUD, after=1.001)
    assert wire.due == pytest.approx(1.0017)
    assert wire.take(1.0016) == b"" and len(wire.take(1.00171)) == 50 and wire.due is None


def test_what_the_host_sends_at_once_waits_its_turn() -> None:
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


def test_the_host_destroys_what_it_speaks_over() -> None:
    wire = Wire()
    wire.answer(replies(100), BAUD, after=0.0)
    wire.send(10, BAUD, now=0.0005)
    assert wire.collisions == 1 and wire.due is None


def test_a_late_reply_is_held_back_and_no_collision() -> None:
    wire = Wire()
    wire.answer(replies(10, late=0.02), BAUD, after=0.0)
    wire.send(10, BAUD, now=0.01)
    assert wire.collisions == 0 and wire.due == pytest.approx(0.0201)


def test_without_timing_everything_is_at_once() -> None:
    wire = Wire(timed=False)
    assert wire.send(100, BAUD, now=1.0) == 1.0
    wire.answer(replies(50, delay=0.5), BAUD, after=1.0)
    assert wire.due == 1.0
