"""Plans against the envelope: a robot whose servos have half the torque fails, and where, when, by how much."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
from rich.console import Console

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.retarget.servo_lag import allowed_lag, servo_lag
from flexmotion.streamer.checks.torque_check import TorqueCheck, check_trajectory
from flexmotion.streamer.checks.torque_text import render_check
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.planning.offline import Trajectory, retarget_offline


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def clip(robot: Robot) -> Trajectory:
    """The shipped clip: a walk."""
    return retarget_offline(robot, ClipSource(choose_motion()), load_stream())


def halved(robot: Robot) -> Robot:
    weak = copy.copy(robot)
    weak.stall_torque, weak.usable_torque = 0.5 * robot.stall_torque, 0.5 * robot.usable_torque
    weak.back_emf = 0.5 * robot.back_emf
    return weak


def flat(robot: Robot, seconds: float = 2.0) -> Trajectory:
    """A motion without torque and speed, whose arrays a test fills."""
    rows = int(seconds * robot.rate_hz)
    joints, nothing = np.zeros((rows, robot.n)), np.zeros((rows, 2))
    return Trajectory(
        rate_hz=robot.rate_hz,
        source_s=np.arange(rows) / robot.rate_hz,
        q=joints,
        qd=joints.copy(),
        qdd=joints,
        torque=joints.copy(),
        contacts=np.ones((rows, 2), np.bool_),
        feet=np.zeros((rows, 2, 4)),
        base=np.zeros((rows, 7)),
        com=np.zeros((rows, 3)),
        zmp=nothing,
        dcm=nothing,
        hand_error=nothing,
        human_steps=0,
        steps=0,
        inserted=0,
        dropped=0,
        repairs={},
        retarget_s=[],
    )


def text_of(check: TorqueCheck) -> str:
    console = Console(width=200)
    with console.capture() as capture:
        console.print(render_check(check))
    return capture.get()


def test_shipped_clip_passes_on_the_shipped_robot(clip: Trajectory, robot: Robot) -> None:
    check = check_trajectory(clip, robot, "default")
    assert check.ok and check.failed == ()
    assert text_of(check).startswith("PASS op3, default")


def test_half_the_torque_fails_and_says_where_when_how_long_and_by_how_much(clip: Trajectory, robot: Robot) -> None:
    check = check_trajectory(clip, halved(robot), "default")
    assert not check.ok
    name = check.failed[0]
    joint = check.joints[name]
    assert joint.worst is not None
    assert joint.lag_rad > check.lag_allowed_rad
    rows = slice(
        round(joint.worst.from_s * robot.rate_hz), round((joint.worst.from_s + joint.worst.for_s) * robot.rate_hz)
    )
    load = Envelope.of(halved(robot)).load(clip.torque, clip.qd)[:, robot.index(name)]
    assert (load[rows] > 1).all() and load[rows].max() == pytest.approx(joint.worst.peak_load, rel=1e-5)
    content = json.loads(check.json_text())
    assert content["schema"] == "flexmotion.torque/1" and content["failed"][0] == name
    text = text_of(check)
    assert text.startswith("FAIL")
    assert f"{name}: needs {joint.worst.peak_torque_nm:.2f} N·m of {joint.worst.limit_nm:.2f}" in text
    assert f"at {joint.worst.from_s:.2f} s for {1e3 * joint.worst.for_s:.0f} ms" in text


def test_a_low_supply_costs_lag(clip: Trajectory, robot: Robot) -> None:
    nominal, low = (check_trajectory(clip, robot, "default", supply) for supply in (None, 10.2))
    assert low.supply_v == 10.2 and "at 10.2 V" in text_of(low)
    assert low.joints["l_knee"].lag_rad > nominal.joints["l_knee"].lag_rad


def test_worst_moment_within_the_envelope(robot: Robot) -> None:
    easy = flat(robot)
    easy.torque[100, robot.index("r_knee")] = 4.0
    check = check_trajectory(easy, robot, "made up")
    knee = check.joints["r_knee"]
    assert check.ok and check.worst == "r_knee"
    assert (knee.peak_at_s, knee.peak_torque_nm, knee.peak_limit_nm) == pytest.approx((0.8, 4.0, 4.1))
    assert (knee.peak_excess_nm, knee.stretches, knee.worst, knee.lag_rad) == (pytest.approx(-0.1), 0, None, 0.0)


def test_ticks_outside_do_not_fail_a_joint_that_follows_all_the_same(robot: Robot) -> None:
    peak = flat(robot)
    peak.torque[5:8, 0], peak.qd[5:8, 0] = 3.5, 1.0
    check = check_trajectory(peak, robot, "made up")
    joint = check.joints[robot.joint_names[0]]
    assert check.ok and joint.worst is not None
    assert (joint.worst.from_s, joint.worst.for_s) == pytest.approx((0.04, 0.024))
    assert 0.0 < joint.lag_rad < check.lag_allowed_rad
    peak.torque[5:60, 0], peak.qd[5:60, 0] = 3.5, 1.0
    longer = check_trajectory(peak, robot, "made up")
    assert not longer.ok and longer.failed == (robot.joint_names[0],)


def test_allowed_lag_is_the_clearance_seen_from_the_knee(robot: Robot) -> None:
    assert allowed_lag(robot) == pytest.approx(robot.gait.clearance / 0.11)


def test_a_servo_that_overheats_within_ten_minutes_fails(robot: Robot) -> None:
    hot = flat(robot)
    hot.torque[:, 3] = 3.0  # never outside the envelope: it stands
    check = check_trajectory(hot, robot, "made up")
    joint = check.joints[robot.joint_names[3]]
    assert joint.over_share == 0.0 and joint.lasts_s is not None
    assert joint.lasts_s < 600 and joint.duty < 1.0
    assert check.failed == (robot.joint_names[3],)
    assert f"it may do this for {100 * joint.duty:.0f} % of the time" in text_of(check)


def test_a_lag_grows_by_what_is_lacking_over_the_inertia(robot: Robot) -> None:
    """A servo that gives nothing: the joint stays behind by half of torque over inertia times time squared."""
    rows, dead = 10, Envelope.of(robot).at(temperature=200.0)
    torque = np.zeros((rows, robot.n))
    torque[:, 0] = 1.0
    lag = servo_lag(robot, dead, torque, np.zeros_like(torque))
    seconds = rows / robot.rate_hz
    inertia = 1.0 / robot.model.dof_invweight0[robot.dof_address[0]]
    assert lag[-1, 0] == pytest.approx(0.5 * seconds**2 / inertia, rel=0.06)
    assert (lag[:, 1:] == 0).all()


def test_a_lag_is_made_up_for_once_torque_is_there(robot: Robot) -> None:
    torque, speed = np.zeros((250, robot.n)), np.zeros((250, robot.n))
    torque[10:20], speed[10:20] = 3.5, 1.0
    lag = servo_lag(robot, Envelope.of(robot), torque, speed)
    assert (lag[19] > 0.01).all()
    assert np.abs(lag[-1]).max() < 1e-3
