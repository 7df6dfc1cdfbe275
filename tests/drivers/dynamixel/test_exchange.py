from __future__ import annotations

import struct

import pytest

from flexmotion.drivers.dynamixel.exchange import ReadMany
from flexmotion.drivers.dynamixel.layout import Span
from flexmotion.drivers.dynamixel.packet import encode_fast_status, encode_status

IDS = (1, 2)


def row(position: int, velocity: int = 0, current: int = 0) -> bytes:
    """Data of a servo's answer."""
    return struct.pack("<hhhBBBBB", position, velocity, current, 120, 26, 0, 77, 1)


@pytest.fixture
def fast() -> ReadMany:
    """A fast read of two servos, just sent."""
    made = ReadMany(IDS, Span(224, 11), fast=True, where="bus")
    made.begin()
    return made


def test_a_late_answer_to_a_sync_read_is_not_taken_for_a_fast_one(fast: ReadMany) -> None:
    """Regression: it was taken, shifted by one byte, for the answer of the servo whose id is its position."""
    # FF FF FD in speed and current: a byte is stuffed.
    late = encode_status(2, 0, row(0x0801, velocity=-1, current=-3))
    assert not fast.take(late)
    fast.end()
    assert fast.answers == {} and fast.whole is None


def test_the_fast_reply_after_it_is_taken(fast: ReadMany) -> None:
    rows = [row(2048), row(1000, velocity=7)]
    late = encode_status(2, 0, row(0x0801, velocity=-1, current=-3))
    assert fast.take(late + encode_fast_status([(0, id_, data) for id_, data in zip(IDS, rows, strict=True)]))
    fast.end()
    assert fast.whole is not None


def test_the_complete_parts_of_a_truncated_fast_reply_are_taken(fast: ReadMany) -> None:
    reply = encode_fast_status([(0, id_, row(2000 + id_)) for id_ in IDS])
    fast.take(reply[:-3])
    fast.end()
    ((id_, (error, data)),) = fast.answers.items()
    assert (id_, error) == (1, 0) and data == row(2001)
