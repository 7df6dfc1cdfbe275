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
    qd, qdd, torque = retargeter.torques.of(state, schedule, base, q, ROWS)
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
    qd, qdd, _ = retargeter.torques.of(state, schedule, repeated(state.base[0]), line[2:], ROWS)
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
        torques.append(retargeter.torques.of(state, schedule, base[2:], q, ROWS)[2])
    np.testing.assert_allclose(torques[0], torques[1], atol=1e-9)
    assert np.ptp(torques[0], axis=0).max() > 0.01


@pytest.mark.parametrize("rows", [ROWS - 1, ROWS])
def test_a_robot_that_comes_to_rest_needs_fewer_rows(
    retargeter: Retargeter, state: RetargetState, schedule: Schedule, rows: int
) -> None:
    """Its torques are the same as from every second row, whatever the last row is."""
    knees = [leg.indices[3] for leg in retargeter.body.legs]
    t = np.arange(-2, rows)[:, None] / RATE
    q = np.tile(state.q[0], (rows + 2, 1))
    q[:, knees] += 0.1 * np.exp(-8.0 * t)
    state.q = q[1::-1]
    part = Schedule(schedule.feet[:rows], schedule.contacts[:rows], schedule.share[:rows], schedule.walking[:rows])
    base = repeated(state.base[0])[:rows]
    fine, coarse = (retargeter.torques.of(state, part, base, q[2:], quiet)[2] for quiet in (rows, 12))
    np.testing.assert_array_equal(coarse[:12], fine[:12])
    assert np.abs(fine - fine[-1]).max() > 0.1
    np.testing.assert_allclose(coarse, fine, atol=0.005)
    np.testing.assert_array_equal(coarse[-1], fine[-1])
