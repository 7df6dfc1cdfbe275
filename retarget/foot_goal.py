"""`FootGoal`: where a foot is to be, seen from the other one, and when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import RetargetError

Float = NDArray[np.float64]

THERE_M, THERE_RAD = 0.003, 0.02
"""A foot that is this near to its place is there: no step is made for less [m, rad]."""


@dataclass(frozen=True)
class FootGoal:
    """Where a foot is to be, seen from the other one, which stands.

    Attributes:
        side: of the foot, 0 left, 1 right.
        ahead, left: from the centre of the other sole to that of this one, along the axes of that sole [m].
        turn: yaw of this sole minus that of the other one [rad].
        due: tick at which it lands there, or as soon after it as its swing allows.

    Raises:
        RetargetError: a value is not a number, or there is no such foot.
    """

    side: int
    ahead: float
    left: float
    turn: float
    due: float

    def __post_init__(self) -> None:
        values = self.ahead, self.left, self.turn, self.due
        if self.side not in (0, 1) or not np.isfinite(values).all():
            raise RetargetError(f"goal of a foot: expected side 0 or 1 and finite numbers, found {self.side}, {values}")

    def pose(self, stance: Float) -> Float:
        """Pose of the foot on the ground, (4,) [m, m, m, rad].

        Args:
            stance: of the other foot, (4,).
        """
        x, y, z, yaw = stance
        cos, sin = np.cos(yaw), np.sin(yaw)
        x, y = x + cos * self.ahead - sin * self.left, y + sin * self.ahead + cos * self.left
        return np.array([x, y, z, yaw + self.turn])

    def is_there(self, feet: Float) -> bool:
        """Whether the foot is at its place.

        Args:
            feet: poses of both feet, (2, 4) [m, m, m, rad].
        """
        gap = self.pose(feet[1 - self.side]) - feet[self.side]
        return bool(np.hypot(gap[0], gap[1]) < THERE_M and abs(gap[3]) < THERE_RAD)
