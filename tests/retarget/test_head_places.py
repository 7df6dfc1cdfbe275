"""Places of the head: what hips and trunk reach over feet that stand, and how long the ways take."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.retarget.head_places import THERE_M, HeadPlaces
from flexmotion.retarget.retargeter import Retargeter

ROBOT = load_robot("op3")
RETARGETER = Retargeter(ROBOT, load_stream())
PLACES, BODY = RETARGETER.head_places, RETARGETER.body
FEET, ARMS = BODY.home_feet, ROBOT.stand_pose[BODY.upper.joints]
ANYWHERE = st.tuples(st.floats(-0.15, 0.2), st.floats(-0.12, 0.12), st.floats(0.25, 0.5))
FAR = 10.0


def stood(channels: np.ndarray, feet: np.ndarray = FEET) -> tuple[np.ndarray, np.ndarray]:
    """Torso pose (7,) and joints (n,) of a robot that stands so."""
    whole = np.concatenate([channels, ARMS])[None]
    base, q, _, _ = BODY.solve(feet[None], feet[None, :, :2].mean(axis=1), whole, np.zeros(2), 8)
    return base[0], q[0]


def head(robot: Robot, base: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The head in the world by MuJoCo, (3,) [m]."""
    data = mujoco.MjData(robot.model)
    data.qpos[:7], data.qpos[robot.qpos_address] = base, q
    mujoco.mj_kinematics(robot.model, data)
    named = robot.config.head
    assert named is not None
    body = data.body(named.body)
    return np.asarray(body.xpos + body.xmat.reshape(3, 3) @ np.asarray(named.point))


@settings(max_examples=25, deadline=None)
@given(ANYWHERE)
def test_the_nearest_place_is_in_reach_itself_upright_enough_within_limits_and_touches_nothing(
    asked: tuple[float, float, float],
) -> None:
    found = PLACES.nearest(asked, FAR, FEET, ARMS)
    base, q = stood(found.channels)
    place = head(ROBOT, base, q)
    if found.moved is None:
        assert np.linalg.norm(place - asked) <= THERE_M + 1e-3
    again = PLACES.nearest((float(place[0]), float(place[1]), float(place[2])), 0.0, FEET, ARMS)
    assert again.moved is None
    legs = RETARGETER.legs
    assert (q[legs] > ROBOT.lower[legs]).all() and (q[legs] < ROBOT.upper[legs]).all()
    height, roll, pitch, yaw = found.channels
    assert ROBOT.gait.min_hip_height <= height <= ROBOT.gait.stand_hip_height
    assert np.arccos(np.cos(roll) * np.cos(pitch)) <= RETARGETER.bend.limit + 1e-9 and yaw == 0.0
    assert np.linalg.norm(BODY.dynamics.centre_of_mass(base[None], q[None])[0, :2]) < 2e-3
    data = mujoco.MjData(ROBOT.model)
    data.qpos[:7], data.qpos[ROBOT.qpos_address] = [*base[:2], 1.0, *base[3:]], q
    mujoco.mj_forward(ROBOT.model, data)
    assert data.ncon == 0


@settings(max_examples=15, deadline=None)
@given(ANYWHERE)
def test_what_it_reaches_on_one_side_it_reaches_on_the_other(asked: tuple[float, float, float]) -> None:
    gaps = []
    for sign in (1.0, -1.0):
        mirrored = (asked[0], sign * asked[1], asked[2])
        found = PLACES.nearest(mirrored, FAR, FEET, ARMS)
        gaps.append(np.linalg.norm(head(ROBOT, *stood(found.channels)) - mirrored))
    assert gaps[0] == pytest.approx(gaps[1], abs=2e-3)


