"""What a target waited for, and how a run is judged in which the machine did not keep its pace."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.realtime.gateway import Measured, Told, verdicts_of
from benchmarks.shared.target_waits import waits_of
from flexmotion.configs.stream import Budgets
from flexmotion.streamer.checks.machine_pace import MachinePace
from flexmotion.streamer.checks.stages import target_to_command
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import TickRow

MS = 1_000_000
REPORT: dict[str, Any] = {
    "loop": {"missed_deadlines": 0},
    "limits": {"violations_sent": 0},
    "motion": {"fell": False},
}


def run_of(*waits_ms: float) -> RunTrace:
    """A run in which each tenth tick is the first that follows a target; its plan was asked for three ticks before."""
    record = RunTrace(125.0, ("l_knee",))
    rows = np.zeros(10 * (len(waits_ms) + 3), TickRow.dtype(joints=1))
    rows["tick"] = np.arange(len(rows))
    rows["stamp_ns"] = 5000 * MS + 8 * MS * rows["tick"]
    rows["target_to_command_s"] = np.nan
    for number, wait_ms in enumerate(waits_ms):
        place = 10 * (number + 3)
        rows["target_to_command_s"][place - 1] = 1e-3 * wait_ms
        rows["asked_tick"][place - 1], rows["target"][place - 1] = place - 4, number + 1
        rows["sample_s"][place - 1], rows["retarget_s"][place - 1] = 0.012, 0.009
    record.append(rows)
    return record


def test_a_target_that_waited_for_the_change_before_it_is_told_from_a_slow_plan() -> None:
    record = run_of(230.0, 31.0)
    late, usual = waits_of(record, None)
    assert (late.target, late.total_ms) == (1, 230.0) and np.isnan(late.off_pace_ms)
    assert (late.begin_ms, late.sample_ms, late.retarget_ms, late.join_ms) == pytest.approx((198.0, 12.0, 9.0, 11.0))
    # It came after the tick before the one that its plan was asked for.
    assert (usual.begin_ms, usual.join_ms) == pytest.approx((0.0, 10.0))


@pytest.mark.parametrize(("slow_ms", "fits", "p99_holds"), [(0, True, False), (60, True, True), (600, False, True)])
def test_slow_moments_of_the_machine_are_left_out_up_to_a_tenth(slow_ms: int, fits: bool, p99_holds: bool) -> None:
    """The benchmark took every moment at which the machine itself stood still for the program's."""
    record = run_of(*[30.0] * 30, 120.0)
    last = int(record.stamp_ns[-11])
    stood = np.array([[last - (slow_ms + 20) * MS, last - 20 * MS]][: bool(slow_ms)], np.int64).reshape(-1, 2)
    pace = MachinePace(record, stood)
    told = [Told("velocity", number + 1, "accepted", 33.0) for number in range(31)]
    verdicts = verdicts_of(
        Measured(told, record, REPORT, pace), 31, target_to_command(record, Budgets(), pace), Budgets()
    )
    found = {verdict.sentence.partition(":")[0]: verdict.holds for verdict in verdicts}
    assert found["answered"] and found["target to command then, p99"] is p99_holds
    fit = next(verdict for verdict in verdicts if "kept its pace during" in verdict.sentence)
    assert fit.holds is fits and ("UNFIT" in fit.sentence) is not fits


def test_figures_without_realtime_scheduling_do_not_count() -> None:
    record = run_of(30.0)
    verdicts = verdicts_of(Measured([], record, REPORT, None), 0, target_to_command(record, Budgets(), None), Budgets())
    assert not all(verdict.holds for verdict in verdicts)
