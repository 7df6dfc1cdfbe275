"""`overloaded`: whether a robot's servos hold it on one foot."""

from __future__ import annotations

import numpy as np

from flexmotion.configs.robot import Robot
from flexmotion.retarget.whole_body import POSTURE, WholeBody

_PASSES = 12
"""Passes by which the centre of mass comes over the foot."""


def overloaded(robot: Robot) -> str | None:
    """What a servo lacks to hold the robot on one foot with its hips at walking height; None: nothing.

    Every step is such a stand. A mass in grams, or a servo of another size, is seen here before a run falls.

    Raises:
        RetargetError: the robot's legs cannot be solved.
    """
    body, still = WholeBody(robot), np.zeros((2, 6))
    channels = np.zeros((2, len(POSTURE) + len(body.upper.joints)))
    channels[:, POSTURE.index("height")] = robot.gait.walk_hip_height
    channels[:, len(POSTURE) :] = robot.stand_pose[body.upper.joints]
    feet, none = np.broadcast_to(body.home_feet, (2, 2, 4)), np.zeros((2, robot.n))
    # On the left, then on the right foot.
    base, q, _, _ = body.solve(feet, body.home_feet[:, :2], channels, np.zeros(2), _PASSES, smooth=False)
    torque, _ = body.dynamics.inverse(base, still, still, q, none, none, feet, np.array([0.0, 1.0]))
    share = np.abs(torque) / robot.usable_torque
    side, joint = np.unravel_index(int(share.argmax()), share.shape)
    if share[side, joint] <= 1.0:
        return None
    asked, given = float(abs(torque[side, joint])), float(robot.usable_torque[joint])
    return (
        f"{robot.file}: on one foot {robot.joint_names[joint]} needs {asked:.3g} N·m, its servo "
        f"{robot.servos[joint].name} gives {given:.3g}: it falls behind in every step. Expected a servo that gives "
        f"{asked:.3g} or more, or a robot of {robot.mass / share[side, joint]:.3g} kg at most; the MJCF's masses add "
        f"up to {robot.mass:.4g} kg: are they in kilograms?"
    )