def test_the_place_is_seen_from_the_middle_between_the_feet_wherever_they_stand() -> None:
    there = FEET.copy()
    cos, sin = np.cos(0.7), np.sin(0.7)
    there[:, :2] = there[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + (1.0, -2.0)
    there[:, 3] = 0.7
    asked = (0.05, 0.02, 0.39)
    here, turned = PLACES.nearest(asked, 0.0, FEET, ARMS), PLACES.nearest(asked, 0.0, there, ARMS)
    assert turned.channels == pytest.approx(here.channels + [0, 0, 0, 0.7], abs=1e-9)
    x, y, z = head(ROBOT, *stood(turned.channels, there)) - (1.0, -2.0, 0.0)
    assert (cos * x + sin * y, cos * y - sin * x, z) == pytest.approx(asked, abs=THERE_M)


def test_over_a_stride_it_stands_and_reaches_less() -> None:
    stride = FEET.copy()
    stride[0, 0], stride[1, 0] = 0.08, -0.08
    low = PLACES.nearest((0.03, 0.0, 0.4), 0.01, stride, ARMS)
    base, q = stood(low.channels, stride)
    assert head(ROBOT, base, q) == pytest.approx((0.03, 0.0, 0.4), abs=0.011)
    high = PLACES.nearest((0.01, 0.0, 0.46), FAR, stride, ARMS)
    assert high.moved is not None and high.channels[0] < 0.2


def test_a_height_alone_is_a_crouch_and_a_bow_where_the_hips_cannot_be_so_low() -> None:
    crouch = PLACES.nearest((None, None, 0.39), 0.0, FEET, ARMS)
    assert crouch.channels[1:] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    bow = PLACES.nearest((None, None, 0.345), 0.0, FEET, ARMS)
    assert bow.channels[1] == 0.0 and bow.channels[2] > 0.3
    assert PLACES.nearest((None, 0.02, 0.4), 0.0, FEET, ARMS).channels[2] == 0.0
    assert PLACES.nearest((0.05, None, 0.4), 0.0, FEET, ARMS).channels[1] == 0.0


def test_what_is_out_of_reach_names_the_nearest_place() -> None:
    """The answer to `send --head nan 0 0` did not say what was taken for the place."""
    with pytest.raises(
        ConfigError, match=r"out of reach while both feet stand; the nearest place is \[.*the tolerance 5 cm"
    ):
        PLACES.nearest((0.3, 0.0, 0.4), 0.05, FEET, ARMS)
    with pytest.raises(ConfigError, match=r"head: \[any, 0, 0\] m is out of reach"):
        PLACES.nearest((None, 0.0, 0.0), 0.05, FEET, ARMS)
    moved = PLACES.nearest((0.02, 0.06, 0.4), 0.05, FEET, ARMS)
    assert moved.moved is not None and "cm from there" in moved.moved


def test_a_way_takes_the_longer_the_more_the_legs_bend_and_a_rise_longer_than_a_descent() -> None:
    stand = np.array([0.203, 0.0, 0.0, 0.0])
    low, lower = (np.array([height, 0.0, 0.0, 0.0]) for height in (0.18, 0.125))
    down, far_down = (PLACES.seconds(stand, goal, FEET, ARMS) for goal in (low, lower))
    assert 0.2 <= down < far_down < 1.2
    assert far_down < PLACES.seconds(lower, stand, FEET, ARMS) < 2.0
    assert PLACES.seconds(low, low, FEET, ARMS) == pytest.approx(0.2)


def test_a_way_that_needs_too_much_however_long_it_takes_was_given_13_s_and_is_refused() -> None:
    """Servos a quarter as strong cannot hold the knees there for good."""
    weak = HeadPlaces(ROBOT, BODY, RETARGETER.bend)
    envelope = weak._envelope
    weak._envelope = replace(envelope, stall=0.25 * envelope.stall, usable=0.25 * envelope.usable)
    stand, low = np.array([0.203, 0.0, 0.0, 0.0]), np.array([0.125, 0.0, 0.0, 0.0])
    with pytest.raises(ConfigError, match="of their envelope on a way of 10 s .*nearer to the stand"):
        weak.seconds(stand, low, FEET, ARMS)


@settings(max_examples=15, deadline=None)
@given(ANYWHERE, st.floats(-0.8, 1.5))
def test_a_posture_is_found_again_for_other_arms_near_the_last_one_if_it_is_anywhere(
    asked: tuple[float, float, float], ahead: float
) -> None:
    """A search everywhere takes 50 ms, which a planner does not have every half second."""
    arms = ARMS + ahead * np.isin(np.arange(len(ARMS)), [0, 3]) * np.where(np.arange(len(ARMS)) < 3, -1.0, 1.0)
    last = PLACES.nearest(asked, FAR, FEET, ARMS)
    try:
        whole = PLACES.nearest(asked, FAR, FEET, arms)
    except ConfigError:
        assume(False)
    near = PLACES.nearest(asked, FAR, FEET, arms, last.channels)
    gaps = [float(np.linalg.norm(PLACES.place(one.channels, FEET, arms) - asked)) for one in (near, whole)]
    assert gaps[0] <= max(gaps[1], THERE_M) + 1e-6


def test_a_robot_whose_file_names_no_head_says_so(tmp_path: Path) -> None:
    content = yaml.safe_load((ROBOTS / "op3" / "op3.yaml").read_text(encoding="utf-8"))
    del content["head"]
    content["mjcf"] = str(ROBOTS / "op3" / "op3.xml")
    (tmp_path / "op3").mkdir()
    (tmp_path / "op3" / "op3.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    robot = load_robot(tmp_path / "op3")
    headless = HeadPlaces(robot, BODY, RETARGETER.bend)
    with pytest.raises(ConfigError, match="the robot file of op3 names no point of a head"):
        headless.nearest((0.02, 0.0, 0.4), FAR, FEET, ARMS)


def test_a_look_does_not_move_the_point_of_the_head() -> None:
    base, q = stood(np.array([0.17, 0.0, 0.2, 0.0]))
    before = head(ROBOT, base, q)
    q[list(ROBOT.chain("head").values())] = 0.7, -0.6
    assert head(ROBOT, base, q) == pytest.approx(before, abs=1e-9)
