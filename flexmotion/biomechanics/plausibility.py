"""Limits of human joints: angles, speeds and torques beyond them are errors of the recording or the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.smoothing import BALL_JOINTS
from flexmotion.human.angles import three_angle_rotation
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS

Float = NDArray[np.float64]

BALLS = [[JOINTS.index(f"{name}_{side}" if side else name) for name in names] for names, side in BALL_JOINTS]
HINGES = [column for column in range(len(JOINTS)) if not any(column in ball for ball in BALLS)]


@dataclass(frozen=True)
class JointReach:
    """Greatest values in a plausible frame.

    Attributes:
        beyond: angle past a joint limit; limits are means of adults, and fits have errors of a few degrees [rad].
        speed: of a joint, after the low-pass filter; the fastest kicks, throws and sprints are below it [rad/s].
        torque: of a joint per body mass; a sprinter's knee is near it [N·m/kg].
    """

    beyond: float = float(np.radians(15))
    speed: float = 25.0
    torque: float = 8.0


REACH = JointReach()

RESIDUAL_FORCE, RESIDUAL_MOMENT = 0.1, 0.1
"""Greatest residual that ground forces leave in a good frame [body weights, body weights x m]."""


def within_turn(joints: Float) -> Float:
    """Angles of the same poses within half a turn of the middle of each joint's range, (T, 26) [rad].

    Where an arm circles about the axis of its first hinge, two of its angles return a whole turn later. Angles of the
    result may jump by a turn, poses do not.
    """
    middle = joint_limits().mean(axis=1)
    turned: Float = joints - 2 * np.pi * np.round((joints - middle) / (2 * np.pi))
    return turned


def explained(residual: Float, force: float = RESIDUAL_FORCE, moment: float = RESIDUAL_MOMENT) -> NDArray[np.bool_]:
    """Whether ground forces explain a frame, (T,); a good frame is explained and `plausible`.

    Args:
        residual: of force and moment, (T, 2) [body weights, body weights x m].
        force, moment: greatest residual.
    """
    result: NDArray[np.bool_] = np.all(residual <= (force, moment), axis=1)
    return result


def plausible(motion: Motion, reach: JointReach = REACH) -> NDArray[np.bool_]:
    """Whether a frame is plausible, (T,).

    Args:
        motion: with torques.
        reach: greatest values.
    """
    assert motion.torques is not None
    lower, upper = joint_limits().T
    joints = within_turn(motion.joints)
    inside = ((joints >= lower - reach.beyond) & (joints <= upper + reach.beyond)).all(axis=1)
    slow = _speeds(motion).max(axis=1) <= reach.speed
    torques = np.abs(motion.torques[:, -len(JOINTS) :]).max(axis=1)
    result: NDArray[np.bool_] = inside & slow & (torques <= reach.torque * motion.body.mass)
    return result


def _speeds(motion: Motion) -> Float:
    """Speed of every joint, the greater of those from the frame before and to the frame after, (T, 14) [rad/s].

    Of ball joints the speed of the rotation: near gimbal lock angles are fast while the limb is at rest.
    """
    turns = [np.abs(np.diff(motion.joints[:, HINGES], axis=0))]
    for columns, (names, side) in zip(BALLS, BALL_JOINTS, strict=True):
        rotation = three_angle_rotation(motion.joints[:, columns], names, side)
        turns.append(np.asarray((rotation[:-1].inv() * rotation[1:]).magnitude()).reshape(-1, 1))
    between = motion.fps * np.concatenate(turns, axis=1)
    still = np.zeros((1, between.shape[1]))
    speeds: Float = np.maximum(np.concatenate([still, between]), np.concatenate([between, still]))
    return speeds
