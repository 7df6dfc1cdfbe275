"""Whether a robot stands on its soles: `check_stand` and `check_stand_width` refuse, `unbalanced` warns."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

_SOLES_TILT = 0.15
"""Greatest angle between the soles of a stand [rad]: a foot tilted by more stands on its edge."""
_WIDTH_TOLERANCE = 1e-3
"""By how much a stand may be wider than the gait's greatest distance, which is written in millimetres [m]."""
_WIDEST_STEP = 1.6
"""Most that the gait's least distance may be over that of the stand [1]: OP3 (96 mm) walks ahead with .115, .13 and .15
m, and falls with a greatest distance of .085."""
_SOLES_STEP = 0.1
"""Greatest height of one sole over the other in a stand, over the height of the hips [1]."""


@dataclass(frozen=True)
class _Stand:
    """The soles in the stand pose.

    Attributes:
        soles: centres in the left sole's axes, from the left sole's centre, (2, 3) [m].
        tilt: angle between the soles' normals [rad].
        com: centre of mass of the robot in these axes, (3,) [m].
    """

    soles: Float
    tilt: float
    com: Float

    @classmethod
    def of(cls, robot: Robot) -> _Stand:
        model, data = robot.model, mujoco.MjData(robot.model)
        data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
        data.qpos[robot.qpos_address] = robot.stand_pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        left, right = (data.xmat[body].reshape(3, 3) for body in robot.foot_ids)
        centres = np.stack(
            [data.xpos[body] + data.xmat[body].reshape(3, 3) @ robot.soles[k] for k, body in enumerate(robot.foot_ids)]
        )
        tilt = float(np.arccos(np.clip(left[:, 2] @ right[:, 2], -1.0, 1.0)))
        return cls((centres - centres[0]) @ left, tilt, (data.subtree_com[robot.torso_id] - centres[0]) @ left)


def check_stand(robot: Robot) -> None:
    """Refuse soles that are not on one floor, or not side by side. Raises `RetargetError`."""
    stand = _Stand.of(robot)
    step, most = abs(float(stand.soles[1, 2])), _SOLES_STEP * robot.gait.stand_hip_height
    if stand.tilt > _SOLES_TILT or step > most:
        raise RetargetError(
            f"{robot.file}: field stand_pose: the soles are not on one floor: one is tilted against the other by "
            f"{stand.tilt:.2f} rad and {1e3 * step:.0f} mm higher, expected at most {_SOLES_TILT:g} rad and "
            f"{1e3 * most:.0f} mm; is a joint of one leg missing or of the wrong sign?"
        )
    ahead, across = stand.soles[0, :2] - stand.soles[1, :2]
    length, width = robot.sole_half_size.sum(axis=0)
    if across <= 0 or (across < width and abs(ahead) < length):
        told = "right of the right one" if across <= 0 else "over the right one"
        raise RetargetError(
            f"{robot.file}: field feet: in the stand pose the left sole is {told}: its centre is {across:.3f} m to the "
            f"left of the right one's, expected more than {width:.3f}, the two half_size; is y of a sole of the wrong "
            "sign (left is positive)?"
        )


def check_stand_width(robot: Robot, width: float) -> None:
    """Refuse a stand wider than any step may be, or far narrower. Raises `RetargetError`.

    Args:
        width: distance between the centres of the soles with the ankles under the hips [m].
    """
    least, most = robot.gait.lateral
    if least > _WIDEST_STEP * width or width - _WIDTH_TOLERANCE > most:
        raise RetargetError(
            f"{robot.file}: field gait.lateral: {list(robot.gait.lateral)} m, expected [least, greatest] with "
            f"{width:.3f} between them, the distance of the soles under the hips, in which the robot stands"
        )


def unbalanced(robot: Robot) -> str | None:
    """How far the centre of mass is outside the box around both soles; None: it is over them."""
    stand = _Stand.of(robot)
    low = (stand.soles[:, :2] - robot.sole_half_size).min(axis=0)
    high = (stand.soles[:, :2] + robot.sole_half_size).max(axis=0)
    outside = np.maximum(low - stand.com[:2], stand.com[:2] - high)
    axis = int(outside.argmax())
    if outside[axis] <= 0:
        return None
    return (
        f"{robot.file}: field stand_pose: the centre of mass is {1e3 * outside[axis]:.0f} mm "
        f"{('ahead or behind', 'beside')[axis]} of the soles: the robot falls in its stand pose. Expected it over the "
        "soles: the angles of both legs, the soles, and the model's masses"
    )
