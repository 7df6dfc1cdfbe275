from __future__ import annotations

import mujoco
import numpy as np

from flexmotion.configs.robot import Robot
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.retarget.arm_clearance import BodyClearance

FOLDED = np.array([[-0.45, 1.1, -1.89], [0.45, -1.1, 1.89]])
"""Forearms folded before the chest: they touched the torso, and a joint counted as blocked."""


def touches(robot: Robot, arms: np.ndarray) -> np.ndarray:
    """Whether the left and the right forearm touch torso or thighs in the stand pose, (2,) bool."""
    data, chain = mujoco.MjData(robot.model), ArmChain(robot)
    data.qpos[robot.qpos_address] = robot.stand_pose
    data.qpos[robot.qpos_address[chain.joints]] = arms
    mujoco.mj_forward(robot.model, data)
    pairs = [{robot.model.geom(contact.geom1).name, robot.model.geom(contact.geom2).name} for contact in data.contact]
    body = {"torso", "l_thigh", "r_thigh"}
    return np.array([any(f"{side}_forearm" in pair and pair & body for pair in pairs) for side in "lr"])


def test_every_forearm_that_touches_torso_or_thigh_costs(op3: Robot) -> None:
    chain = ArmChain(op3)
    clearance = BodyClearance(op3, chain)
    near = FOLDED + np.random.default_rng(6).uniform(-0.5, 0.5, (100, 2, 3))
    depth, _ = clearance.residual(chain.poses(near), np.zeros(100))
    touching = np.array([touches(op3, pose) for pose in near])
    assert touching.sum() > 10
    assert (depth.max(axis=2) > 0.0)[touching].all()


def test_arms_away_from_the_body_cost_nothing(op3: Robot) -> None:
    chain = ArmChain(op3)
    free = np.stack([op3.stand_pose[chain.joints], np.zeros((2, 3))])
    depth, slope = BodyClearance(op3, chain).residual(chain.poses(free), np.zeros(2))
    assert not depth.any() and slope.shape == (2, 2, 3, 3)


def test_the_slope_is_that_of_the_depth(op3: Robot) -> None:
    chain = ArmChain(op3)
    clearance = BodyClearance(op3, chain)
    depth, slope = clearance.residual(chain.poses(FOLDED), np.array(0.3))
    assert depth.max() > 0.0
    step = 1e-5
    for joint in (1, 2):  # shoulder pitch moves the shoulder too
        moved, _ = clearance.residual(chain.poses(FOLDED + step * (np.arange(3) == joint)), np.array(0.3))
        np.testing.assert_allclose((moved - depth) / step, slope[:, joint], atol=12.0, rtol=0.2)


def test_thighs_come_nearer_as_the_trunk_leans(op3: Robot) -> None:
    chain = ArmChain(op3)
    clearance = BodyClearance(op3, chain)
    low = chain.poses(np.array([[-0.52, 1.24, -1.49], [0.38, -1.24, 1.49]]))
    upright, bent = (clearance.residual(low, np.array(lean))[0].max() for lean in (0.0, 0.8))
    assert bent > upright
