"""`measured_foot`: where a foot is, seen from the other one, by measured joints."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]


def measured_foot(robot: Robot, side: int, q: Float) -> Float | None:
    """Centre and heading of a sole from the other one, in the frame of `FootGoal`, (3,) [m, m, rad].

    Args:
        robot: the robot file.
        side: of the foot, 0 left, 1 right.
        q: all joint angles, (n,) [rad].

    Returns:
        None where a joint is not known.
    """
    if not np.isfinite(q).all():
        return None
    data, feet = mujoco.MjData(robot.model), list(robot.foot_ids)
    data.qpos[robot.qpos_address] = q
    mujoco.mj_kinematics(robot.model, data)
    turns = data.xmat[feet].reshape(2, 3, 3)
    soles = data.xpos[feet] + np.einsum("fij,fj->fi", turns, robot.soles)
    other = turns[1 - side]
    ahead, left, _ = other.T @ (soles[side] - soles[1 - side])
    toes = other.T @ turns[side][:, 0]
    return np.array([ahead, left, math.atan2(toes[1], toes[0])])
