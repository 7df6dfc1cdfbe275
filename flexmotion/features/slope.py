"""A motion on a slope, turned so that its floor is level and gravity is not.

Features are relative to a level floor. On a slope heights above z = 0 would rise with the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Levelled:
    """A motion on its levelled floor.

    Attributes:
        motion: turned with the floor, ground forces included; joints, torques, activations and contacts are the same.
        centres: reference points of the moments of its wrenches, (T, 2, 3) [m].
        loads: external forces, (T, B, 3) [N].
        gravity: direction of gravity less that of a level floor, (3,), zero without a slope; on a mass m acts the
            additional force m g times this.
    """

    motion: Motion
    centres: Float
    loads: Float
    gravity: Float


def levelled(motion: Motion, centres: Float, loads: Float, slope: Sequence[float]) -> Levelled:
    """Turn a motion about the point of the floor below its first frame.

    Args:
        motion: in the world, where gravity is along -z.
        centres: reference points of the moments of its wrenches, (T, 2, 3) [m].
        loads: external forces, world axes, (T, B, 3) [N].
        slope: rise of the floor along x and y, (2,) [m/m].
    """
    if not any(slope) or not len(motion):
        return Levelled(motion, centres, loads, np.zeros(3))
    normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
    axis = np.cross(normal, [0.0, 0.0, 1.0])
    angle = np.arctan2(np.linalg.norm(axis), normal[2])
    turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    origin = motion.root_position[0] * [1.0, 1.0, 0.0]

    def turned(vectors: Float) -> Float:
        return turn.apply(vectors.reshape(-1, 3)).reshape(vectors.shape)

    wrenches = motion.wrenches
    if wrenches is not None:
        wrenches = turned(wrenches.reshape(*wrenches.shape[:-1], 2, 3)).reshape(wrenches.shape)
    down = np.array([0.0, 0.0, -1.0])
    return Levelled(
        motion=replace(
            motion,
            root_position=turned(motion.root_position - origin) + origin,
            root_quaternion=(turn * Rotation.from_quat(motion.root_quaternion, scalar_first=True)).as_quat(
                scalar_first=True
            ),
            wrenches=wrenches,
        ),
        centres=turned(centres - origin) + origin,
        loads=turned(loads),
        gravity=turn.apply(down) - down,
    )
