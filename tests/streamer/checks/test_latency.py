"""`check latency`: what it measures, how it judges, how it reads."""

from __future__ import annotations

import io
import itertools
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from rich.console import Console

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.streamer.checks.latency import _fault_text, _lateness, _Switcher, hogs, measure
from flexmotion.streamer.checks.latency_result import HISTOGRAM_US, Bound, LatencyResult, Slowness, Stage, Standstills
from flexmotion.streamer.checks.latency_text import render_latency
from flexmotion.streamer.checks.machine_pace import MachinePace
from flexmotion.streamer.checks.switching import shipped_clips, switched
from flexmotion.streamer.cli import execute
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.plots.latency import write_latency
from flexmotion.streamer.report.report import Latency
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ...virtual_time import virtual_time
from ...waiting import wait_until

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def result() -> LatencyResult:
    """Six switches on virtual time, without realtime scheduling."""
    op3 = load_robot("op3")
    source, intents = switched(shipped_clips())
    with virtual_time():
        return measure(
            op3, create("sim", op3), load_stream(), source, intents, seconds=60.0, switches=6, realtime=False
        )


def test_every_switch_is_followed_and_every_stage_is_measured(result: LatencyResult) -> None:
    assert result.switches == 6 and 5 <= result.answered <= 6  # the end may overtake the last one
    assert all(stage.time is not None for stage in result.stages.values())
    assert sum(result.lateness) == result.cycles and len(result.lateness) == len(HISTOGRAM_US)
    command, effect = result.stages["target to command"].time, result.stages["target to effect"].time
    assert command is not None and effect is not None and effect.p50 >= command.p50
    assert result.violations_sent == 0 and result.faults == ()


def test_load_is_a_process_that_keeps_a_processor_busy() -> None:
    def busy() -> list[psutil.Process]:
        return [process for process in psutil.Process().children() if process.name() == "fm-hog"]

    with hogs(2):
        wait_until(lambda: len(busy()) == 2, "the processes to start")
        wait_until(lambda: all(process.cpu_times().user > 0.05 for process in busy()), "processor time to pass")
    assert busy() == []


def test_without_realtime_scheduling_it_never_passes(result: LatencyResult) -> None:
    assert result.scheduling == "other" and not result.ok
    assert any("SCHED_FIFO" in failure for failure in result.failures)


def test_the_text_names_the_failures_and_shows_the_histogram(result: LatencyResult) -> None:
    out = io.StringIO()
    Console(file=out, width=120).print(render_latency(replace(result, load=1)))
    text = out.getvalue()
    assert (
        text.startswith("FAIL")
        and "target to command" in text
        and "8000 and more" in text
        and "1 busy processes" in text
    )


def test_time_that_a_host_took_is_said(result: LatencyResult) -> None:
    """Went wrong: a run on a virtual machine missed ten periods in one stall, and nothing said whose it was."""
    said = []
    for standstills in (None, Standstills(3, 130.0, 91.0, missed_deadlines=10, stolen_ms=120.0)):
        out = io.StringIO()
        Console(file=out, width=200).print(
            render_latency(replace(result, standstills=standstills, missed_deadlines=11))
        )
        text = " ".join(out.getvalue().split())
        said.append("stood still 3 times, 130 ms in all, up to 91.0 ms" in text and "took 120 ms" in text)
        assert ("10 of 11 missed deadlines" in text) == (standstills is not None)
    assert said == [False, True]
    assert result.standstills is None  # without realtime scheduling, other programs look the same


def test_what_fell_into_a_standstill_is_told_apart() -> None:
    """Twelve ticks; before the fifth the machine stood still for 20 ms, so that it and the next woke late."""
    ms = 1_000_000
    record = RunTrace(125.0, ("l_knee",))
    rows = np.zeros(12, TickRow.dtype(joints=1))
    rows["stamp_ns"] = 1000 * ms + 8 * ms * np.arange(12)
    rows["stamp_ns"][4:] += 8 * ms * 2  # two ticks left out
    rows["missed_deadlines"][4:] = 3
    rows["lateness_s"], rows["work_s"] = 0.0001, 0.001
    rows["lateness_s"][4], rows["work_s"][9] = 0.020, 0.004
    rows["target_to_command_s"] = np.nan
    rows["target_to_command_s"][[2, 5, 11]] = 0.012, 0.080, 0.013
    record.append(rows)
    stood = np.array([[1030 * ms, 1050 * ms], [5000 * ms, 5001 * ms]])  # the second one after the run
    moments = MachinePace(record, stood, stolen_ms=20.0)
    assert moments.standstills == Standstills(1, 20.0, 20.0, missed_deadlines=3, stolen_ms=20.0)
    late, work = moments.apart(rows["lateness_s"]), moments.apart(rows["work_s"], rows["work_s"])
    answered = moments.apart(rows["target_to_command_s"])
    assert (late.max(), work.max(), np.nanmax(answered)) == pytest.approx((0.0001, 0.004, 0.013))
    assert np.flatnonzero(~moments.kept).tolist() == [4, 5] and moments.missed_kept == 0


