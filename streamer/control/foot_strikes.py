"""`FootStrikes`: how a foot that is about to strike the ground would change the speeds of the joints.

A measurement is old and a goal takes time to arrive. In between a corner of a sole may strike: a part of a foot that
was planned on the ground for long does so as well, where a pushed robot stands on the edge of it. The joints then leave
the speeds at which their goals were computed within 2 ms.

The strike is that of a point that comes to rest without a rebound (Featherstone 2008, Rigid Body Dynamics Algorithms,
11.7): with J the way of the corner upward over the robot's coordinates, M their inertia and v the corner's speed,

    change = M^-1 J' (J M^-1 J')^-1 (-v)
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.masks import some
from flexmotion.streamer.control.estimator import Estimator

Float = NDArray[np.float64]

NEAR_M = 0.004
"""A corner that may be this low when the goal has arrived may strike before [m]: heights over the lowest corner are as
good as tilt, floor and gears are. Of the 12 hardest strikes in 64 pushes of .9 and 1.2 N·s, which changed what goals
imply by .93 to 1.38 N·m, nine corners were seen 1.7 to 4.7 mm high 4 ms before, three 10 mm and more (tilted falls)."""
GROUND_M = 0.002
"""A corner that is no higher than this over the lowest one may be what the robot stands on [m]: which of two it is
cannot be told by their heights."""
LEAST_SPEED = 0.05
"""Slower corners are not looked at [m/s]: they change what a goal implies by less than .2 N·m."""
_CORNERS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])


class FootStrikes:
    """Fills `change` each tick.

    Args:
        ahead_s: from a measurement to the arrival of the goals computed from it [s].

    Attributes:
        change: least (0 or below) and greatest (0 or above) change of the joints' speeds that one of the corners that
            come down would make, (2, n) [rad/s].
    """

    def __init__(self, robot: Robot, ahead_s: float) -> None:
        self.change = np.zeros((2, robot.n))
        self._robot, self._ahead = robot, ahead_s
        self._feet = np.asarray(robot.foot_ids)
        flat = robot.soles[:, None, :].repeat(len(_CORNERS), axis=1)
        flat[:, :, :2] += _CORNERS * robot.sole_half_size[:, None, :]
        self._corners = flat  # in the frames of their feet, (2, 4, 3)
        self._way = np.zeros((3, robot.model.nv))

    def reset(self) -> None:
        """No foot is about to strike."""
        self.change[:] = 0.0

    def update(self, estimator: Estimator) -> None:
        """Look at the corners of both soles as the estimator has them.

        How fast the torso rises is not known. Of the corners on the ground none goes down, so the one that comes up
        fastest is at rest at least.
        """
        self.reset()
        model, data = estimator.model, estimator.data
        rotation = data.xmat[self._feet].reshape(2, 3, 3)
        corner = data.xpos[self._feet][:, None, :] + self._corners @ rotation.transpose(0, 2, 1)
        height, rate = corner[:, :, 2].ravel(), self._rates(data, corner)
        height -= height.min()
        rate -= rate[height <= GROUND_M].max(initial=-np.inf)
        comes = (rate < -LEAST_SPEED) & (height + self._ahead * rate < NEAR_M)
        if some(comes):
            change = self._changes(model, data, corner.reshape(-1, 3), rate, np.flatnonzero(comes))
            np.minimum(change.min(axis=0), 0.0, out=self.change[0])
            np.maximum(change.max(axis=0), 0.0, out=self.change[1])

    def _rates(self, data: mujoco.MjData, corner: Float) -> Float:
        """Speeds of the corners upward, (8,) [m/s]."""
        twist = data.cvel[self._feet]  # angular velocity, then linear at the robot's centre of mass
        arm = corner - data.subtree_com[self._robot.torso_id]
        rate: Float = twist[:, 5, None] + twist[:, 0, None] * arm[:, :, 1] - twist[:, 1, None] * arm[:, :, 0]
        return rate.ravel()

    def _changes(
        self, model: mujoco.MjModel, data: mujoco.MjData, corner: Float, rate: Float, which: NDArray[np.intp]
    ) -> Float:
        """Changes of the joints' speeds by the strikes of some corners, each on its own, (k, n) [rad/s]."""
        upward = np.zeros((len(which), model.nv))
        for row, number in zip(upward, which.tolist(), strict=True):
            mujoco.mj_jac(model, data, self._way, None, corner[number], self._feet[number // len(_CORNERS)])
            row[:] = self._way[2]
        mujoco.mj_crb(model, data)
        mujoco.mj_factorM(model, data)
        answer = np.zeros_like(upward)
        mujoco.mj_solveM(model, data, answer, upward)
        impulse = -rate[which] / (upward * answer).sum(axis=1)
        found: Float = (impulse[:, None] * answer)[:, self._robot.dof_address]
        return found
