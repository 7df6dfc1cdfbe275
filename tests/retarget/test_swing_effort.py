from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot import Robot
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.swing_effort import ROWS, SwingEffort
from flexmotion.retarget.zmp_roll import steady_hips
from flexmotion.spatial.transitions import minimum_jerk

TRAVEL, SECONDS = np.array([[0.18, 0.03, 0.2]]), np.array([0.42])


@pytest.fixture(scope="module")
def effort(op3: Robot, retargeter: Retargeter) -> SwingEffort:
    return SwingEffort(op3, retargeter.body.legs, retargeter.omega)


def swing(effort: SwingEffort) -> tuple[np.ndarray, np.ndarray]:
    return minimum_jerk(effort.phase)[None], 0.02 * np.sin(np.pi * effort.phase)[None] ** 2


def test_torques_are_those_of_the_robot_s_model(effort: SwingEffort, op3: Robot) -> None:
    """Against MuJoCo's inverse dynamics of the whole robot, without dry friction."""
    progress, lift = swing(effort)
    q, torso, rotation = (part[0] for part in effort._joints(progress, lift, TRAVEL, SECONDS))
    columns, dt = effort.leg.indices, SECONDS[0] / (ROWS - 1)
    model = op3.compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    rows = np.zeros((ROWS, model.nq))
    rows[:, :3], rows[:, 3:7] = torso, Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    rows[:, op3.qpos_address] = op3.stand_pose
    rows[:, op3.qpos_address[columns]] = q
    moves = np.zeros((ROWS - 1, model.nv))
    for k, move in enumerate(moves):
        mujoco.mj_differentiatePos(model, move, dt, rows[k], rows[k + 1])
    expected = []
    for k in range(1, ROWS - 1):
        data.qpos[:], data.qvel[:] = rows[k], 0.5 * (moves[k] + moves[k - 1])
        data.qacc[:] = (moves[k] - moves[k - 1]) / dt
        mujoco.mj_inverse(model, data)
        expected.append(data.qfrc_inverse[op3.dof_address[columns]].copy())
    asked, limits = effort.asked(progress, lift, TRAVEL, SECONDS)[0], effort.limits
    speed = asked[:, 2] * limits.speed
    friction = limits.friction * np.tanh(speed / 0.1)
    torque = asked[:, 1] * limits.stall - limits.back_emf * speed - friction
    assert np.abs(torque - np.array(expected)).max() < 0.01 * np.abs(expected).max()


def test_a_faster_swing_asks_for_more_and_one_out_of_reach_is_not_a_number(effort: SwingEffort) -> None:
    progress, lift = swing(effort)
    most = [np.abs(effort.asked(progress, lift, TRAVEL, np.array([s]))).max() for s in (0.3, 0.4, 0.6)]
    assert most[0] > most[1] > most[2]
    assert np.isnan(effort.asked(progress, lift, 3.0 * TRAVEL, SECONDS)).any()


def test_braking_has_more_torque_than_driving(effort: SwingEffort) -> None:
    progress, lift = swing(effort)
    asked, limits = effort.asked(progress, lift, TRAVEL, SECONDS)[0], effort.limits
    speed = asked[:, 2] * limits.speed
    torque = asked[:, 1] * limits.stall - limits.back_emf * speed
    given = torque / np.where(torque == 0.0, 1.0, asked[:, 0])
    brakes = torque * speed < -0.5 * limits.usable
    drives = torque * speed > 0.5 * limits.usable
    assert brakes.any() and drives.any()
    assert given[brakes].min() > 1.5 * given[drives].max()


@pytest.mark.parametrize("right", [False, True])
def test_a_swing_over_given_hips_asks_what_the_steady_walk_does_over_the_same(effort: SwingEffort, right: bool) -> None:
    progress, lift = swing(effort)
    _, torso, _ = effort._joints(progress, lift, TRAVEL, SECONDS)
    foot = (progress - 0.5)[..., None] * TRAVEL[:, None]
    leg, gait = effort.leg, effort.gait
    soles = np.dstack([foot[..., :2] + (leg.hip + leg.sole)[:2], lift, foot[..., 2]])
    still = steady_hips(effort.phase, np.zeros(1), SECONDS, gait.double_support_min_s, effort.omega)
    turned = 0.5 * TRAVEL[0, 2] * still[0]
    hips = np.dstack([torso[..., :2], np.full_like(lift, gait.walk_hip_height), turned[None]])
    if right:
        soles, hips = soles * [1.0, -1.0, 1.0, -1.0], hips * [1.0, -1.0, 1.0, -1.0]
    found = effort.asked_over(np.array([right]), soles, hips, SECONDS)
    np.testing.assert_allclose(found, effort.asked(progress, lift, TRAVEL, SECONDS), atol=1e-9)
