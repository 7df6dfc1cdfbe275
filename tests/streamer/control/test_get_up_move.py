"""The robot gets up step by step, and a step that does not bring it where it should ends it."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.streamer.control.get_up_move import GetUpMove
from flexmotion.streamer.control.reference import Reference


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


def middle(move: GetUpMove) -> np.ndarray:
    """Roll and pitch in the middle of what the present step asks for."""
    pitch = float(np.mean(move._steps[move._number].pitch))
    return np.array([0.0, pitch] if abs(pitch) <= np.pi / 2 else [np.pi, np.sign(pitch) * np.pi - pitch])


@pytest.mark.parametrize("side", ["front", "back"])
def test_it_goes_through_all_poses_without_a_jump(op3: Robot, side: str) -> None:
    move, reference = GetUpMove(op3), Reference(op3.n)
    limp = np.clip(op3.stand_pose + 0.5, op3.lower, op3.upper)
    move.begin(limp, op3.get_up.steps[side])
    before, fastest = limp, 0.0
    while not move.done and move.failed is None:
        move.step(reference, middle(move))
        step = np.abs(reference.q - before) * op3.rate_hz
        assert np.allclose(step, np.abs(reference.qd), atol=1e-6)
        fastest, before = max(fastest, float((step / op3.no_load_speed).max())), reference.q.copy()
        assert not reference.torque.any() and not reference.balanced
    assert move.done and fastest <= 0.9 + 1e-9
    assert np.allclose(reference.q, op3.get_up.steps[side][-1].q)


def test_the_way_from_where_the_limp_joints_lie_is_slow(op3: Robot) -> None:
    move, reference = GetUpMove(op3), Reference(op3.n)
    move.begin(op3.upper.copy(), op3.get_up.steps["front"])
    for _ in range(50):
        move.step(reference, np.array([0.0, 1.5]))
        assert np.abs(reference.qd).max() <= 2 * op3.safety.soft_start_speed + 1e-9


def test_a_step_waits_for_the_torso_and_then_gives_up(op3: Robot) -> None:
    move, reference = GetUpMove(op3), Reference(op3.n)
    first = op3.get_up.steps["back"][0]
    move.begin(first.q.copy(), op3.get_up.steps["back"])
    upright, ticks = np.zeros(2), 0
    while move.failed is None:
        move.step(reference, upright)
        ticks += 1
    assert ticks / op3.rate_hz == pytest.approx(first.seconds + first.hold_s + first.wait_s, abs=0.05)
    assert move.failed == "after step 1 of 10 (draw the legs up) the torso is pitched by 0°, expected -115° to -74°"


@pytest.mark.parametrize("number", [0, 6])
def test_no_step_ends_by_a_tilt_that_is_not_measured(op3: Robot, number: int) -> None:
    """While its IMU was silent a robot that lay was judged by the tilt of its reference: upright, and up."""
    move, reference = GetUpMove(op3), Reference(op3.n)
    steps = op3.get_up.steps["front"]
    move.begin(steps[0].q.copy(), steps)
    while move._number < number:
        move.step(reference, middle(move))
    while move.failed is None:
        move.step(reference, None)
        assert not move.done and move._number == number
    assert move.failed == (
        f"after step {number + 1} of 7 ({steps[number].name}) the IMU is silent: it is not known how the robot lies"
    )


def test_a_robot_that_rolls_onto_its_side_gives_up(op3: Robot) -> None:
    move, reference = GetUpMove(op3), Reference(op3.n)
    move.begin(op3.get_up.steps["front"][0].q.copy(), op3.get_up.steps["front"])
    while move.failed is None:
        move.step(reference, np.array([1.4, 0.1]))
    assert "it leans to its side by" in move.failed


def test_a_robot_that_fell_while_its_arms_were_soft_gets_up_with_stiff_ones(op3: Robot) -> None:
    """It pushed itself up with the stiffness of the plan that was played before the fall."""
    move, reference = GetUpMove(op3), Reference(op3.n)
    reference.stiffness[:] = 0.3
    move.begin(op3.stand_pose.copy(), op3.get_up.steps["back"])
    move.step(reference, middle(move))
    assert (reference.stiffness == 1.0).all()
