"""Figures of a run that is longer than what is kept of it."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_totals import Times
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.report.metrics import RobotFigures
from flexmotion.streamer.report.report import RunInfo, build_report

RATE, KEPT_S, TICKS = 125.0, 80.0, 60_000
JOINTS = ("l_knee", "r_knee")
INFO = RunInfo(robot="op3", driver="sim", source="live", clock="real")
FIGURES = RobotFigures(
    np.array([0, 1]), 0.25, 30.0, 0.4, np.full(2, 2.5), np.full(2, 4.0), np.full(2, 5.0), arm_length=0.2
)


def long_run(kept_s: float) -> RunTrace:
    """Eight minutes: a plan a second, hard work and slow plans in the first, standing in the others."""
    rng = np.random.default_rng(1)
    rows = blank(TickRow.dtype(joints=2), TICKS)
    ticks = np.arange(TICKS)
    early = ticks < 60 * RATE
    rows["tick"], rows["stamp_ns"] = ticks, ticks
    rows["state"] = np.where(early, State.STREAMING, State.HOLD)
    rows["plan"] = 1 + ticks // 125
    rows["sample_s"] = 0.01 + 1e-5 * rows["plan"]
    rows["retarget_s"] = np.where(early, 0.04, 0.02)
    rows["work_s"], rows["lateness_s"] = rng.exponential(3e-4, TICKS), rng.exponential(5e-5, TICKS)
    rows["target_to_command_s"][early & (ticks % 500 == 0)] = 0.03
    rows["q"] = rows["q_ref"] = rows["q_cmd"] = 0.1
    rows["qd"] = np.where(early, 4.0, 0.1)[:, None]
    rows["true_torque"] = np.where(early, 2.0, 0.5)[:, None]
    rows["true_saturated"] = early[:, None]
    rows["true_base"] = (0, 0, 0.25, 1, 0, 0, 0)
    record = RunTrace(RATE, JOINTS, kept_s=kept_s)
    for begin in range(0, TICKS, 777):
        record.append(rows[begin : begin + 777])
    return record


def test_a_long_run_has_the_figures_of_all_of_it() -> None:
    """After ten minutes of targets the report said: 1 plan, and the time of this one as every percentile."""
    cut, whole = long_run(KEPT_S), long_run(1e4)
    assert cut.forgotten > TICKS / 2 and whole.forgotten == 0
    found, true = (build_report(record, INFO, FIGURES) for record in (cut, whole))
    assert found.planner.plans == true.planner.plans == TICKS // 125
    for section, names in (
        ("planner", ("sample_ms", "retarget_ms", "target_to_command_ms")),
        ("loop", ("work_us", "wake_lateness_us")),
    ):
        for name in names:
            value, expected = (getattr(getattr(report, section), name) for report in (found, true))
            assert value.max == expected.max, name
            for percentile in ("p50", "p95", "p99", "p99_9"):
                assert getattr(value, percentile) == pytest.approx(getattr(expected, percentile), rel=0.011), name
    assert found.limits.joints == true.limits.joints
    assert found.limits.joints["l_knee"].peak_torque_nm == 2.0
    assert found.ok and true.ok  # a robot that has stood for the last minutes has moved before
    assert (true.motion.period_begin_s, true.motion.period_end_s) == (0.0, TICKS / RATE)
    begin, end = found.motion.period_begin_s, found.motion.period_end_s
    assert end == TICKS / RATE and begin == pytest.approx(cut.forgotten / RATE, rel=1e-5)
    assert cut.time_s[0] == begin


@pytest.mark.parametrize("how", ["tilt", "damped"])
def test_a_fall_is_not_forgotten(how: str) -> None:
    record = RunTrace(RATE, JOINTS, kept_s=KEPT_S)
    rows = blank(TickRow.dtype(joints=2), TICKS)
    rows["tick"], rows["state"] = np.arange(TICKS), State.HOLD
    if how == "tilt":
        rows["true_base"] = (0, 0, 0.25, 1, 0, 0, 0)
        rows["true_base"][1000:2000, 3:] = np.sqrt(0.5), np.sqrt(0.5), 0, 0
    else:
        rows["state"][1000:2000] = State.DAMPED
    for begin in range(0, TICKS, 777):
        record.append(rows[begin : begin + 777])
    motion = build_report(record, INFO, FIGURES).motion
    assert motion.fell and motion.time_to_fall_s == 8.0


@pytest.mark.parametrize("cut", [990, 1000, 1500])
@pytest.mark.parametrize(("before", "fell"), [(State.PARK, False), (State.HOLD, True)])
def test_a_parked_robot_without_torque_has_not_fallen_wherever_rows_are_cut(
    before: State, fell: bool, cut: int
) -> None:
    record = RunTrace(RATE, JOINTS, kept_s=KEPT_S)
    rows = blank(TickRow.dtype(joints=2), TICKS)
    rows["tick"], rows["state"] = np.arange(TICKS), State.HOLD
    rows["true_base"] = (0, 0, 0.25, 1, 0, 0, 0)
    rows["state"][950:1000], rows["state"][1000:2000] = before, State.FAULT
    rows["true_base"][1100:2000, 3:] = np.sqrt(0.5), np.sqrt(0.5), 0, 0
    for part in (rows[:cut], rows[cut : cut + 300], rows[cut + 300 :]):
        record.append(part)
    assert build_report(record, INFO, FIGURES).motion.fell is fell


def test_times_need_no_more_memory_the_more_of_them_there_are() -> None:
    times = Times()
    size = times._counts.nbytes
    for _ in range(50):
        times.add(np.random.default_rng(0).lognormal(-7.0, 2.0, 1000))
    times.add(np.array([np.nan, -1e-3, 0.0]))
    assert times.count == 50_002 and times._counts.nbytes == size
    assert np.isnan(Times().percentile(50.0))
