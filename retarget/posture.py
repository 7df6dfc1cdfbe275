"""Targets of the robot's trunk, and the filter through which trunk, arms and head follow their targets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.configs.robot_file import Gait
from flexmotion.retarget.arms import SPEED_SHARE
from flexmotion.retarget.bend import TrunkBend
from flexmotion.retarget.footholds import Scaling
from flexmotion.retarget.human import HumanWindow
from flexmotion.retarget.schedule import Schedule
from flexmotion.retarget.smoothing import Follower
from flexmotion.retarget.splines import Spline
from flexmotion.retarget.whole_body import POSTURE, WholeBody

Float = NDArray[np.float64]

_OMEGA = np.array([9.0, 12.0, 12.0, 12.0])
_SPEED = np.array([0.25, 1.5, 1.5, 2.0])
_ACCELERATION = np.array([3.0, 20.0, 20.0, 20.0])
"""Trunk channels: natural frequency [1/s] and bounds [m/s, rad/s and per second]."""
_UPPER_OMEGA, _UPPER_ACCELERATION = 22.0, 45.0
"""Arms and head: natural frequency [1/s], and bound [rad/s²]. The bound is set by the servo's torque: its rotor and
gears have more inertia than the arm (OP3: .045 kg·m² times 45 rad/s² is 2 N·m)."""
_ROLL, _PITCH_BACK = 0.20, 0.20
"""Bounds of the torso's roll, and of its pitch to the back [rad]; forward, `TrunkBend` bounds it."""
_WALKING_PITCH, _WALKING_PITCH_SPEED = 0.42, 0.5
"""Bounds of the pitch forward, and of the speed with which it deepens, near steps [rad, rad/s]: what the trunk turns,
the hip of a swinging leg turns too, whose servo is at its bounds already."""
_WALKING_TILT = (0.35, 0.7)
"""Shares of the human's trunk tilt, roll and pitch, that the robot follows near steps."""
_TWIST = 0.5
"""Bound of the torso's yaw relative to the feet [rad]."""
_STANDING_SHARE = (0.3, 0.7)
"""Bounds of the load share that follows the human's sway in double support."""


def follower(robot: Robot, body: WholeBody) -> Follower:
    """The filter of trunk and upper body of one robot."""
    upper = body.upper.joints
    count = len(upper)
    return Follower(
        omega=np.concatenate([_OMEGA, np.full(count, _UPPER_OMEGA)]),
        speed=np.concatenate([_SPEED, SPEED_SHARE * robot.no_load_speed[upper]]),
        acceleration=np.concatenate([_ACCELERATION, np.full(count, _UPPER_ACCELERATION)]),
        dt=1.0 / robot.rate_hz,
    )


def quiet_share(window: HumanWindow, seconds: Float, begun: Float, rows: int, fade_rows: float) -> Float:
    """Load share of the right foot in double support, (rows,): the human's, fading to one half in the stop tail.

    Args:
        seconds: source time of the rows that follow the human, (F,) [s]; rows: number of rows in all.
        begun: how much of the human's share counts in these rows, 0 to 1, (F,).
        fade_rows: rows in which it fades.
    """
    left, right = window.feet[:, 0, :2], window.feet[:, 1, :2]
    across = right - left
    share = np.sum((window.kinematics.com[:, :2] - left) * across, axis=1) / np.maximum(np.sum(across**2, axis=1), 1e-4)
    known = 0.5 + begun * (window.at(np.clip(share, *_STANDING_SHARE), seconds) - 0.5)
    fade = np.clip(1.0 - np.arange(rows - len(seconds)) / fade_rows, 0.0, 1.0)
    return np.concatenate([known, 0.5 + fade * (known[-1] - 0.5)])


def trunk_targets(gait: Gait, schedule: Schedule) -> Float:
    """Targets of the trunk without a human, (T, 4): upright over the feet, at standing or walking height."""
    targets = np.zeros((len(schedule.share), len(POSTURE)))
    targets[:, 0] = np.where(schedule.walking, gait.walk_hip_height, gait.stand_hip_height)
    targets[:, 3] = schedule.feet[:, :, 3].mean(axis=1)
    return targets


