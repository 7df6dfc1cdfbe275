"""What a human's joints can do: angles, speeds and torques beyond it come from a bad recording or a bad fit."""

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
    """What a frame may have at most.

    Attributes:
        beyond: angle past a joint's limit; limits are means of adults and the fit is a few degrees off [rad].
        speed: of a joint, after the low-pass filter; the hardest kicks, throws and sprints stay below it [rad/s].
        torque: of a joint per body mass; a sprinter's knee comes near it [N·m/kg].
    """

    beyond: float = float(np.radians(15))
    speed: float = 25.0
    torque: float = 8.0


REACH = JointReach()


def within_turn(joints: Float) -> Float:
    """Equal poses with every angle within half a turn of the middle of its joint's range, (T, 26) [rad].

    Three hinges in a row wind up where an arm circles round the axis of the first: the pose comes back, two of the
    angles a whole turn further. Angles may jump by a turn here; poses do not.
    """
    middle = joint_limits().mean(axis=1)
    turned: Float = joints - 2 * np.pi * np.round((joints - middle) / (2 * np.pi))
    return turned


def plausible(motion: Motion, reach: JointReach = REACH) -> NDArray[np.bool_]:
    """Whether a frame is within a human's reach, (T,).

    Args:
        motion: with torques.
        reach: the limits.
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
    """Speed of every joint to the frame before and the frame after, the greater of both, (T, 14) [rad/s].

    Of ball joints that of the whole rotation: near a gimbal lock angles race while the limb is at rest.
    """
    turns = [np.abs(np.diff(motion.joints[:, HINGES], axis=0))]
    for columns, (names, side) in zip(BALLS, BALL_JOINTS, strict=True):
        rotation = three_angle_rotation(motion.joints[:, columns], names, side)
        turns.append(np.asarray((rotation[:-1].inv() * rotation[1:]).magnitude()).reshape(-1, 1))
    between = motion.fps * np.concatenate(turns, axis=1)
    still = np.zeros((1, between.shape[1]))
    speeds: Float = np.maximum(np.concatenate([still, between]), np.concatenate([between, still]))
    return speeds
