"""`TrunkBend`: how far the robot's trunk may bend, forward and back, at each height of its hips.

The centre of mass stays over the middle of the feet: the hips move back as the trunk bends forward. Joint limits and
the reach of the legs end that, found on the whole body. A trunk that is tilted as far as `safety.fall_tilt` counts as
fallen, so plans stay away from there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.retarget.whole_body import WholeBody

Float = NDArray[np.float64]

_FALL_MARGIN = 0.085
"""Kept from the tilt that counts as a fall [rad]: bends overshoot by up to 2 degrees, and floors slope."""
_HEIGHTS = 6
_STEEPEST = 1.6
"""Greatest pitch that is tried [rad]."""
_PRECISION = 0.02
"""To which it is found [rad]."""
_PASSES = 12
_ERROR = 2e-3
"""A pose stands if its centre of mass is this close to the middle of the feet [m]."""
_MISSING_LEG = 1e-4
"""And its legs are not too short by more than this [m]."""


class TrunkBend:
    """Bounds of the trunk's pitch of one robot that stands with its feet side by side.

    Args:
        robot: the robot file.
        body: of it.

    Attributes:
        heights: of the hips over the ankles, ascending, (H,) [m].
        balanced: least and greatest pitch that balance and joint limits allow at each, (H, 2) [rad].
        limit: greatest tilt of a plan, in any direction [rad].
    """

    def __init__(self, robot: Robot, body: WholeBody) -> None:
        self.heights = np.linspace(robot.gait.min_hip_height, robot.gait.stand_hip_height, _HEIGHTS)
        self.balanced = np.array(
            [[self._most(robot, body, height, sign) for sign in (-1.0, 1.0)] for height in self.heights]
        )
        self.limit = robot.safety.fall_tilt - _FALL_MARGIN

    def _most(self, robot: Robot, body: WholeBody, height: float, sign: float) -> float:
        """Greatest pitch to one side at one height of the hips [rad]: by bisection, as deeper is harder."""
        low, high = 0.0, _STEEPEST
        channels = np.concatenate([[height, 0.0, 0.0, 0.0], robot.stand_pose[body.upper.joints]])[None]
        while high - low > _PRECISION:
            middle = 0.5 * (low + high)
            channels[0, 2] = sign * middle
            base, q, _, short = body.solve(body.home_feet[None], np.zeros((1, 2)), channels, np.zeros(2), _PASSES)
            away = np.linalg.norm(body.dynamics.centre_of_mass(base, q)[0, :2])
            within = ((q >= robot.lower) & (q <= robot.upper)).all()
            if within and away <= _ERROR and short.max() <= _MISSING_LEG:
                low = middle
            else:
                high = middle
        return sign * low

    def bounds(self, height: Float) -> tuple[Float, Float]:
        """Least and greatest pitch for plans at hip heights (T,) [m], (T,) and (T,) [rad]."""
        least, greatest = (np.interp(height, self.heights, side) for side in self.balanced.T)
        return np.maximum(least, -self.limit), np.minimum(greatest, self.limit)
