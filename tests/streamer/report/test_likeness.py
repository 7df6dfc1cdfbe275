"""What the robot did of the human's motion, part by part, and that nothing is left out of the count."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.human.contacts import ContactDetector
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.retarget.arms import UpperBody
from flexmotion.retarget.human import HumanWindow
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.outcome import Outcome
from flexmotion.streamer.report.directions import angle, human_directions, robot_directions, trunk_of
from flexmotion.streamer.report.likeness import Likeness, likeness
from flexmotion.streamer.report.metrics import RobotFigures
from flexmotion.streamer.report.report import Report, RunInfo, build_report
from flexmotion.streamer.report.summary import failures, likeness_words, verdict

FPS, SECONDS = 30.0, 4.0
FRAMES = int(FPS * SECONDS) + 1
TIMES = np.arange(FRAMES) / FPS


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def upper(robot: Robot) -> UpperBody:
    return UpperBody(robot)


def person(**changes: np.ndarray) -> Motion:
    """A human that stands upright, arms down; joints by name, `x`, `z` and `yaw` of the pelvis over the frames."""
    joints = np.zeros((FRAMES, len(JOINTS)))
    standing = Motion(FPS, np.zeros((FRAMES, 3)), np.tile([1.0, 0, 0, 0], (FRAMES, 1)), joints)
    position = np.zeros((FRAMES, 3))
    position[:, 2] = standing.body.leg + 0.05
    position[:, 0] += changes.pop("x", 0.0)
    position[:, 2] += changes.pop("z", 0.0)
    yaw = changes.pop("yaw", np.zeros(FRAMES))
    for name, values in changes.items():
        joints[:, JOINTS.index(name)] = values
    quaternion = Rotation.from_euler("z", np.broadcast_to(yaw, FRAMES)[:, None]).as_quat(scalar_first=True)
    return replace(standing, root_position=position, root_quaternion=quaternion, joints=joints)


def ran(robot: Robot, x: Any = 0.0, yaw: Any = 0.0, pitch: Any = 0.0, q: np.ndarray | None = None) -> RunTrace:
    """A run in which the robot goes ahead, turns and bends by functions of time [m, rad], and holds its joints."""
    ticks = int(SECONDS * robot.rate_hz)
    t = np.arange(ticks) / robot.rate_hz
    record = RunTrace(robot.rate_hz, robot.joint_names)
    record.append(blank(TickRow.dtype(joints=robot.n), ticks))
    record.rows["tick"], record.rows["source_s"], record.rows["state"] = np.arange(ticks), t, State.STREAMING
    record.rows["q"] = robot.stand_pose if q is None else q
    record.rows["true_base"][:, :3] = np.column_stack([x + 0 * t, 0 * t, 0.25 + 0 * t])
    turned = Rotation.from_euler("ZY", np.column_stack([yaw + 0 * t, pitch + 0 * t]))
    record.rows["true_base"][:, 3:] = turned.as_quat(scalar_first=True)
    record.rows["true_foot_force"] = [0.0, 0.0, 15.0]
    record.rows["contact_ref"] = True
    record.rows["tilt"] = 0.0
    return record


def judged(robot: Robot, record: RunTrace, motion: Motion) -> Likeness:
    found = likeness(record, robot, RobotFigures.of(robot, motion.body.leg), motion)
    assert found is not None
    return found


def test_a_human_that_only_stands_leaves_nothing_to_leave_out(robot: Robot) -> None:
    found = judged(robot, ran(robot), person())
    assert (found.parts, found.score, found.left_out) == ({}, 1.0, ())


@pytest.mark.parametrize(("share", "left_out"), [(1.0, ()), (0.75, ()), (0.25, ("path",)), (0.0, ("path",))])
def test_share_of_the_way(robot: Robot, share: float, left_out: tuple[str, ...]) -> None:
    figures = RobotFigures.of(robot)
    t = np.arange(int(SECONDS * robot.rate_hz)) / robot.rate_hz
    found = judged(robot, ran(robot, x=share * 0.5 * figures.leg_ratio * t), person(x=0.5 * TIMES))
    assert found.parts["path"] == pytest.approx(share, abs=0.02)
    assert found.left_out == left_out
    assert found.score == found.parts["path"]


@pytest.mark.parametrize(("back", "share"), [(0.5, 0.0), (-1.0, 1.0)])
def test_a_fall_backwards_is_no_part_of_the_way(robot: Robot, back: float, share: float) -> None:
    """A robot that fell backwards while its human went ahead did "path 21 %". One that also walks back does all."""
    figures = RobotFigures.of(robot)
    t = np.arange(int(SECONDS * robot.rate_hz)) / robot.rate_hz
    way = 0.5 * figures.leg_ratio * t
    human = person(x=np.sign(back) * 0.5 * TIMES)
    human.root_position[:6, 0] = -0.03 * np.sign(back)  # it sways first
    assert judged(robot, ran(robot, x=-abs(back) * way), human).parts["path"] == pytest.approx(share, abs=0.05)


def test_the_way_of_a_circle_counts_to_its_far_side(robot: Robot) -> None:
    """Both come back to where they began; the robot looks to another side of the world, and is late."""
    figures = RobotFigures.of(robot)
    turned = 2.0 * np.pi * TIMES / SECONDS
    human = person(yaw=turned)
    human.root_position[:, 0], human.root_position[:, 1] = np.sin(turned), 1.0 - np.cos(turned)
    t = np.clip(np.arange(int(SECONDS * robot.rate_hz)) / robot.rate_hz - 0.2, 0.0, None)
    angle = 2.0 * np.pi * t / SECONDS
    record = ran(robot, yaw=angle + np.pi / 2)
    record.rows["true_base"][:, 0] = -figures.leg_ratio * (1.0 - np.cos(angle))
    record.rows["true_base"][:, 1] = figures.leg_ratio * np.sin(angle)
    assert judged(robot, record, human).parts["path"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("robot_deg", "share"), [(90.0, 1.0), (45.0, 0.5), (-90.0, 0.0), (180.0, 0.0)])
def test_share_of_a_turn_is_signed(robot: Robot, robot_deg: float, share: float) -> None:
    rate = np.deg2rad(1.0) / SECONDS
    t = np.arange(int(SECONDS * robot.rate_hz)) / robot.rate_hz
    found = judged(robot, ran(robot, yaw=robot_deg * rate * t), person(yaw=90.0 * rate * TIMES))
    assert found.parts["turn"] == pytest.approx(share, abs=0.02)
    assert found.human_turned_deg == pytest.approx(90.0, abs=1.0)


def test_a_turn_there_and_back_counts(robot: Robot) -> None:
    there = np.deg2rad(80.0) * np.sin(np.pi * TIMES / SECONDS)
    assert judged(robot, ran(robot), person(yaw=there)).left_out == ("turn",)


def test_share_of_a_bend(robot: Robot) -> None:
    bow = np.deg2rad(60.0) * np.sin(np.pi * TIMES / SECONDS)
    t = np.arange(int(SECONDS * robot.rate_hz)) / robot.rate_hz
    half = np.deg2rad(24.0) * np.sin(np.pi * t / SECONDS)
    found = judged(robot, ran(robot, pitch=half), person(lumbar_extension=-bow))
    assert found.human_bend_deg == pytest.approx(60.0, abs=1.0)
    assert found.parts["bend"] == found.trunk_range == pytest.approx(0.4, abs=0.02)
    assert found.left_out == ("bend",)
    mean = np.degrees(np.abs(bow).mean()) * 0.6
    assert found.trunk_deg == pytest.approx(mean, abs=1.0)


def test_flight_is_left_out_by_a_robot_that_keeps_its_feet_down(robot: Robot) -> None:
    jump = np.where((TIMES > 1.5) & (TIMES < 2.1), 0.35, 0.0)
    found = judged(robot, ran(robot), person(z=jump))
    assert found.human_flight_s == pytest.approx(0.6, abs=0.15)
    assert found.parts["flight"] == 0.0 and "flight" in found.left_out
    flown = ran(robot)
    flown.true_foot_force[(flown.source_s > 1.5) & (flown.source_s < 2.1)] = 0.0
    assert judged(robot, flown, person(z=jump)).parts["flight"] > 0.7


def test_arms_that_do_not_move_are_left_out_and_their_errors_counted(robot: Robot, upper: UpperBody) -> None:
    raised = person(shoulder_flexion_l=np.full(FRAMES, np.pi / 2), shoulder_flexion_r=np.full(FRAMES, np.pi / 2))
    still = judged(robot, ran(robot), raised)
    assert still.parts["hands"] == pytest.approx(0.0, abs=1e-9) and still.left_out == ("hands",)
    assert still.upper_arm_deg is not None and still.upper_arm_deg > 70
    window = HumanWindow(raised, 0.0, ContactDetector().initial(), None)
    angles, _ = upper.solve(window.kinematics, robot.stand_pose[upper.joints], raised.fps)
    q = robot.stand_pose.copy()
    q[upper.joints] = angles[-1]
    followed = judged(robot, ran(robot, q=q), raised)
    assert followed.parts["hands"] > 0.7 and followed.left_out == ()
    assert followed.arm_direction_deg is not None and still.arm_direction_deg is not None
    assert followed.arm_direction_deg < 0.3 * still.arm_direction_deg


def test_samples_out_of_reach_are_counted_and_not_left_out(robot: Robot) -> None:
    """Straight arms are out of reach: their directions are compared all the same."""
    straight = person(shoulder_flexion_l=np.full(FRAMES, np.pi / 2), shoulder_flexion_r=np.full(FRAMES, np.pi / 2))
    bent = np.concatenate([np.zeros(FRAMES // 2), np.full(FRAMES - FRAMES // 2, 1.5)])
    half = replace(straight, joints=straight.joints.copy())
    for side in "lr":
        half.joints[:, JOINTS.index(f"elbow_flexion_{side}")] = bent
    all_out, half_out = judged(robot, ran(robot), straight), judged(robot, ran(robot), half)
    assert all_out.unreachable_share == 1.0
    assert half_out.unreachable_share == pytest.approx(0.5, abs=0.03)
    assert all_out.upper_arm_deg == pytest.approx(half_out.upper_arm_deg, abs=0.1)


def test_ticks_after_a_fall_are_not_compared(robot: Robot) -> None:
    t = np.arange(int(SECONDS * robot.rate_hz)) / robot.rate_hz
    figures = RobotFigures.of(robot)
    record = ran(robot, x=0.5 * figures.leg_ratio * t)
    record.true_base[len(t) // 2 :, :3] = [5.0, 5.0, 0.03]
    assert judged(robot, record, person(x=0.5 * TIMES)).parts["path"] == pytest.approx(1.0, abs=0.02)


def test_without_a_tick_of_the_human_it_is_unknown(robot: Robot) -> None:
    record = ran(robot)
    record.rows["source_s"] = np.nan
    assert likeness(record, robot, RobotFigures.of(robot), person()) is None


def test_directions_of_the_robot_are_those_of_its_model(robot: Robot, upper: UpperBody) -> None:
    q = robot.stand_pose.copy()
    q[robot.index("l_sho_roll")] = 0.0  # the arm straight out
    made = robot_directions(upper.chain, q[None], np.array([[0.0, 0, 1]]))
    assert np.degrees(angle(made.upper_arm[0, 0], np.array([0.0, 1.0, 0.0]))) < 1.0
    assert np.degrees(angle(made.upper_arm[0, 1], np.array([0.0, 0.0, -1.0]))) < 20.0


def test_hanging_arms_of_the_human_point_down() -> None:
    window = HumanWindow(person(), 0.0, ContactDetector().initial(), None)
    found = human_directions(window.kinematics)
    assert np.degrees(angle(found.upper_arm, np.array([0.0, 0.0, -1.0]))).max() < 15.0
    assert np.degrees(angle(found.trunk, np.array([0.0, 0.0, 1.0]))).max() < 1.0


@pytest.mark.parametrize(("roll", "pitched", "yaw"), [(0.1, 0.3, 0.0), (-0.2, 0.1, 2.0)])
def test_trunk_by_the_estimated_tilt_where_the_true_one_is_unknown(roll: float, pitched: float, yaw: float) -> None:
    true = np.zeros((1, 7))
    true[0, 3:] = Rotation.from_euler("ZYX", [yaw, pitched, roll]).as_quat(scalar_first=True)
    tilt = np.array([[roll, pitched]])
    by_truth, by_tilt = trunk_of(true, tilt), trunk_of(np.full((1, 7), np.nan), tilt)
    assert np.degrees(angle(by_truth, by_tilt)[0]) < 2.0


def test_report_of_a_run_has_it_in_json_and_text(outcome: Outcome) -> None:
    content = json.loads(outcome.report.json_text())["likeness"]
    expected = {"net_path", "heading_deg", "arm_direction_deg", "trunk_range", "left_out", "score", "parts"}
    assert expected <= set(content)
    assert content["left_out"] == [name for name, share in content["parts"].items() if share < 0.5]
    assert likeness_words(outcome.report) in verdict(outcome.report)


@pytest.mark.parametrize(("least", "ok"), [(0.2, True), (0.3, False), (None, True)])
def test_less_than_the_least_likeness_fails_and_says_so(
    robot: Robot, make: Callable[..., RunTrace], figures: RobotFigures, least: float | None, ok: bool
) -> None:
    found = judged(robot, ran(robot), person(x=0.5 * TIMES, yaw=np.deg2rad(45) * TIMES))
    found = replace(found, score=0.25)
    report = built(make(), figures, found, least)
    assert report.ok is ok
    assert ("at least 0.3 was asked for" in " ".join(failures(report))) is not ok
    assert "left out: path (0 %), turn (0 %)" in verdict(report)


def test_what_a_fall_kept_the_robot_from_is_left_out_too(
    robot: Robot, make: Callable[..., RunTrace], figures: RobotFigures
) -> None:
    """A robot that fell in the first third of a script had "likeness 65 %, nothing left out"."""
    found = replace(judged(robot, ran(robot), person()), score=0.65)
    report = built(make(), figures, found, None)
    assert likeness_words(report) == "likeness 65 %, nothing left out"
    fallen = report.model_copy(update={"motion": report.motion.model_copy(update={"fell": True})})
    assert likeness_words(fallen) == "likeness 65 % until the fall, nothing left out until the fall"
    items = [Heard(id=0, item=item, asked="wave", state="accepted", reached=item < 1) for item in range(3)]
    scripted = fallen.model_copy(update={"targets": tuple(items)})
    assert likeness_words(scripted) == "likeness 65 % until the fall, left out: 2 of 3 items (not reached)"


def test_unknown_likeness_fails_where_one_is_asked_for(make: Callable[..., RunTrace], figures: RobotFigures) -> None:
    assert built(make(), figures, None, None).ok
    report = built(make(), figures, None, 0.1)
    assert not report.ok and "likeness unknown, at least 0.1 was asked for" in verdict(report)


def built(record: RunTrace, figures: RobotFigures, found: Likeness | None, least: float | None) -> Report:
    options = {} if least is None else {"min_likeness": least}
    info = RunInfo(robot="op3", driver="sim", source="walk.bvh", options=options, min_likeness=least)
    return build_report(record, info, figures, likeness=found)
