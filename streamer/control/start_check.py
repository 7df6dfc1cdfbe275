"""Whether the way in which a robot without torque stands or lies permits that it is armed, or gets up."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.get_up import FILE
from flexmotion.configs.robot import Robot
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.lying import lying_on
from flexmotion.streamer.control.tick_row import TickRow

Float = NDArray[np.float64]

_STILL = 0.3
"""Angular velocity of the torso above which somebody moves the robot [rad/s]."""
_APART = math.radians(25.0)
"""Angle between up by the attitude and as the accelerometer measures it from which on the attitude is wrong [rad]."""
_AT_REST = 0.2
"""Share of gravity by which the specific force of a torso at rest may differ from it."""
_MOVED = "the robot was moved, and how it lies is not known yet"
_BY_HAND = "put it into its rest pose by hand"


def why_not_arm(robot: Robot, estimator: Estimator, accel: Float) -> str | None:
    """Why a robot that has been watched for a while cannot stand up: it lies, or was just moved. None where it may.

    Args:
        accel: measured specific force of the torso, (3,) [m/s²].
    """
    side = lying_on(estimator.tilt, robot.safety.fall_tilt)
    if not estimator.has_imu:
        return None
    if _is_elsewhere(estimator.tilt, accel):
        return f"{_MOVED}: ask again in a few seconds"
    if side is None:
        return None
    lies = f"the torso is tilted by {math.degrees(estimator.tilt_angle):.0f}°: the robot lies; {_BY_HAND}"
    return f"{lies}, or let it get up: flexmotion clear --get-up" if side in robot.get_up.steps else lies


def gets_up_from(robot: Robot, row: TickRow) -> str | None:
    """The side from which a robot without torque gets up on request, by a row of the loop; None: from none."""
    if State(int(row.state)) not in (State.OFF, State.FAULT) or int(row.imu_stale) != 0:
        return None
    side = lying_on(row.tilt, robot.safety.fall_tilt)
    return side if side in robot.get_up.steps and not _is_elsewhere(row.tilt, row.accel) else None


def why_not_get_up(robot: Robot, estimator: Estimator, gyro: Float, accel: Float) -> str | None:
    """Why a robot must not get up by itself; None where it may.

    Args:
        gyro: measured angular velocity of the torso, (3,) [rad/s].
        accel: its measured specific force, (3,) [m/s²].
    """
    side = lying_on(estimator.tilt, robot.safety.fall_tilt)
    get_up = robot.get_up
    if not (get_up.steps or get_up.unfit):
        return f"{robot.name} has no {FILE} in its folder, it does not get up by itself: {_BY_HAND}"
    if not estimator.has_imu:
        return f"without an IMU it is not known how the robot lies: {_BY_HAND}"
    if side is None:
        return "the robot does not lie: clear, then arm"
    if side in get_up.unfit:
        why = get_up.unfit[side]
        return f"the robot lies on its {side}, and the way up from there is not for this robot ({why}): {_BY_HAND}"
    if side not in get_up.steps:
        sides = " or ".join(get_up.steps)
        way = f"it gets up from its {sides} alone: turn it over by hand" if sides else f"it does not get up: {_BY_HAND}"
        return f"the robot lies on its {side}, {way}"
    if float(np.linalg.norm(gyro)) > _STILL:
        return "the robot is being moved: let go of it, then ask again"
    if _is_elsewhere(estimator.tilt, accel):
        return f"{_MOVED}: ask again in a few seconds"
    return None


def _is_elsewhere(tilt: Float, accel: Float) -> bool:
    """Whether gravity, as a torso at rest measures it, contradicts its attitude, which follows it over seconds.

    Args:
        tilt: roll and pitch by the attitude, (2,) [rad].
        accel: measured specific force, (3,) [m/s²].
    """
    force = float(np.linalg.norm(accel))
    if abs(force - GRAVITY) > _AT_REST * GRAVITY:
        return False  # it does not rest: what it measures is not gravity alone
    roll, pitch = float(tilt[0]), float(tilt[1])
    up = (-math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll))
    return float(np.dot(up, accel)) < force * math.cos(_APART)
