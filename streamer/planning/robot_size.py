"""`RobotSize`: lengths and speeds by which the way of one robot is judged, from its file."""

from __future__ import annotations

from dataclasses import dataclass

from flexmotion.configs.robot_file import Gait
from flexmotion.retarget.swing import Swings


@dataclass(frozen=True)
class RobotSize:
    """What is near, what is a step and what is still, for a robot of this size.

    The shares are those that were found at OP3, whose longest stride is .11 m.

    Attributes:
        stride: longest one [m].
        slowest: speed in its slowest direction [m/s].
    """

    stride: float
    slowest: float

    @classmethod
    def of(cls, gait: Gait, swings: Swings) -> RobotSize:
        """The size of a robot; without a measured pace its slowest speed is a quarter of that of a steady walk."""
        return cls(swings.longest_stride, 0.25 * swings.speed if gait.pace is None else gait.pace.aside)

    @property
    def near(self) -> float:
        """Nearer than this the robot shifts to a place without turning to it first [m]."""
        return 2.75 * self.stride

    @property
    def still(self) -> float:
        """It stands still when it has moved less than this in half a second [m]."""
        return 0.07 * self.stride

    @property
    def step(self) -> float:
        """A step carries its foot at least this far; shorter ones correct the stance [m]."""
        return 0.14 * self.stride

    @property
    def least_way(self) -> float:
        """A way that is shorter is not worth another attempt [m]."""
        return 0.27 * self.stride
