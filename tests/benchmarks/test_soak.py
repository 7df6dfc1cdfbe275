"""Figures of a soak: memory by process, the same targets with and without transports, falls with what led to them."""

from __future__ import annotations

import itertools
import mmap
import os
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.live.figures import SegmentFigures
from benchmarks.live.segment import Falls
from benchmarks.live.senders import merged, schedules
from benchmarks.robot.steering import way_along
from benchmarks.shared.memory import growth, of_family, of_process


def test_growth_is_that_of_the_whole_time_and_not_of_a_single_step() -> None:
    """A line by least squares took one late step of 2 MB, or one high sample, for growth without an end."""
    time_s = np.arange(0.0, 1200.0, 5.0)
    flat = [(float(t), 300.0, 200.0 + (40.0 if t < 60 else 0.0) + (50.0 if t == 1000 else 0.0)) for t in time_s]
    found = growth(flat)
    assert found is not None and found.judged
    assert found.private_mb == pytest.approx(0.0, abs=1e-9)  # neither the start nor one sample
    step = [(t, rss, private + (2.0 if t > 1100 else 0.0)) for t, rss, private in flat]
    assert growth(step).private_mb < 0.5  # type: ignore[union-attr]
    leak = [(t, rss + 0.01 * t, private + 0.005 * t) for t, rss, private in flat]
    found = growth(leak)
    assert found is not None
    assert (found.resident_mb, found.private_mb) == pytest.approx((6.0, 3.0), rel=0.02)
    assert found.least_mb <= found.private_mb <= found.most_mb


def test_a_short_soak_says_nothing_about_ten_minutes() -> None:
    short = [(float(t), 300.0, 200.0 + t) for t in range(0, 300, 5)]
    found = growth(short)
    assert found is not None and not found.judged
    assert growth(short[:25]) is None


def test_memory_is_that_of_each_process_by_name() -> None:
    own = of_process(os.getpid())
    assert own[0] > own[1] > 10.0
    # An array may take what others have freed.
    with mmap.mmap(-1, 20_000_000, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as block:
        for _ in range(20):
            block.write(bytes(1_000_000))
        after = of_process(os.getpid())
        assert after[1] - own[1] == pytest.approx(20.0, abs=5.0)
        family = of_family(os.getpid())
    assert sum(private for _, private in family.values()) >= after[1] - 5.0


def test_the_targets_without_transports_are_those_with_them() -> None:
    """Without transports other targets were drawn, so that falls could not be compared."""
    alone = list(itertools.islice(merged(3.0, seed=4), 30))
    each = [due for own in schedules(3.0, seed=4).values() for due in itertools.islice(own, 30)]
    assert all(due in each for due in alone)
    assert [due_s for due_s, _ in alone] == sorted(due_s for due_s, _ in each)[:30]


def test_a_fall_is_counted_once_and_told_with_what_was_asked() -> None:
    found = SegmentFigures(clock="lockstep", seed=0, targets=True)
    asked = [
        (1.0, {"type": "text", "text": "bow"}, "accepted"),
        (14.0, {"type": "velocity", "velocity": [0.3, 0, 0]}, "slowed"),
    ]
    falls = Falls(found, lambda: asked)
    states = ("STREAMING", "DAMPED", "FAULT", "OFF", "READY", "HOLD")
    again = [falls.see(state, 15.0 + number) for number, state in enumerate(states)]
    assert again == [False, False, True, True, False, False]
    assert len(found.falls) == 1 and found.falls[0].at_s == 16.0
    assert found.falls[0].asked == ["-2.00 s [0.3, 0, 0]: slowed"]


def test_the_way_of_a_robot_is_measured_along_what_was_asked() -> None:
    """Of a robot that looks along y and goes to its left."""
    base = np.zeros((5, 7))
    base[:, 0] = -0.1 * np.arange(5)
    base[:, 3] = base[:, 6] = np.sqrt(0.5)
    record = SimpleNamespace(true_base=base)
    way, speed = way_along(record, (0.0, 0.2, 0.0), slice(None))  # type: ignore[arg-type]
    np.testing.assert_allclose(way, 0.1 * np.arange(5), atol=1e-12)
    assert speed == 0.2
    way, _ = way_along(record, (0.3, 0.0, 0.0), slice(None))  # type: ignore[arg-type]
    np.testing.assert_allclose(way, 0.0, atol=1e-12)
