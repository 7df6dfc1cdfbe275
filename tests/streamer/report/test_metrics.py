"""Each figure of merit against what a hand calculation says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.report import metrics
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures, joint_loads, motion_figures

deterministic = settings(max_examples=50)


def standing(record: RunTrace) -> np.ndarray:
    return np.isin(record.state[: record.used], (State.STREAMING, State.HOLD))


def quaternion(axis: str, degrees: float) -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_quat(scalar_first=True)


@pytest.mark.parametrize(
    ("degrees", "height", "expected"), [(44, 0.3, None), (46, 0.3, 1), (0, 0.19, None), (0, 0.17, 1)]
)
def test_fall_is_tilt_or_height(degrees: float, height: float, expected: int | None) -> None:
    base = np.array([[0, 0, 0.3, 1, 0, 0, 0], [0, 0, height, *quaternion("y", degrees)]])
    assert metrics.first_fall(base, np.full((2, 7), np.nan), 0.3, np.ones(2, bool)) == expected


@pytest.mark.parametrize(("degrees", "expected"), [(70, None), (80, 1), (-46, 1)])
def test_a_bow_is_a_fall_where_it_goes_beyond_its_plan(degrees: float, expected: int | None) -> None:
    """Each bow of more than 45° was a fall, so that a robot that can bow to 79° bowed to 40."""
    base = np.array([[0, 0, 0.3, 1, 0, 0, 0], [0, 0, 0.3, *quaternion("y", degrees)]])
    planned = np.array([[0, 0, 0.3, *quaternion("y", 65)]] * 2)
    assert metrics.first_fall(base, planned, 0.3, np.ones(2, bool)) == expected


def test_a_robot_whose_plan_is_not_known_is_to_be_upright() -> None:
    base = np.array([[0, 0, 0.3, *quaternion("y", 60)]] * 2)
    planned = base.copy()
    planned[1] = np.nan
    assert metrics.first_fall(base, planned, 0.3, np.zeros(2, bool)) == 1


def test_crouching_on_purpose_is_no_fall_and_tilting_is_always_one() -> None:
    low = np.array([[0, 0, 0.1, 1, 0, 0, 0]])
    assert metrics.first_fall(low, low, 0.3, np.zeros(1, bool)) is None
    tilted = np.array([[0, 0, 0.3, *quaternion("x", 60)]])
    assert metrics.first_fall(tilted, low, 0.3, np.zeros(1, bool)) == 0


def test_unknown_pose_is_no_fall() -> None:
    unknown = np.full((3, 7), np.nan)
    assert metrics.first_fall(unknown, unknown, 0.3, np.ones(3, bool)) is None


@deterministic
@given(st.integers(0, 12), st.floats(0, 0.1))
def test_tracking_error_takes_out_the_lag_but_not_an_offset(lag: int, offset: float) -> None:
    t = np.arange(600) / 125
    reference = np.sin(2 * np.pi * t[:, None] * np.array([0.7, 1.1]))
    measured = np.full_like(reference, np.nan)
    measured[lag:] = reference[: len(t) - lag] + offset
    found = metrics.tracking_error(reference, measured, max_lag=12)
    assert found is not None
    assert found[0] <= offset + 1e-12  # a longer lag may hide part of a constant offset, never add to it
    if offset == 0:
        assert found == (pytest.approx(0.0, abs=1e-12), lag)


def test_tracking_error_without_common_rows_is_unknown() -> None:
    assert metrics.tracking_error(np.full((5, 2), np.nan), np.zeros((5, 2)), 3) is None
    assert metrics.tracking_error(np.zeros((0, 2)), np.zeros((0, 2)), 3) is None


def test_slip_counts_loaded_feet_and_horizontal_speed_only() -> None:
    velocity = np.zeros((2, 2, 3))
    velocity[0, 0] = [0.003, 0.004, 9.0]
    velocity[0, 1] = [5.0, 0.0, 0.0]
    force = np.zeros((2, 2, 3))
    force[:, 0, 2] = 30.0
    assert metrics.foot_slip(velocity, force, weight=30.0) == pytest.approx(0.005 / 2)
    assert metrics.foot_slip(velocity, np.zeros_like(force), weight=30.0) is None


def test_net_path_needs_a_human_that_moves() -> None:
    robot, walked, stood = (metrics.Displacement(ahead, 0.0, 0.0) for ahead in (0.1, 0.25 * 0.8, 0.25 * 0.4))
    assert metrics.net_path_ratio(robot, walked, 0.25) == pytest.approx(0.5)
    assert metrics.net_path_ratio(robot, stood, 0.25) is None


@pytest.mark.parametrize(
    ("ahead", "left", "expected"), [(0.3, 0.0, 0.75), (0.3, 0.2, 0.75), (0.0, 0.2, 0.0), (-0.07, 0.0, 0.0)]
)
def test_only_what_leads_where_the_human_went_counts_as_its_way(ahead: float, left: float, expected: float) -> None:
    """A robot that fell backwards, .07 m, while its human went ahead had a net path of .22."""
    robot, human = metrics.Displacement(ahead, left, 0.0), metrics.Displacement(0.4, 0.0, 0.0)
    assert metrics.net_path_ratio(robot, human, 0.5) == pytest.approx(expected)


def test_heading_error_is_relative_to_each_start() -> None:
    human = np.linspace(1.0, 1.0 + 2 * np.pi, 100)
    assert metrics.heading_rms(human - 3.0, human) == pytest.approx(0.0)
    still = np.zeros(100)
    assert metrics.heading_rms(still, human) == pytest.approx(np.sqrt(np.mean((human - 1.0) ** 2)))


def test_displacement_is_seen_from_where_one_stood() -> None:
    """Displacement is relative to the first heading. Regression: the report gave a length without a direction."""
    yaw = np.array([np.pi / 2, np.pi])
    went = metrics.Displacement.of(np.array([[1.0, 1.0, 9.0], [0.8, 1.5, 0.0]]), yaw, scale=2.0)
    assert (went.ahead_m, went.left_m, went.turned_rad) == pytest.approx((1.0, 0.4, np.pi / 2))


def test_hand_error_ignores_what_is_out_of_reach() -> None:
    error = np.array([[0.01, np.nan], [0.02, 0.03], [np.nan, np.nan]])
    assert metrics.hand_error_share(error, 0.2) == pytest.approx(0.1)
    assert metrics.hand_error_share(np.full((3, 2), np.nan), 0.2) is None


def test_limb_stiffness_is_that_of_joints_beside_the_legs_while_goals_are_sent() -> None:
    shares, legs = np.array([[np.nan] * 3, [1.0, 0.5, 0.3], [1.0, 0.7, 0.1]]), np.array([0])
    assert metrics.limb_stiffness(shares, legs) == pytest.approx(0.4)
    assert metrics.limb_stiffness(shares[:1], legs) is None
    assert metrics.limb_stiffness(shares, np.arange(3)) is None


@pytest.mark.parametrize(
    ("pattern", "expected"), [("....", 0), ("####", 1), ("#..#", 1), ("#...#", 1), ("#....#", 2), (".##......#.", 2)]
)
def test_episodes_bridge_short_gaps(pattern: str, expected: int) -> None:
    assert metrics.episodes(np.array([c == "#" for c in pattern]), gap=4) == expected


def test_figures_of_a_run(record: RunTrace, figures: RobotFigures, human: HumanTrack) -> None:
    record.hand_error[:] = 0.01
    found = motion_figures(record, figures, human, should_stand=standing(record))
    assert not found.fell and found.time_to_fall_s is None
    assert found.joint_rmse_rad == pytest.approx(0.0, abs=1e-12)
    assert found.lag_s == pytest.approx(2 / 125)
    assert found.foot_slip_mm_s == pytest.approx(2.0)
    assert found.net_path_ratio == pytest.approx(np.cos(1.0))  # what leads where the human went, see below
    assert found.heading_rms_rad == pytest.approx(0.0, abs=1e-9)
    assert found.robot_went is not None and found.human_went is not None
    # As far as the human on shorter legs, who looked 1 rad to the left of where it went, and turned as much.
    ways = [(went.ahead_m, went.left_m) for went in (found.robot_went, found.human_went)]
    assert np.hypot(*ways[0]) == pytest.approx(np.hypot(*ways[1]))
    assert ways[1][1] == pytest.approx(-np.tan(1.0) * ways[1][0])
    assert found.robot_went.turned_rad == pytest.approx(found.human_went.turned_rad, abs=0.02)  # it turns on to the end
    assert found.behind_m == pytest.approx(2.0 * np.sin(0.5) * np.hypot(*ways[1]), rel=0.01)
    assert found.hand_error_share == pytest.approx(0.05)
    assert found.self_collisions == 0


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_a_robot_that_goes_part_of_the_way_is_the_rest_behind(
    record: RunTrace, figures: RobotFigures, human: HumanTrack, share: float
) -> None:
    record.true_base[:, :2] = share * record.true_base[:, :2]
    found = motion_figures(record, figures, replace(human, heading=human.heading * 0.0), should_stand=standing(record))
    assert found.human_went is not None
    way = np.hypot(found.human_went.ahead_m, found.human_went.left_m)
    assert found.behind_m == pytest.approx((1.0 - share) * way, abs=0.02 * way)


@pytest.mark.parametrize(("before", "fell"), [(State.PARK, False), (State.STREAMING, True)])
def test_a_parked_robot_whose_torque_is_off_has_not_fallen(
    record: RunTrace, figures: RobotFigures, human: HumanTrack, before: State, fell: bool
) -> None:
    """A live run that was disarmed ended in "FAIL fell after 257 s": without torque the robot had leant over."""
    off = 500
    record.state[off - 10 : off] = before
    record.state[off : off + 100], record.state[off + 100 :] = State.FAULT, State.OFF
    record.true_base[off:, 3:] = quaternion("y", 80)
    assert motion_figures(record, figures, human, should_stand=standing(record)).fell is fell


def test_what_follows_a_fall_does_not_count(record: RunTrace, figures: RobotFigures, human: HumanTrack) -> None:
    fall = 500
    record.true_base[fall:, 3:] = quaternion("y", 80)
    record.true_foot_velocity[fall:] = 9.0
    record.q[fall:] += 1.0
    found = motion_figures(record, figures, human, should_stand=standing(record))
    assert found.fell and found.time_to_fall_s == pytest.approx(fall / 125)
    assert found.foot_slip_mm_s == pytest.approx(2.0)


def test_without_truth_only_what_servos_tell_is_known(
    record: RunTrace, figures: RobotFigures, human: HumanTrack
) -> None:
    for array in (record.true_base, record.true_foot_velocity, record.true_foot_force, record.true_saturated):
        array[:] = np.nan
    # Reports of real robots once told no torque, though their servos measure it.
    record.effort[:] = 0.9 * record.true_torque
    record.true_torque[:] = np.nan
    found = motion_figures(record, figures, human, should_stand=standing(record))
    assert found.joint_rmse_rad is not None
    assert (found.foot_slip_mm_s, found.net_path_ratio, found.heading_rms_rad, found.self_collisions) == (None,) * 4
    assert record.torque_source == "servos"
    knee = joint_loads(record, figures)["l_knee"]
    assert knee.rms_torque_nm == pytest.approx(0.9 * 1.2 / np.sqrt(2), rel=2e-2)
    assert knee.saturated_share is None
    record.stale[:, 1] = 1  # a servo that did not answer has measured nothing
    assert joint_loads(record, figures)["l_knee"].rms_torque_nm is None
    record.effort[:] = np.nan
    assert record.torque_source is None
    assert joint_loads(record, figures)["l_hip_pitch"].rms_torque_nm is None


def test_the_simulation_knows_better_than_its_servos(record: RunTrace, figures: RobotFigures) -> None:
    record.effort[:] = 9.0
    assert record.torque_source == "simulation"
    assert joint_loads(record, figures)["l_knee"].peak_torque_nm == pytest.approx(1.2, abs=1e-3)


def test_human_is_interpolated_on_the_source_clock(human: HumanTrack) -> None:
    position, heading = human.at(np.array([0.5, 99.0]))
    assert position[:, 0] == pytest.approx([0.2, 4.0])
    assert heading[0] == pytest.approx(1.0 + 0.3 * 0.5 / (8 - 1 / 125))


def test_joint_loads(record: RunTrace, figures: RobotFigures) -> None:
    record.q_cmd[:100] = np.nan  # torque off: does not count
    record.true_torque[:100] = 99.0
    loads = joint_loads(record, replace(figures, stall_torque=np.full(6, 4.0)))
    knee = loads["l_knee"]
    assert list(loads) == list(record.joint_names)
    assert knee.peak_torque_nm == pytest.approx(1.2, abs=1e-3)
    assert knee.rms_torque_nm == pytest.approx(1.2 / np.sqrt(2), rel=2e-2)
    assert knee.rms_share_of_stall == pytest.approx(1.2 / np.sqrt(2) / 4, rel=2e-2)
    assert knee.peak_speed_rad_s == pytest.approx(0.4 * 2 * np.pi * 1.2, rel=1e-2)
    assert knee.saturated_share == pytest.approx((record.used // 4 - 100) / (record.used - 100))
    assert (knee.torque_limit_nm, knee.speed_limit_rad_s) == (2.5, 4.8)


def test_the_ways_of_a_robot_that_is_set_up_again_add_up() -> None:
    """A live run with a walk, an e-stop and another walk "went 0.00 m": the simulated robot stood where it began."""
    base = np.zeros((9, 7))
    base[:, 3] = 1.0
    base[:3, 0] = (1.0, 1.5, 2.0)
    base[2, 3:] = quaternion("z", 90)  # it looks to the left when it is stopped
    base[6:, 0] = (1.0, 1.2, 1.4)
    stands = np.array([True, True, True, False, False, False, True, True, True])
    position, heading = metrics.way(base, stands, ~stands)
    went = metrics.Displacement.of(position[stands], heading[stands])
    assert (went.ahead_m, went.left_m, went.turned_rad) == pytest.approx((1.0, 0.4, np.pi / 2))
    assert np.isnan(position[3:6]).all()
    parked, _ = metrics.way(base, stands, np.zeros_like(stands))
    np.testing.assert_array_equal(parked[stands], base[stands, :3], "with torque it stays where it is")
