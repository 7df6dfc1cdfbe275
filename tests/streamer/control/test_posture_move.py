from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.posture_move import PostureMove
from flexmotion.streamer.control.reference import Reference


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture
def move(op3: Robot) -> PostureMove:
    return PostureMove(op3, Retargeter(op3, load_stream()).body.dynamics)


def play(move: PostureMove, robot: Robot, extra: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, qd and torque of every tick of the move and of `extra` ticks after it, (T, n) each."""
    reference, rows = Reference(robot.n), []
    while not move.done or extra:
        extra -= move.done
        move.step(reference)
        assert not reference.balanced
        rows.append([reference.q.copy(), reference.qd.copy(), reference.torque.copy()])
    q, qd, torque = (np.array(column) for column in zip(*rows, strict=True))
    return q, qd, torque


def test_from_start_to_goal_from_rest_to_rest(move: PostureMove, op3: Robot) -> None:
    move.begin(op3.stand_pose, op3.rest_pose, least_s=2.0, speed=1.6)
    q, qd, _ = play(move, op3)
    np.testing.assert_allclose(q[0], op3.stand_pose)
    np.testing.assert_allclose(q[-1], op3.rest_pose)
    assert np.abs(qd[0]).max() < 0.01 and not qd[-1].any()
    np.testing.assert_allclose(np.diff(q, axis=0) * op3.rate_hz, qd[:-1], atol=1e-9)
    assert len(q) >= 2.0 * op3.rate_hz


@pytest.mark.parametrize("speed", [0.4, 0.8])
def test_no_joint_is_faster_than_allowed(move: PostureMove, op3: Robot, speed: float) -> None:
    move.begin(op3.lower, op3.upper, least_s=0.1, speed=speed)
    _, qd, _ = play(move, op3)
    assert 0.99 * speed < np.abs(qd).max() <= speed + 1e-9


def test_the_torque_holds_the_robot_up_and_does_not_jump(move: PostureMove, op3: Robot) -> None:
    move.begin(op3.stand_pose, op3.rest_pose, least_s=2.0, speed=1.6)
    _, _, torque = play(move, op3)
    knees = [op3.index("l_knee"), op3.index("r_knee")]
    assert np.abs(torque[:, knees]).min() > 0.05
    assert np.abs(torque).max() < op3.usable_torque.min()
    # Linear between knots of an upright robot: the weight moves slowly.
    assert np.abs(np.diff(torque, axis=0)).max() < 0.05
    np.testing.assert_allclose(torque[:, knees[0]], -torque[:, knees[1]], atol=0.02)


def test_nothing_is_solved_during_the_move(move: PostureMove, op3: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every tenth tick of a move solved the dynamics and took three times as long as other ticks."""
    move.begin(op3.stand_pose, op3.rest_pose, least_s=2.0, speed=1.6)
    monkeypatch.setattr(move.dynamics, "inverse", lambda *_: pytest.fail("solved while the robot moves"))
    _, _, torque = play(move, op3)
    assert np.ptp(torque, axis=0).max() > 0.1


def test_a_move_without_distance_takes_the_least_time(move: PostureMove, op3: Robot) -> None:
    move.begin(op3.stand_pose, op3.stand_pose, least_s=0.5, speed=0.8)
    q, qd, _ = play(move, op3, extra=0)
    assert len(q) == np.ceil(0.5 * op3.rate_hz)
    assert not qd.any()


def test_a_new_move_begins_in_the_middle_of_another(move: PostureMove, op3: Robot) -> None:
    reference = Reference(op3.n)
    move.begin(op3.stand_pose, op3.rest_pose, least_s=1.0, speed=1.6)
    for _ in range(40):
        move.step(reference)
    start = reference.q.copy()
    move.begin(start, op3.stand_pose, least_s=1.0, speed=1.6)
    assert not move.done
    move.step(reference)
    np.testing.assert_allclose(reference.q, start)
