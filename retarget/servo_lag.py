"""How far joints fall behind a plan because their servos lack the torque that it needs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.robot import Robot
from flexmotion.retarget.legs import Leg

Float = NDArray[np.float64]

_SUBSTEPS = 2
"""Integration steps a tick: the servo's own oscillation (OP3: 20 rad/s) is resolved in 30 steps a radian."""


def servo_lag(robot: Robot, envelope: Envelope, torque: Float, speed: Float) -> Float:
    """Distance of each joint behind its plan, (T, n) [rad]; where every torque is within the envelope, 0.

    Each joint by itself, e = plan - joint: the servo gives what the plan needs and kp e + b e' to come back, as far as
    its envelope at the joint's own speed reaches; what it lacks of the planned torque accelerates the joint away:

        I e'' = torque - clip(torque + kp e + b e', lowest, highest)

    I is the inertia that the joint moves by itself, its rotor's included (the inverse of MuJoCo's `dof_invweight0`).
    Other joints are taken to follow. Semi-implicit Euler.

    Args:
        envelope: of the servos, at the supply and temperature to judge at.
        torque, speed: the plan, one row a tick, (T, n) [N·m, rad/s].
    """
    inertia = 1.0 / robot.model.dof_invweight0[robot.dof_address]
    step = 1.0 / (robot.rate_hz * _SUBSTEPS)
    kp, damping = robot.kp * (envelope.stall / robot.stall_torque), envelope.back_emf
    lag, rate = np.zeros(robot.n), np.zeros(robot.n)
    found = np.empty(torque.shape)
    for k, (needed, planned) in enumerate(zip(torque, speed, strict=True)):
        for _ in range(_SUBSTEPS):
            lowest, highest = envelope.bounds(planned - rate)
            given = np.minimum(np.maximum(needed + kp * lag + damping * rate, lowest), highest)
            rate += step * (needed - given) / inertia
            lag += step * rate
        found[k] = lag
    return found


def allowed_lag(robot: Robot) -> float:
    """Angle by which a joint may lag behind its plan for lack of torque [rad].

    A knee that lags by this angle moves the foot, at the end of the shank, by the clearance of a swing: with more, the
    foot strikes the floor in its swing.
    """
    return robot.gait.clearance / Leg.of(robot, "left").shank
