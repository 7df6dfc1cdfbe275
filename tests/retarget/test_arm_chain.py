from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.retarget.arm_chain import ArmChain

from .arm_robots import with_arms


@pytest.fixture(params=[1, 2, 3, 4, 6])
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    """The OP3 with arms of so many joints."""
    return load_robot(with_arms(tmp_path, request.param))


def test_hand_and_elbow_are_where_mujoco_has_them(robot: Robot) -> None:
    chain = ArmChain(robot)
    rng = np.random.default_rng(3)
    q = rng.uniform(chain.lower, chain.upper, (5, *chain.lower.shape))
    poses = chain.poses(q)
    data, hands = mujoco.MjData(robot.model), robot.config.hands
    assert hands is not None
    for row in range(5):
        data.qpos[robot.qpos_address] = robot.stand_pose
        data.qpos[robot.qpos_address[chain.joints]] = q[row]
        mujoco.mj_kinematics(robot.model, data)
        torso = data.xmat[robot.torso_id].reshape(3, 3)
        for side, hand in enumerate((hands.left, hands.right)):
            body = robot.model.body(hand.body).id
            point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ np.asarray(hand.point)
            np.testing.assert_allclose(poses.hand[row, side], torso.T @ (point - data.xpos[robot.torso_id]), atol=1e-9)


def test_derivatives_are_those_of_the_directions(robot: Robot) -> None:
    chain = ArmChain(robot)
    q = np.random.default_rng(4).uniform(chain.lower, chain.upper)
    here, small = chain.poses(q), 1e-6
    for joint in range(q.shape[1]):
        there = chain.poses(q + small * (np.arange(q.shape[1]) == joint))
        np.testing.assert_allclose((there.upper - here.upper) / small, here.upper_jacobian[:, joint], atol=1e-4)
        np.testing.assert_allclose((there.fore - here.fore) / small, here.fore_jacobian[:, joint], atol=1e-4)


@pytest.mark.parametrize(("joints", "elbow"), [(1, False), (2, False), (3, True), (4, True), (6, True)])
def test_the_elbow_is_the_joint_that_divides_the_arm(tmp_path: Path, joints: int, elbow: bool) -> None:
    chain = ArmChain(load_robot(with_arms(tmp_path, joints)))
    assert chain.has_elbow is elbow
    if elbow:
        np.testing.assert_allclose(chain.lengths, [[0.0904, 0.1120]] * 2, atol=1e-3)


def test_directions_are_those_of_the_links(op3: Robot) -> None:
    """The elbow's anchor is 19 mm ahead of the arm: seen from there the forearm was tilted by 10 degrees."""
    chain = ArmChain(op3)
    straight = chain.poses(np.zeros((2, 3)))
    np.testing.assert_allclose(straight.upper, [[0, 1, 0], [0, -1, 0]], atol=0.02)
    np.testing.assert_allclose(straight.fore, [[0, 1, 0], [0, -1, 0]], atol=0.02)


def test_sides_mirror_each_other(op3: Robot) -> None:
    chain = ArmChain(op3)
    q = np.random.default_rng(5).uniform(chain.lower[0], chain.upper[0])
    poses = chain.poses(np.stack([q, -q]))
    np.testing.assert_allclose(poses.hand[0] * [1, -1, 1], poses.hand[1], atol=1e-9)
    np.testing.assert_allclose(poses.fore[0] * [1, -1, 1], poses.fore[1], atol=1e-9)


def test_a_robot_without_hands_is_refused_by_name(op3: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(op3, "config", op3.config.model_copy(update={"hands": None}))
    with pytest.raises(RetargetError, match=r"op3\.yaml: field hands: missing, expected body and point"):
        ArmChain(op3)


def test_arms_of_unequal_joints_are_counted(op3: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot with hands and one elbow less was told that "field hands is required", and not which arm has how many."""
    right = op3.mapping.right_arm
    assert right is not None
    less = type(right).model_validate({part: joint for part, joint in right if part != "el"})
    monkeypatch.setattr(op3, "mapping", op3.mapping.model_copy(update={"right_arm": less}))
    says = r"field mapping: left_arm has 3 joints \(sho_pitch, sho_roll, el\), right_arm 2 \(sho_pitch, sho_roll\), exp"
    with pytest.raises(RetargetError, match=says) as error:
        ArmChain(op3)
    assert "hands" not in str(error.value)
