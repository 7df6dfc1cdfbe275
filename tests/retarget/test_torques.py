from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.schedule import Schedule
from flexmotion.retarget.state import RetargetState

from .conftest import RATE

ROWS = 60


@pytest.fixture
def state(retargeter: Retargeter) -> RetargetState:
    return retargeter.layout.view(retargeter.standing())


@pytest.fixture
def schedule(retargeter: Retargeter) -> Schedule:
    ticks = np.arange(ROWS, dtype=float)
    return Schedule.of(retargeter.body.home_feet, -1e9, 0.0, [], ticks, np.full(ROWS, 0.5), RATE, retargeter.swings)


def repeated(row: np.ndarray) -> np.ndarray:
    return np.broadcast_to(row, (ROWS, *row.shape)).copy()


def test_at_rest_torques_are_those_of_a_single_pose(
    retargeter: Retargeter, state: RetargetState, schedule: Schedule
) -> None:
    base, q = repeated(state.base[0]), repeated(state.q[0])
    qd, qdd, torque = retargeter.torques.of(state, schedule, base, q)
    assert (qd == 0.0).all() and (qdd == 0.0).all()
    still = np.zeros((1, 6))
    rest = np.zeros((1, retargeter.robot.n))
    one, _ = retargeter.body.dynamics.inverse(
        base[:1], still, still, q[:1], rest, rest, schedule.feet[:1], schedule.share[:1]
    )
    np.testing.assert_allclose(torque, repeated(one[0]), atol=1e-9)


def test_speed_and_acceleration_are_those_of_the_joints(
    retargeter: Retargeter, state: RetargetState, schedule: Schedule
) -> None:
    """A constant acceleration, which began two rows before the plan."""
    t = np.arange(-2, ROWS) / RATE
    line = state.q[0] + 0.5 * t[:, None] ** 2
    state.q = line[1::-1]
    qd, qdd, _ = retargeter.torques.of(state, schedule, repeated(state.base[0]), line[2:])
    inner = slice(None, -1)
    np.testing.assert_allclose(qd[inner], repeated(np.ones(retargeter.robot.n))[inner] * t[2:-1, None], atol=1e-9)
    np.testing.assert_allclose(qdd[inner], 1.0, atol=1e-6)


def test_a_turning_torso_loads_the_legs_as_it_would_turned_elsewhere(
    retargeter: Retargeter, state: RetargetState, schedule: Schedule
) -> None:
    """Base rates are differences of quaternions: their sign must not matter."""
    t = np.arange(-2, ROWS) / RATE
    turn = Rotation.from_euler("z", 0.2 * np.sin(8.0 * t)[:, None]) * Rotation.from_quat(
        state.base[0, 3:], scalar_first=True
    )
    line = np.hstack([np.broadcast_to(state.base[0, :3], (len(t), 3)), turn.as_quat(scalar_first=True)])
    flipped = line.copy()
    flipped[::3, 3:] *= -1.0
    q = repeated(state.q[0])
    torques = []
    for base in (line, flipped):
        state.base = base[1::-1]
        torques.append(retargeter.torques.of(state, schedule, base[2:], q)[2])
    np.testing.assert_allclose(torques[0], torques[1], atol=1e-9)
    assert np.ptp(torques[0], axis=0).max() > 0.01
