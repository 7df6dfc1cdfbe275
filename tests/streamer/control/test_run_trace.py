"""Memory of a record is bounded, and telemetry loses nothing that is collected in time."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.streamer.control.run_trace import Collector, RunTrace
from flexmotion.streamer.control.telemetry import KEPT_S, Event, Telemetry
from flexmotion.streamer.control.tick_row import TickRow, blank

JOINTS = ("a", "b")


def rows(first: int, count: int) -> np.ndarray:
    made = blank(TickRow.dtype(joints=2), count)
    made["tick"] = np.arange(first, first + count)
    return made


def test_a_blank_row_has_no_values() -> None:
    row = blank(TickRow.dtype(joints=2))
    assert np.isnan(row["q_cmd"]).all() and np.isnan(row["source_s"]) and row["plan"] == 0


def test_a_row_has_no_padding_so_that_its_bytes_are_a_message() -> None:
    dtype = TickRow.dtype(joints=3)
    sizes = [dtype[name].base.itemsize for name in dtype.names or ()]
    assert sizes == sorted(sizes, reverse=True)
    assert dtype.itemsize == sum(dtype[name].itemsize for name in dtype.names or ())  # no holes


def test_columns_are_attributes_and_unknown_ones_are_named() -> None:
    record = RunTrace(125.0, JOINTS)
    record.append(rows(0, 5))
    record.q[:] = 0.5
    assert record.rows["q"].sum() == 5.0 and record.used == 5
    with pytest.raises(AttributeError, match="no column 'speed'"):
        _ = record.speed


def test_it_grows_and_then_drops_the_oldest_rows() -> None:
    """A robot that stands for a day must not fill the memory."""
    record = RunTrace(125.0, JOINTS, kept_s=80.0)
    written = 0
    for count in [1, 4095, 700] * 20:
        record.append(rows(written, count))
        written += count
    assert record.used + record.forgotten == written
    assert 40.0 * 125 <= record.used <= 80.0 * 125  # the report's page said that all of it is kept
    np.testing.assert_array_equal(record.tick, np.arange(written - record.used, written))


def test_counts_are_those_of_the_newest_row() -> None:
    record = RunTrace(125.0, JOINTS)
    assert (record.missed_deadlines, record.violations_sent, record.plans) == (0, 0, [])
    record.append(rows(0, 3))
    record.rows["missed_deadlines"] = [0, 1, 4]
    record.rows["plan"] = [0, 1, 2]
    record.rows["asked_tick"], record.rows["plan_start"] = 7, 9
    assert record.missed_deadlines == 4
    assert [(plan.asked_tick, plan.join_tick) for plan in record.plans] == [(7, 9), (7, 9)]


def test_rows_and_events_are_collected_and_counts_continue() -> None:
    telemetry = Telemetry(2, 125.0)
    collector = Collector(telemetry, RunTrace(125.0, JOINTS))
    row = telemetry.row
    row.tick[...], row.underruns[...], row.q[...] = 1, 2, 0.25
    telemetry.commit()
    telemetry.emit(1, "warning", "ä" * 400)
    row.tick[...] = 2
    telemetry.commit()
    (event,) = collector.collect()
    assert event == Event(1, "warning", "ä" * 244)
    record = collector.record
    assert record.underruns == 2 and list(record.events) == [event]
    assert (record.q[0] == 0.25).all() and np.isnan(record.q[1]).all()


def test_a_late_collector_counts_the_rows_that_it_missed() -> None:
    telemetry = Telemetry(2, 125.0)
    collector = Collector(telemetry, RunTrace(125.0, JOINTS))
    count = int(KEPT_S * 125.0) + 500
    for tick in range(count):
        telemetry.row.tick[...] = tick
        telemetry.commit()
    collector.collect()
    record = collector.record
    assert record.forgotten >= 500 and record.used + record.forgotten == count
    assert record.tick[-1] == count - 1
