"""`RobotSize`: lengths and speeds by which the way of one robot is judged, from its file."""

from __future__ import annotations

from dataclasses import dataclass

from flexmotion.configs.robot_file import Gait


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
    def of(cls, gait: Gait) -> RobotSize:
        """The size of a robot; without a measured pace a quarter of its longest strides at their fastest."""
        steps_per_s = 1.0 / (gait.swing_min_s + gait.double_support_min_s)
        slowest = 0.25 * gait.max_stride * steps_per_s if gait.pace is None else gait.pace.aside
        return cls(gait.max_stride, slowest)

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
