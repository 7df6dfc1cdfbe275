"""Keys and verdict of the report; equal runs give equal bytes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures
from flexmotion.streamer.report.report import TIMING_KEYS, Latency, Report, RunInfo, build_report

INFO = RunInfo(robot="op3", driver="sim", source="walk.bvh", seed=3, elapsed_s=1.6)

CONTRACT = {
    "": "schema ok robot driver source seed duration_s clock loop planner motion limits safety log",
    "loop": "rate_hz cycles missed_deadlines wake_lateness_us work_us realtime robot_lateness_us",
    "planner": "plans sample_ms retarget_ms target_to_command_ms target_to_effect_ms underruns",
    "motion": "fell time_to_fall_s joint_rmse_rad foot_slip_mm_s net_path_ratio heading_rms_rad steps_planned "
    "steps_dropped hand_error_share self_collisions",
    "limits": "violations_sent repairs joints",
    "safety": "final_state faults",
}


def build(record: RunTrace, figures: RobotFigures, human: HumanTrack | None = None) -> Report:
    return build_report(record, INFO, figures, human=human)


def test_keys_of_the_contract(record: RunTrace, figures: RobotFigures, human: HumanTrack) -> None:
    content = json.loads(build(record, figures, human).json_text())
    for section, keys in CONTRACT.items():
        assert set(keys.split()) <= set(content[section] if section else content)
    assert content["schema"] == "flexmotion.report/1"
    assert set(content["limits"]["repairs"]) == {"position", "speed", "acceleration", "torque"}
    assert content["limits"]["joints"]["l_knee"]["torque_limit_nm"] == 2.5
    assert content["loop"]["work_us"] == {"p50": 300.0, "p95": 300.0, "p99": 300.0, "p99_9": 300.0, "max": 300.0}
    assert content["loop"]["realtime_factor"] == 5.0
    assert content["safety"] == {"final_state": "HOLD", "faults": [], "hardware_failed": False}
    assert content["ok"] is True


def test_unknown_figures_are_null_and_never_nan(record: RunTrace, figures: RobotFigures) -> None:
    for array in (record.true_base, record.true_torque, record.true_saturated, record.qd, record.work_s):
        array[:] = np.nan
    text = build(record, figures).json_text()
    content = json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} in the report"))
    assert content["motion"]["net_path_ratio"] is None
    assert content["limits"]["joints"]["l_knee"]["peak_torque_nm"] is None
    assert content["loop"]["work_us"] is None


def test_equal_runs_give_equal_bytes_but_for_timing(
    make: Callable[..., RunTrace], figures: RobotFigures, human: HumanTrack
) -> None:
    first, second = make(), make()
    second.work_s[:] = 1.0
    contents = [json.loads(build(r, figures, human).json_text()) for r in (first, second)]
    assert contents[0] != contents[1]
    for content in contents:
        for key in TIMING_KEYS:
            del content[key]
    assert json.dumps(contents[0]) == json.dumps(contents[1])


def test_figures_have_six_digits(record: RunTrace, figures: RobotFigures) -> None:
    record.true_foot_velocity[..., 0] = 1 / 3000
    assert '"foot_slip_mm_s": 0.333333,' in build(record, figures).json_text()


def fell(record: RunTrace) -> None:
    record.true_base[600:, 2] = 0.05


def fell_without_truth(record: RunTrace) -> None:
    record.true_base[:] = np.nan
    record.state[600:] = State.DAMPED


def fault(record: RunTrace) -> None:
    record.events.append(Event(5, "fault", "l_knee: servo 14 reports overheating"))


def violation(record: RunTrace) -> None:
    record.rows["violations"] = 1


def missed(record: RunTrace) -> None:
    record.rows["missed_deadlines"] = 1


@pytest.mark.parametrize("harm", [fell, fell_without_truth, fault, violation, missed])
def test_not_ok(harm: Callable[[RunTrace], None], record: RunTrace, figures: RobotFigures) -> None:
    harm(record)
    report = build(record, figures)
    assert not report.ok
    if harm in (fell, fell_without_truth):
        assert report.motion.time_to_fall_s == pytest.approx(4.8)
    if harm is fault:
        assert report.safety.faults == ["l_knee: servo 14 reports overheating"]


def test_parking_low_is_ok(record: RunTrace, figures: RobotFigures) -> None:
    record.state[950:-1], record.state[record.used - 1] = State.PARK, State.OFF
    record.true_base[950:, 2] = 0.1
    assert build(record, figures).ok


def test_deadline_budget(record: RunTrace, figures: RobotFigures) -> None:
    record.rows["missed_deadlines"] = 9
    within = RunInfo(robot="op3", driver="sim", source="x", missed_allowed=9)
    assert build_report(record, within, figures).ok


def test_latency_percentiles() -> None:
    latency = Latency.of(np.arange(1001) * 1e-6, 1e-6)
    assert latency == Latency(p50=500, p95=950, p99=990, p99_9=999, max=1000)
    assert Latency.of([np.nan], 1.0) is None


def test_write(tmp_path: Path, record: RunTrace, figures: RobotFigures) -> None:
    report = build(record, figures)
    file = report.write(tmp_path / "deep" / "folder")
    assert file.name == "report.json"
    assert Report.model_validate_json(file.read_text()) == report


def test_empty_run_has_a_report(figures: RobotFigures, record: RunTrace) -> None:
    empty = RunTrace(rate_hz=125.0, joint_names=record.joint_names)
    report = build(empty, figures)
    assert report.duration_s == 0 and report.safety.final_state == "OFF"