def _slow_run(idle_slow_ms: int) -> MachinePace:
    """A run of 8 s on processors that are slow for 40 ms of every 800 ms, and were before it for some of 4 s."""
    ms = 1_000_000
    record = RunTrace(125.0, ("l_knee",))
    rows = np.zeros(1001, TickRow.dtype(joints=1))
    rows["stamp_ns"] = 5000 * ms + 8 * ms * np.arange(1001)
    record.append(rows)
    begins = 5400 + 800 * np.arange(10)
    slow = np.array([(1000, 1000 + idle_slow_ms), *zip(begins, begins + 40, strict=True)], np.int64) * ms
    return MachinePace(record, np.empty((0, 2), np.int64), slow, idle=(1000 * ms, 5000 * ms))


def test_times_in_which_the_machine_was_slow_are_left_out() -> None:
    """Went wrong: processors ten times slower for 40 ms, with punctual timers, made plans late that were ours."""
    pace = _slow_run(idle_slow_ms=200)
    assert pace.slowness == Slowness(10, 40.0, pytest.approx(0.05), pytest.approx(0.05), ours=False)
    assert pace.left_out == pytest.approx(0.05, abs=0.006)
    took = np.full(1001, np.nan)
    took[[48, 55, 500]] = 0.050, 0.100, 0.050  # the second one ends just before the first slow time is over
    assert np.isfinite(pace.apart(took)).sum() == 2


def test_slowness_that_grows_with_the_run_is_the_programs() -> None:
    pace = _slow_run(idle_slow_ms=0)
    assert pace.slowness.ours and pace.left_out == 0.0
    assert len(pace.apart(np.full(1001, 0.05))) == 1001


def test_a_run_on_a_machine_that_was_often_slow_is_unfit_and_never_passes(result: LatencyResult) -> None:
    fit = replace(result, failures_kept=(), failures=("missed deadlines: 4, 0 allowed",), unfit="")
    assert (fit.verdict, fit.verdict_all, fit.ok) == ("PASS", "FAIL", True)
    unfit = replace(fit, unfit="the machine did not keep its pace in 14 % of the ticks, at most 10 % may be left out")
    assert (unfit.verdict, unfit.ok) == ("UNFIT", False)
    out = io.StringIO()
    Console(file=out, width=200).print(render_latency(replace(unfit, standstills=Standstills(1, 1.0, 1.0, 0, 0.0))))
    assert out.getvalue().startswith("UNFIT") and "not judged: missed deadlines: 4" in out.getvalue()


def test_there_is_one_verdict_with_plain_columns_and_what_helps(result: LatencyResult) -> None:
    """It printed FAIL, "PASS all of it: every budget kept" under it, "p95 60 of all", and nothing to do about it."""
    slow = replace(result, failures=(), failures_kept=("target to command: median 38 ms, 35 ms allowed",), unfit="")
    slow = replace(slow, standstills=Standstills(1, 1.0, 1.0, 0, 0.0))
    out = io.StringIO()
    Console(file=out, width=200).print(render_latency(slow))
    text = out.getvalue()
    assert text.startswith("FAIL") and "PASS" not in text and "flexmotion doctor" in text
    assert "median 35 in pace" in text and "p50" not in text and "of all" not in text
    assert all(f"{name} " in text for name in slow.stages) and "from the arrival of a target" in text
    out = io.StringIO()
    Console(file=out, width=200).print(render_latency(replace(slow, failures_kept=())))
    assert out.getvalue().startswith("PASS") and "What usually helps" not in out.getvalue()


def test_budgets_of_a_stage_bound_the_moments_that_they_are_of() -> None:
    def times(p50: float, p95: float, p99: float) -> Latency:
        return Latency(p50=p50, p95=p95, p99=p99, p99_9=p99, max=p99)

    bounds = (Bound("p95", 60, "all"), Bound("p50", 35, "kept"), Bound("p99", 50, "kept"))
    kept = Stage(times(30, 55, 90), bounds, times(30, 45, 49))
    assert kept.failures == [] == kept.failures_kept
    slow = Stage(times(40, 65, 90), bounds, times(38, 45, 52))
    assert slow.failures == ["95 % 65 ms, 60 ms allowed"]
    assert slow.failures_kept == [
        "95 % 65 ms, 60 ms allowed",
        "median 38 ms, 35 ms allowed",
        "99 % 52 ms, 50 ms allowed",
    ]
    assert Stage(None, (Bound("p99", 1),)).failures == ["nothing was measured"]


