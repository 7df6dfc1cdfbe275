from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.retarget import swing
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.swing import Swings
from flexmotion.retarget.swing_effort import SwingEffort
from flexmotion.retarget.swing_shapes import Shape

poses = st.tuples(*[st.floats(-0.1, 0.1)] * 2, st.just(0.0), st.floats(-0.4, 0.4)).map(np.array)
PHASE = np.linspace(0.0, 1.0, 501)
sides = st.sampled_from([0, 1])
START = np.zeros(4)


def mirrored(pose: np.ndarray) -> np.ndarray:
    return pose * [1.0, -1.0, 1.0, -1.0]


@given(side=sides, start=poses, target=poses)
def test_the_path_starts_and_ends_at_rest(swings: Swings, side: int, start: np.ndarray, target: np.ndarray) -> None:
    path = swings.path(PHASE, side, start, target)
    np.testing.assert_allclose(path[[0, -1]], [start, target], atol=1e-12)
    speed = np.gradient(path, PHASE, axis=0)
    assert np.abs(speed[[0, -1]]).max() < 0.05 * max(np.abs(speed).max(), 1e-9)
    assert path[:, 2].min() >= -1e-9


@given(side=sides, target=poses)
def test_the_foot_is_as_high_as_the_floor_asks_and_not_much_higher(
    swings: Swings, side: int, target: np.ndarray
) -> None:
    height = swings.path(PHASE, side, START, target)[:, 2]
    assert swings.clearance * 0.97 <= height.max() <= swings.clearance * 1.25


@given(target=poses)
def test_the_right_foot_is_the_mirror_image_of_the_left(swings: Swings, target: np.ndarray) -> None:
    left, right = swings.path(PHASE, 0, START, target), swings.path(PHASE, 1, START, mirrored(target))
    np.testing.assert_allclose(mirrored(right), left, atol=1e-12)
    times = swings.shortest_s(0, START, target), swings.shortest_s(1, START, mirrored(target))
    assert times[0] == pytest.approx(times[1])


def test_the_path_is_constant_beyond_its_ends(swings: Swings) -> None:
    start, target = np.array([0.0, 0.1, 0.0, 0.0]), np.array([0.1, 0.1, 0.0, 0.3])
    np.testing.assert_array_equal(
        swings.path(np.array([-1.0, 2.0]), 0, start, target), swings.path(np.array([0.0, 1.0]), 0, start, target)
    )


def test_long_turning_and_sideward_swings_take_longer(swings: Swings) -> None:
    near = swings.shortest_s(0, START, np.array([0.1, 0.0, 0.0, 0.0]))
    for further in ([0.2, 0.0, 0.0, 0.0], [0.1, 0.08, 0.0, 0.0], [0.1, 0.0, 0.0, 0.6], [-0.2, 0.0, 0.0, 0.0]):
        assert swings.shortest_s(0, START, np.array(further)) > 1.03 * near
    beyond = [swings.shortest_s(0, START, np.array([x, 0.0, 0.0, 0.0])) for x in (0.26, 0.4, 0.6)]
    assert beyond[0] < beyond[1] < beyond[2] < np.inf


@given(side=sides, target=poses, seconds=st.floats(0.3, 0.6))
def test_a_target_out_of_reach_is_shortened_ahead_to_one_in_time(
    swings: Swings, side: int, target: np.ndarray, seconds: float
) -> None:
    start = np.array([-0.1, 0.0, 0.0, 0.0])
    found = swings.farthest(side, start, target, seconds)
    if swings.shortest_s(side, start, target) <= seconds:
        np.testing.assert_array_equal(found, target)
        return
    yaw = 0.5 * target[3]
    less = target[:2] - found[:2]
    assert abs(np.cos(yaw) * less[1] - np.sin(yaw) * less[0]) < 1e-9 and found[3] == target[3]
    aside_alone = np.cos(yaw) * (found - start)[0] + np.sin(yaw) * (found - start)[1]
    assert swings.shortest_s(side, start, found) <= seconds + 1e-6 or abs(aside_alone) < 1e-9


def test_a_stride_is_half_of_what_a_foot_travels_in_its_time(swings: Swings) -> None:
    for seconds in (0.34, 0.4, 0.48):
        for backward in (False, True):
            travel = 2.0 * swings.stride(seconds, backward) * (-1.0 if backward else 1.0)
            assert swings.shortest_s(0, START, np.array([travel, 0.0, 0.0, 0.0])) == pytest.approx(seconds, abs=1e-3)
    assert swings.stride(0.1) == 0.0
    assert swings.stride(swings.least_s) < swings.longest_stride < swings.stride(1.0)


def test_equal_robots_share_their_swings_and_others_do_not(retargeter: Retargeter, op3: Robot) -> None:
    legs, omega = retargeter.body.legs, retargeter.omega
    assert Swings.of(load_robot("op3"), legs, omega) is retargeter.swings
    weak = load_robot("op3")
    weak.usable_torque = 0.7 * op3.usable_torque
    weak.stall_torque = 0.7 * op3.stall_torque
    weaker = Swings.of(weak, legs, omega)
    assert weaker.stride(0.4) < 0.8 * retargeter.swings.stride(0.4)


def test_servos_that_cannot_swing_a_leg_are_refused(retargeter: Retargeter) -> None:
    weak = load_robot("op3")
    weak.usable_torque = weak.stall_torque = 0.02 * weak.usable_torque
    with pytest.raises(RetargetError, match=r"op3\.yaml: .* gait\.clearance .* gait\.walk_hip_height"):
        Swings.of(weak, retargeter.body.legs, retargeter.omega)


@pytest.mark.parametrize(("fail", "walks"), [({7}, 7), ({2}, 2), ({4, 5, 6}, 4), ({0}, 0)])
def test_a_shape_that_is_not_found_bounds_the_swings_and_refuses_no_robot(
    retargeter: Retargeter, monkeypatch: pytest.MonkeyPatch, fail: set[int], walks: int
) -> None:
    """Went wrong: shapes are found from a long travel down; where one failed on the way, the robot was refused."""
    lengths = np.linspace(0.1, 1.0, 10)

    def found(effort: SwingEffort, travel: np.ndarray, near: Shape | None = None) -> Shape | None:
        number = int(np.argmin(np.abs(lengths - travel[0])))
        return None if number in fail else Shape(np.zeros(1), np.zeros(1), float(number))

    monkeypatch.setattr(swing, "fastest_shape", found)
    effort = SwingEffort(retargeter.robot, retargeter.body.legs, retargeter.omega)
    assert [shape.seconds for shape in swing._outward(effort, lengths)] == list(range(walks))