def human_trunk(
    gait: Gait,
    bend: TrunkBend,
    schedule: Schedule,
    window: HumanWindow,
    scaling: Scaling,
    seconds: Float,
    follower: Follower,
    pitch: tuple[float, float],
) -> Float:
    """Targets of the trunk from the human's, (F, 4), bounded for the robot and ahead by the lag of each filter.

    Args:
        bend: how far the trunk may bend.
        seconds: source time of the rows that follow the human, the schedule's first ones, (F,) [s].
        follower: filter of trunk and upper body.
        pitch: of the trunk before the first row, and its speed [rad, rad/s].
    """
    targets, walking = trunk_targets(gait, schedule)[: len(seconds)], schedule.walking[: len(seconds)]
    lead, last = 2.0 / follower.omega, seconds[-1]

    def ahead(values: Float, channel: int) -> Float:
        return window.at(values, np.minimum(seconds + lead[channel], last))

    hips = (window.kinematics.hip.mean(axis=1) - window.kinematics.ankle.min(axis=1))[:, 2]
    crouch = ahead(hips, 0) * scaling.ratio
    targets[:, 0] = np.clip(np.minimum(targets[:, 0], crouch), gait.min_hip_height, None)
    roll_gain, pitch_gain = (np.where(walking, share, 1.0) for share in _WALKING_TILT)
    tilt = window.tilt
    targets[:, 1] = np.clip(roll_gain * ahead(tilt[:, 0], 1), -_ROLL, _ROLL)
    least, most = bend.bounds(targets[:, 0])
    most = np.where(walking, np.minimum(most, _WALKING_PITCH), most)
    wanted = np.clip(pitch_gain * ahead(tilt[:, 1], 2), np.maximum(least, -_PITCH_BACK), most)
    begin, speed = pitch
    most_change = np.where(walking, _WALKING_PITCH_SPEED * follower.dt, np.inf)
    targets[:, 2] = deepened(wanted, most_change, begin + lead[2] * speed)
    yaw = ahead(window.yaws[:, 2], 3) + scaling.heading
    targets[:, 3] += np.clip(yaw - targets[:, 3], -_TWIST, _TWIST)
    return targets


def deepened(targets: Float, most: Float, begin: float) -> Float:
    """Targets (T,) that move away from 0 by so much a row at most, (T,), from where they begin, and back at once."""
    place, found = begin, list[float]()
    # Plain numbers: numpy takes ten times as long for one at a time.
    for target, reach in zip(targets.tolist(), most.tolist(), strict=True):
        place = min(max(target, min(place, 0.0) - reach), max(place, 0.0) + reach)
        found.append(place)
    return np.array(found)


def frames_before(position: Float, velocity: Float, now: float, first: float, fps: float) -> Float | None:
    """Angles at the two frames before the first of a window, by the filter's state, oldest first, (2, U) [rad].

    Args:
        position, velocity: of the upper body's joints, (U,) [rad, rad/s].
        now: source time of that state [s]; first: source time of the window's first frame [s].
        fps: frames a second.

    Returns:
        None where the window begins later than the next frame, as before the first frame of a source.
    """
    frame = 1.0 / fps
    if first - now > frame:
        return None
    newest = first - frame - now
    found: Float = position + np.array([[newest - frame], [newest]]) * velocity
    return found


def upper_targets(window: HumanWindow, angles: Float, arms: int, seconds: Float, last: float) -> Float:
    """Targets of the filter of arms and head, (T, U) [rad].

    Arms pass the filter unchanged: the target x + 2 x' / w + x'' / w² is the inverse of a critically damped filter of
    natural frequency w. The head's angles are as they were measured, too rough for derivatives: they are taken ahead by
    the filter's lag.

    Args:
        angles: of each frame, arms before head, (F, U) [rad]; arms: number of arm joints.
        seconds: source time of each row, constant after the last frame, (T,) [s]; last: the last of these times [s].
    """
    first = window.times[0]
    inside = ((seconds > first) & (seconds < last))[:, None]
    path = Spline(window.times, angles[:, :arms], natural=True).at(np.minimum(np.maximum(seconds, first), last))
    lead = np.where(inside, path.first * (2.0 / _UPPER_OMEGA) + path.second / _UPPER_OMEGA**2, 0.0)
    head = window.at(angles[:, arms:], np.minimum(seconds + 2.0 / _UPPER_OMEGA, last))
    return np.hstack([path.value + lead, head])
