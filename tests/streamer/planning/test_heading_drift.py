from __future__ import annotations

import math

import numpy as np
import pytest

from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.planning.heading_drift import HeadingDrift

RATE = 125


def row(tick: int, turned: float, planned: float = 0.0, plan: int = 1) -> TickRow:
    """A row of the loop: turn of the torso by odometry, and its planned heading [rad]."""
    made = TickRow(blank(TickRow.dtype(joints=2)))
    made.tick[...], made.plan[...], made.odometry[2] = tick, plan, turned
    made.base_ref[3:] = [math.cos(0.5 * planned), 0.0, 0.0, math.sin(0.5 * planned)]
    return made


def test_without_a_plan_or_a_measurement_it_is_not_known() -> None:
    drift = HeadingDrift(RATE)
    assert math.isnan(drift.value)
    drift.update(row(1, 0.3, plan=0))
    assert math.isnan(drift.value)
    drift.update(row(2, math.nan))
    assert math.isnan(drift.value)
    drift.update(row(3, 0.3))
    assert drift.value == pytest.approx(0.3)
    drift.update(row(4, 0.3, plan=0))
    assert math.isnan(drift.value)


def test_a_planned_turn_is_no_drift() -> None:
    drift = HeadingDrift(RATE)
    for tick, turned in enumerate(np.linspace(0.0, 2.5 * math.pi, 400)):
        drift.update(row(tick, turned, math.remainder(turned, math.tau)))
        assert drift.value == pytest.approx(0.0, abs=1e-9)


def test_it_is_smooth_and_comes_to_the_turn_also_over_rows_that_are_missing() -> None:
    every, some = HeadingDrift(RATE), HeadingDrift(RATE)
    for tick in range(251):
        every.update(row(tick, 0.1 if tick else 0.0))
        if tick % 25 == 0:
            some.update(row(tick, 0.1 if tick else 0.0))
        if tick == 63:
            assert every.value == pytest.approx(0.1 * (1.0 - math.exp(-1.0)), rel=0.03)
    assert every.value == pytest.approx(some.value, abs=1e-9)
    assert every.value == pytest.approx(0.1, abs=0.003)


def test_it_follows_over_half_a_turn() -> None:
    drift = HeadingDrift(RATE)
    for tick, turned in enumerate(np.linspace(3.0, 3.4, 500)):
        drift.update(row(tick, float(turned)))
    assert drift.value == pytest.approx(3.4, abs=0.06)
