"""`robot/fastest_walk`: what is measured of the steady part of a run, and when a limit is met."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.robot.fastest_walk import BEGUN_S, MEASURED, Row, group_of, steady, touched, verdicts, warmest
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import TickRow, blank

SPEED, ASIDE = 0.2, 0.05
FIGURES = {"speed": 0.22, "late_deg": 5.0, "slip_mm_s": 4.0, "knee": 0.2, "touched": 0.0}


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


def walked(robot: Robot, yaw: float = 0.0, seconds: float = 6.0) -> RunTrace:
    """Rows of a robot that goes ahead and drifts aside, and stood askew before; its knees are .1 rad late."""
    record = RunTrace(robot.rate_hz, robot.joint_names)
    rows = blank(TickRow.dtype(joints=robot.n), round(seconds * robot.rate_hz))
    ticks = TickRow(rows)
    time = np.arange(len(rows)) / robot.rate_hz
    ticks.source_s[:] = time
    ahead, aside = SPEED * time, ASIDE * time
    ticks.true_com[:, 0] = np.cos(yaw) * ahead - np.sin(yaw) * aside
    ticks.true_com[:, 1] = np.sin(yaw) * ahead + np.cos(yaw) * aside
    ticks.true_base[:] = [0, 0, 0.3, np.cos(0.5 * yaw), 0, 0, np.sin(0.5 * yaw)]
    ticks.true_base[1:, 3:] = [1.0, 0.0, 0.0, 0.0]  # where it looks later is of no account
    ticks.q_ref[:], ticks.true_q[:], ticks.true_torque[:] = 0.1, 0.0, 0.5 * robot.stall_torque
    ticks.true_foot_velocity[:], ticks.true_foot_force[:] = [0.003, 0.004, 0.0], [0.0, 0.0, 20.0]
    ticks.contact_ref[:] = True
    for begin in range(50, len(rows) - 60, 100):
        ticks.contact_ref[begin : begin + 50, 0] = False
        ticks.true_foot_force[begin : begin + 50, 0] = 0.0
    record.append(rows)
    return record


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_the_way_counts_along_the_heading_that_the_robot_began_with(op3: Robot, yaw: float) -> None:
    """Went wrong: the way in any direction counted, so that a robot that drifts aside was faster."""
    found = steady(walked(op3, yaw), op3)
    assert found["speed"] == pytest.approx(SPEED)


def test_the_figures_of_a_steady_walk(op3: Robot) -> None:
    found = steady(walked(op3), op3)
    assert found["late_deg"] == pytest.approx(np.degrees(0.1))
    assert found["knee"] == pytest.approx(0.5) and found["touched"] == 0.0
    assert found["slip_mm_s"] == pytest.approx(5.0)


def test_what_happens_before_the_walk_is_steady_does_not_count(op3: Robot) -> None:
    record = walked(op3)
    early = record.source_s < BEGUN_S
    record.q_ref[early], record.true_torque[early] = 3.0, 9.0
    assert steady(record, op3) == steady(walked(op3), op3)


@pytest.mark.parametrize(
    ("field", "figure"),
    [("true_com", "speed"), ("true_q", "late_deg"), ("true_torque", "knee"), ("true_foot_velocity", "slip_mm_s")],
)
def test_what_is_not_known_of_the_motion_is_no_figure(op3: Robot, field: str, figure: str) -> None:
    record = walked(op3)
    getattr(record, field)[-1 if field == "true_com" else slice(None)] = np.nan
    found = steady(record, op3)
    assert [name for name in MEASURED if found[name] is None] == [figure]


def test_a_run_that_ends_before_it_is_steady_has_no_figures(op3: Robot) -> None:
    assert steady(walked(op3, seconds=2.0), op3) == dict.fromkeys(MEASURED)


def swung(*touches: float) -> tuple[np.ndarray, np.ndarray]:
    """Planned contacts and forces of a left foot that swings once for each force, which it bears in mid-swing."""
    planned, force = np.ones((100 * len(touches), 2), bool), np.full((100 * len(touches), 2), 20.0)
    for number, newtons in enumerate(touches):
        begin = 100 * number + 30
        planned[begin : begin + 40, 0], force[begin : begin + 40, 0] = False, 0.0
        force[begin + 20, 0] = newtons
    return planned, force


@pytest.mark.parametrize(("touches", "expected"), [((0.0,), 0.0), ((0.0, 8.0), 0.5), ((8.0, 8.0), 1.0)])
def test_a_foot_touches_in_the_middle_of_its_swing(touches: tuple[float, ...], expected: float) -> None:
    assert touched(*swung(*touches)) == expected


def test_a_foot_that_lifts_late_or_lands_early_touches_nothing() -> None:
    planned, force = swung(0.0)
    force[30:38, 0] = force[64:70, 0] = 20.0
    assert touched(planned, force) == 0.0


def test_without_a_whole_swing_or_its_forces_nothing_is_known_of_touches() -> None:
    planned, force = swung(0.0)
    assert touched(planned[:50], force[:50]) is None and touched(planned[40:], force[40:]) is None
    assert touched(*swung(0.0, np.nan)) is None


def test_the_warmest_servo_is_that_of_any_moment() -> None:
    """Went wrong: the temperature of the last row alone counted, which a servo that is read in turns may not have."""
    rows = np.full((4, 3), np.nan)
    assert warmest(rows) is None
    rows[1, 2], rows[2, 0] = 61.0, 40.0
    assert warmest(rows) == 61.0


def row(upright: bool = True, violations: int = 0, **changed: Any) -> Row:
    figures: dict[str, Any] = FIGURES | changed if upright else dict.fromkeys(MEASURED)
    return Row(1, False, upright, **figures, warmest=50.0, violations=violations)


def failures(*rows: Row) -> list[str]:
    return [one.sentence for one in verdicts("nominal", group_of(rows)) if not one.holds]


def test_a_walk_within_the_limits_passes() -> None:
    assert failures(row(), row(speed=0.21), row(speed=0.23)) == []


@pytest.mark.parametrize("name", ["speed", "late_deg", "slip_mm_s", "knee"])
def test_a_figure_that_is_not_known_does_not_meet_its_limit(name: str) -> None:
    """Went wrong: an unknown figure was 0, which is below every limit."""
    (sentence,) = failures(row(), row(**{name: None}), row())
    assert sentence.startswith("nominal: ") and "-" in sentence


def test_a_fall_fails_alone_as_long_as_others_stay_up() -> None:
    assert failures(row(), row(upright=False)) == ["nominal: upright 1 of 2 (all)"]
    assert len(failures(row(upright=False))) == 5


def test_each_limit_can_fail() -> None:
    bad = {"speed": 0.19, "late_deg": 6.1, "slip_mm_s": 5.1, "knee": 0.31}
    for name, value in bad.items():
        assert len(failures(row(**{name: value}))) == 1
    assert failures(row(violations=1)) == ["nominal: goals outside the envelope: 1 (0)"]
