from __future__ import annotations

import mujoco
import numpy as np
import pytest

from flexmotion.configs.robot import Robot
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.retarget.arm_distance import LEG, REST, ArmDistance

CLEAR = 1e-3
"""How much nearer forearms may be than their points tell [m]."""


@pytest.fixture(scope="module")
def distance(op3: Robot) -> ArmDistance:
    return ArmDistance(op3, ArmChain(op3))


def poses(robot: Robot, count: int) -> np.ndarray:
    """Arms that reach about the body and legs that step, (count, n) [rad]."""
    random, q = np.random.default_rng(3), np.tile(robot.stand_pose, (count, 1))
    arms = ArmChain(robot).joints
    q[:, arms] = random.uniform(
        [[-1.0, 0.5, -1.9], [-1.0, -1.45, 0.0]], [[1.0, 1.45, 0.0], [1.0, -0.5, 1.9]], (count, 2, 3)
    )
    q[:, 8:] += random.uniform(-0.3, 0.3, (count, 12))
    return np.clip(q, robot.lower, robot.upper)


def nearest_of_mujoco(robot: Robot, q: np.ndarray, side: str, legs: bool) -> float:
    """Distance of a forearm from legs or from the rest of the body, the other forearm included [m]."""
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:7], data.qpos[robot.qpos_address] = (0, 0, 0, 1, 0, 0, 0), q
    mujoco.mj_kinematics(model, data)
    found = []
    for geom in range(model.ngeom):
        body = model.body(model.geom_bodyid[geom]).name
        of_leg = any(part in body for part in ("hip", "knee", "ank"))
        of_arm = "sho" in body or body == f"{side}_el_link"
        if model.geom_contype[geom] and of_leg == legs and not of_arm and body != "world":
            fore = int(
                np.flatnonzero((model.geom_bodyid == model.body(f"{side}_el_link").id) & (model.geom_contype != 0))[0]
            )
            found.append(mujoco.mj_geomDistance(model, data, fore, geom, 0.1, None))
    return min(found)


def test_what_lacks_of_the_distance_agrees_with_mujoco(op3: Robot, distance: ArmDistance) -> None:
    q = poses(op3, 60)
    near = distance.nearest(q)
    assert (near.missing[REST] > 0.0).sum() > 5 and (near.missing[LEG] > 0.0).sum() > 5
    for k, row in enumerate(q):
        for arm, side in enumerate("lr"):
            for kind in (REST, LEG):
                wanted = distance.kept - nearest_of_mujoco(op3, row, side, kind == LEG)
                lacks = near.missing[kind, k, arm]
                if wanted <= 0.0:
                    assert lacks == 0.0
                elif wanted < distance.kept:  # apart: inside each other MuJoCo's depths are of another kind
                    # Of the way from the other forearm each goes one half.
                    assert any(share * wanted - CLEAR <= lacks <= share * wanted + 1e-6 for share in (0.5, 1.0))


def test_the_lever_is_how_joints_move_the_nearest_point(op3: Robot, distance: ArmDistance) -> None:
    q, step = poses(op3, 300), 1e-6
    near = distance.nearest(q)
    rows = np.flatnonzero((near.missing[LEG, :, 0] > 1e-3) & (near.missing[LEG, :, 0] < 2.0 * distance.kept))
    assert len(rows) > 5
    for joint, column in enumerate(distance.joints[0]):
        moved = q[rows].copy()
        moved[:, column] += step
        change = (distance.nearest(moved).missing[LEG, :, 0] - near.missing[LEG, rows, 0]) / step
        expected = -np.sum(near.lever[LEG, rows, 0, joint] * near.way[LEG, rows, 0], axis=1)
        np.testing.assert_allclose(change, expected, atol=2e-3)


def test_outward_is_clear_of_a_leg_that_the_forearm_is_inside_of(op3: Robot, distance: ArmDistance) -> None:
    near = distance.nearest(poses(op3, 60))
    inside = near.missing[LEG] > 0.0
    assert (near.aside[inside] >= near.missing[LEG][inside] - 1e-9).all()
    assert not near.aside[~inside].any()
