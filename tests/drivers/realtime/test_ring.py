"""Rows in shared memory: consistent, lost rows are counted, no memory is left behind."""

from __future__ import annotations

import os
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.drivers.realtime.ring import Ring, shared_array, touch

pytestmark = pytest.mark.wall_clock

ROW = np.dtype([("number", "i8"), ("values", "f8", 60)])


def row(number: int) -> np.ndarray:
    made = np.zeros((), ROW)
    made["number"], made["values"] = number, number
    return made


def test_an_empty_ring_has_no_newest_row() -> None:
    ring = Ring(ROW, 4)
    assert ring.latest() is None and len(ring.reader().read()) == 0


@given(st.integers(2, 9), st.lists(st.tuples(st.integers(0, 12), st.one_of(st.none(), st.integers(1, 5))), max_size=20))
def test_a_reader_sees_every_row_once_in_order_or_counts_it_as_lost(
    capacity: int, turns: list[tuple[int, int | None]]
) -> None:
    ring = Ring(ROW, capacity)
    reader, written, seen = ring.reader(), 0, []
    for count, most in turns:
        for _ in range(count):
            ring.publish(row(written))
            written += 1
        rows = reader.read(most)
        assert most is None or len(rows) <= most
        seen.extend(int(n) for n in rows["number"])
    seen.extend(int(n) for n in reader.read()["number"])
    assert seen == sorted(set(seen))
    assert len(seen) + reader.lost == written
    if written:
        newest = ring.latest()
        assert newest is not None and newest["number"] == written - 1


def test_a_reader_of_new_rows_skips_those_published_before() -> None:
    ring = Ring(ROW, 4)
    for number in range(3):
        ring.publish(row(number))
    reader = ring.reader(new_only=True)
    assert len(reader.read()) == 0
    ring.publish(row(3))
    assert reader.read()["number"].tolist() == [3] and reader.lost == 0


def _write(ring: Ring, count: int) -> None:
    for number in range(count):
        ring.publish(row(number))


def test_rows_are_consistent_while_another_process_writes() -> None:
    """The writer fills a small ring thousands of times while it is read."""
    ring, count = Ring(ROW, 8), 60_000
    writer = get_context("fork").Process(target=_write, args=(ring, count))
    writer.start()
    reader, taken = ring.reader(), 0
    while writer.is_alive() or reader.ring.count > taken + reader.lost:
        rows = reader.read()
        taken += len(rows)
        assert (rows["values"] == rows["number"][:, None]).all()
        assert (np.diff(rows["number"]) == 1).all()
    writer.join()
    assert taken + reader.lost == count


def test_shared_arrays_have_no_name() -> None:
    before = set(os.listdir("/dev/shm")) if Path("/dev/shm").is_dir() else set()
    array = shared_array((3, 2), np.float64)
    array[1] = 7.0
    touch(array)
    assert set(os.listdir("/dev/shm")) <= before
    assert array.shape == (3, 2) and (array[1] == 7.0).all() and (array[0] == 0.0).all()


@pytest.mark.parametrize("shape", [0, (0, 4)])
def test_an_empty_array_is_valid(shape: int | tuple[int, ...]) -> None:
    array = shared_array(shape, np.float64)
    touch(array)
    assert array.size == 0