def test_a_tick_that_woke_late_makes_the_next_one_miss_its_deadline() -> None:
    """It is counted a tick after the standstill, which ended as the late tick began: it was laid to the program."""
    ms = 1_000_000
    record = RunTrace(125.0, ("l_knee",))
    rows = np.zeros(6, TickRow.dtype(joints=1))
    rows["stamp_ns"] = 1000 * ms + 8 * ms * np.arange(6)
    rows["stamp_ns"][3] += 7 * ms
    rows["stamp_ns"][4] += 1 * ms
    rows["lateness_s"][3], rows["work_s"] = 0.007, 0.002
    rows["missed_deadlines"][4:] = 1
    record.append(rows)
    stood = np.array([[1024 * ms, 1031 * ms - 50_000]])  # the witness, above the loop, woke just before it
    assert MachinePace(record, stood, stolen_ms=0.0).standstills.missed_deadlines == 1
    before = np.array([[1016 * ms, 1023 * ms]])
    assert MachinePace(record, before, stolen_ms=0.0).standstills.missed_deadlines == 0


def test_a_fall_is_told_with_the_standstill_before_it() -> None:
    """Regression: a robot fell after 457 s, and the report did not say whether the machine stood still then."""
    ms = 1_000_000
    record = RunTrace(125.0, ("l_knee",))
    rows = np.zeros(500, TickRow.dtype(joints=1))
    rows["tick"], rows["stamp_ns"] = np.arange(500), 1000 * ms + 8 * ms * np.arange(500)
    record.append(rows)
    fall = Event(375, "fault", "fall")
    for begin, length, told in (
        (3100, 83, ", 0.82 s after the machine itself stood still for 83 ms"),
        (3100, 5, ""),
        (1100, 83, ""),
    ):
        moments = MachinePace(record, np.array([[begin * ms, (begin + length) * ms]]), stolen_ms=0.0)
        assert _fault_text(fall, record, moments) == f"fall, at 3.0 s{told}"
    assert _fault_text(fall, record, None) == "fall, at 3.0 s"


def test_one_late_step_of_the_simulation_voids_no_run() -> None:
    # Regression: one step of 75,507 that was 9.5 ms late made ten minutes FAIL.
    times = {"p50": 0.7, "p95": 1.1, "p99": 1.4}
    assert _lateness(Latency(**times, p99_9=2.3, max=9.5), 0, load_stream().budgets, 125.0) == []
    (found,) = _lateness(Latency(**times, p99_9=9.5, max=30.0), 0, load_stream().budgets, 125.0)
    assert found.startswith("the simulated robot was 9.5 ms late (99.9 %)")


def test_the_picture_and_the_json(result: LatencyResult, tmp_path: Path) -> None:
    assert write_latency(tmp_path / "latency.png", result).read_bytes().startswith(PNG)
    content = json.loads(json.dumps(result.content()))
    assert content["stages"]["target to command"]["budget_p99_ms"] == 50.0
    assert (content["ok"], content["verdict"]) == (False, "FAIL")


def test_an_interrupted_robot_is_asked_for_nothing_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """While it came to a stand and parked, switches went on: "7 of 9 switches were not followed"."""
    op3, (source, intents) = load_robot("op3"), switched(shipped_clips())
    session = Session(op3, create("sim", op3), source, load_stream())
    session.telemetry.commit()
    asked = iter([None, None, None, Request.END])
    switcher = _Switcher(session, intents, 60.0, None, 0, None, lambda: next(asked, None))
    with monkeypatch.context() as patched:
        seconds = itertools.count(0.0, 3.0)
        patched.setattr("flexmotion.streamer.checks.latency.time", SimpleNamespace(perf_counter=lambda: next(seconds)))
        heard = [switcher.next() for _ in range(6)]
    assert heard == [None, None, None, Request.END, None, None]
    assert switcher.interrupted and switcher.sent == 2


def test_one_clip_is_not_enough_to_switch_between(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from flexmotion.human.motion_file import save_motion
    from flexmotion.importers.default_clip import default_clip

    file = tmp_path / "one.npz"
    save_motion(default_clip()[:90], file)
    assert execute(["check", "latency", "--clip", str(file)]) == 2
    assert "two or more files" in capsys.readouterr().err
