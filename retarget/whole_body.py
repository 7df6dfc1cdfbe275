"""Whole-body inverse kinematics for given poses of the feet, horizontal centre of mass and posture of the trunk."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.retarget.arms import UpperBody
from flexmotion.retarget.dynamics import RobotDynamics
from flexmotion.retarget.legs import Leg, Legs
from flexmotion.retarget.splines import Spline
from flexmotion.retarget.stand_check import check_stand, check_stand_width
from flexmotion.spatial.rotations import matrices, yaw_matrices, zyx_quaternion

Float = NDArray[np.float64]

POSTURE = ("height", "roll", "pitch", "yaw")
"""Channels of the trunk: hips above ankles [m], torso roll, pitch and yaw [rad]."""

BENT_KNEE = 0.92
"""Share of the leg's length that a posture may use: near a straight knee, moving the foot needs unbounded speed."""


_STRIDE = 4
"""The torso's shift changes slowly: it is solved at every fourth row, with a cubic spline between (to .02 mm)."""


class WholeBody:
    """Legs, upper body and dynamics of one robot, solved together over many rows.

    Raises:
        RetargetError: the robot's legs or arms are of a kind that cannot be solved, or its soles are not side by
            side on one floor, or as far apart as no step may put them.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.legs = (Leg.of(robot, "left"), Leg.of(robot, "right"))
        check_stand(robot)
        self._both_legs = Legs(self.legs)
        self.upper = UpperBody(robot)
        self.dynamics = RobotDynamics(robot, self.legs)
        left, right = self.legs
        self.leg_length = left.thigh + left.shank
        self.ankle_height = -float(left.sole[2])
        self.hip_middle = 0.5 * (left.hip + right.hip)
        self.home_feet = np.zeros((2, 4))
        """Poses of the soles under straight legs, facing +x, with their middle at the origin, (2, 4) [m, m, m, rad]."""
        self.home_feet[:, :2] = (np.stack([left.hip + left.sole, right.hip + right.sole]))[:, :2]
        self.home_feet[:, :2] -= self.home_feet[:, :2].mean(axis=0)
        check_stand_width(robot, self.stand_width)
        self._hips, self._soles = (
            np.array([[getattr(leg, name)[axis]] for axis in (0, 1) for leg in self.legs]).reshape(2, 2, 1)
            for name in ("hip", "sole")
        )
        self._slope = 0.0
        self._slope = self._shift_slope()

    def _shift_slope(self) -> float:
        """Derivative of the solved shift of the torso by the guessed shift, at the stand pose."""
        channels = np.concatenate([[0.9 * self.leg_length, 0, 0, 0], self.robot.stand_pose[self.upper.joints]])
        shifts = []
        for guess in (-0.01, 0.01):
            _, _, found, _ = self.solve(self.home_feet[None], np.zeros((1, 2)), channels[None], np.array([guess, 0]), 1)
            shifts.append(found[0, 0])
        return float((shifts[1] - shifts[0]) / 0.02)

    @property
    def stand_width(self) -> float:
        """Distance between the sole centres with the ankles under the hips [m]."""
        return float(self.home_feet[0, 1] - self.home_feet[1, 1])

    def reachable_height(self, feet: Float, com: Float, offset: Float) -> Float:
        """Greatest height of the hips over the ankles at which both legs reach their feet with bent knees, (T,) [m].

        Arguments as in `solve`; the torso is assumed upright, at the mean yaw of the feet.
        """
        x, y, up, yaw = feet.transpose(2, 1, 0)
        cos, sin = np.cos(yaw), np.sin(yaw)
        middle = 0.5 * (yaw[0] + yaw[1])
        cos_middle, sin_middle = np.cos(middle), np.sin(middle)
        # Of both legs, (2, T): horizontal ways from ankle to hip.
        (hip_x, hip_y), (sole_x, sole_y) = self._hips, self._soles
        ahead = (com - offset)[:, 0] + cos_middle * hip_x - sin_middle * hip_y - (x - cos * sole_x + sin * sole_y)
        aside = (com - offset)[:, 1] + sin_middle * hip_x + cos_middle * hip_y - (y - sin * sole_x - cos * sole_y)
        away = ahead * ahead + aside * aside
        reach = np.sqrt(np.maximum((BENT_KNEE * self.leg_length) ** 2 - away, (0.5 * self.leg_length) ** 2))
        height: Float = (reach + up).min(axis=0)
        return height

    def solve(
        self, feet: Float, com: Float, channels: Float, offset: Float, passes: int = 2, *, smooth: bool = True
    ) -> tuple[Float, Float, Float, Float]:
        """Torso poses and joints that place the true centre of mass over `com`.

        The shift between torso and centre of mass depends on the joints, which depend on the shift. Its derivative is
        about the same everywhere, so that two Newton steps with a constant slope converge to a tenth of a millimetre.

        Args:
            feet: sole centres and yaw, (T, 2, 4) [m, m, m, rad]; com: (T, 2) [m].
            channels: posture, then upper-body joints, (T, 4 + U) [m, rad].
            offset: first guess of centre of mass minus torso, (2,) or (T, 2) [m].
            passes: number of Newton steps.
            smooth: the rows are those of a motion; else each one is solved by itself, which takes longer.

        Returns:
            Torso position and quaternion w x y z, (T, 7), joint angles (T, n) [rad], centre of mass minus torso
            (T, 2) [m], and missing length of the legs, (T,) [m].
        """
        height, roll, pitch, yaw = channels[:, : len(POSTURE)].T
        quaternion = zyx_quaternion(yaw, pitch, roll)
        rotation = matrices(quaternion)
        q = np.broadcast_to(self.robot.stand_pose, (len(feet), self.robot.n)).copy()
        q[:, self.upper.joints] = channels[:, len(POSTURE) :]
        torso = np.empty((len(feet), 3))
        torso[:, 2] = self.ankle_height + height - (rotation @ self.hip_middle)[:, 2]
        soles = yaw_matrices(feet[:, :, 3].ravel()).reshape(-1, 2, 3, 3)
        base = np.column_stack([torso, quaternion])
        rows = np.arange(0, len(feet), _STRIDE if smooth else 1)
        rows = rows if rows[-1] == len(feet) - 1 else np.append(rows, len(feet) - 1)
        offset = np.broadcast_to(offset, (len(feet), 2))[rows]
        some_base, some_q = base.take(rows, axis=0), q.take(rows, axis=0)
        some = rotation.take(rows, axis=0), feet.take(rows, axis=0), soles.take(rows, axis=0), com.take(rows, axis=0)
        for _ in range(passes):
            self._place(some_base, some_q, *some, offset)
            found = self.dynamics.centre_of_mass(some_base, some_q)[:, :2] - some_base[:, :2]
            offset = offset + (found - offset) / (1.0 - self._slope)
        if len(rows) < len(feet):
            offset = Spline(rows.astype(float), offset, natural=False).at(np.arange(float(len(feet)))).value
        return base, q, offset, self._place(base, q, rotation, feet, soles, com, offset)

    def _place(
        self, base: Float, q: Float, rotation: Float, feet: Float, soles: Float, com: Float, offset: Float
    ) -> Float:
        """Shift the torso and solve the legs; `base` and `q` are written.

        Args:
            base, q: as `solve` returns them; rotation: of the torso, (T, 3, 3).
            feet, com, offset: as of `solve`; soles: rotations of both, (T, 2, 3, 3).

        Returns:
            Missing length of the legs, (T,) [m].
        """
        base[:, :2] = com - offset
        angles, missing = self._both_legs.solve(
            base[:, :3], rotation, feet[:, :, :3].swapaxes(0, 1), soles.swapaxes(0, 1)
        )
        q[:, self._both_legs.indices] = angles.swapaxes(0, 1)
        short: Float = missing.max(axis=0)
        return short
