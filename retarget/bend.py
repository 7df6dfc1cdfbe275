"""`TrunkBend`: how far the robot's trunk may bend, forward and back, at each height of its hips.

The centre of mass stays over the middle of the feet: the hips move back as the trunk bends forward. Joint limits and
the reach of the legs end that, found on the whole body. `safety.most_tilt` bounds it too: deeper bows are not proven.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.retarget.whole_body import POSTURE, WholeBody

Float = NDArray[np.float64]

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
        self.balanced = self._steepest(robot, body)
        self.limit = robot.safety.most_tilt

    def _steepest(self, robot: Robot, body: WholeBody) -> Float:
        """Least and greatest pitch at each height, (H, 2) [rad]: by bisection, all at once, as deeper is harder."""
        height, sign = (a.ravel() for a in np.meshgrid(self.heights, (-1.0, 1.0), indexing="ij"))
        rows = len(height)
        low, high = np.zeros(rows), np.full(rows, _STEEPEST)
        feet, com = np.broadcast_to(body.home_feet, (rows, 2, 4)), np.zeros((rows, 2))
        channels = np.zeros((rows, len(POSTURE) + len(body.upper.joints)))
        channels[:, POSTURE.index("height")] = height
        channels[:, len(POSTURE) :] = robot.stand_pose[body.upper.joints]
        while (high - low).max() > _PRECISION:
            middle = 0.5 * (low + high)
            channels[:, POSTURE.index("pitch")] = sign * middle
            base, q, _, short = body.solve(feet, com, channels, np.zeros(2), _PASSES, smooth=False)
            away = np.linalg.norm(body.dynamics.centre_of_mass(base, q)[:, :2], axis=1)
            within = ((q >= robot.lower) & (q <= robot.upper)).all(axis=1)
            stands = within & (away <= _ERROR) & (short <= _MISSING_LEG)
            low, high = np.where(stands, middle, low), np.where(stands, high, middle)
        return (sign * low).reshape(-1, 2)

    def bounds(self, height: Float) -> tuple[Float, Float]:
        """Least and greatest pitch for plans at hip heights (T,) [m], (T,) and (T,) [rad]."""
        least, greatest = (np.interp(height, self.heights, side) for side in self.balanced.T)
        return np.maximum(least, -self.limit), np.minimum(greatest, self.limit)
