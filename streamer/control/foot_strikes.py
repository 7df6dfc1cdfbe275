"""`FootStrikes`: how a foot that is about to strike the ground would change the speeds of the joints.

A measurement is old and a goal takes time to arrive. In between a corner of a sole may strike: a part of a foot that
was planned on the ground for long does so as well, where a pushed robot stands on the edge of it. The joints then leave
the speeds at which their goals were computed within 2 ms.

The strike is that of a point that comes to rest without a rebound (Featherstone 2008, Rigid Body Dynamics Algorithms,
11.7): with J the way of the corner over the robot's coordinates, M their inertia and v the corner's velocity,

    change = M^-1 J' p,  J M^-1 J' p = -v

for the impulse p of the floor. Without friction it has an upward part alone, and stops the upward part of v. With
friction it stops all of v, or pushes where it would to stop it, with `FRICTION` times its upward part. How rough the
floor is is not known, so both strikes are foreseen.
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
GROUND_M = 2.0 * NEAR_M
"""A corner that is no higher than this over the lowest one may be what the robot stands on [m]: which of two it is
cannot be told by their heights, and both may be wrong. With 2 mm, and with 4, a corner that came down was taken to be
at rest, and no strike was foreseen. In unpushed walks what is foreseen binds no goal, with 15 mm neither."""
FRICTION = 1.0
"""Greatest friction of a floor: about that of rubber soles on dry ground. A falling robot dragged a foot along at 1.1
m/s; its toe struck, and the knee went from 1.2 to 2.4 rad/s in a millisecond. Without friction .3 rad/s more was
foreseen, and the goal that braked the knee implied 1.08 of its stall torque."""
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

    def reset(self) -> None:
        """No foot is about to strike."""
        self.change[:] = 0.0

    def update(self, estimator: Estimator) -> None:
        """Look at the corners of both soles as the estimator has them.

        How fast the torso moves is not known. Of the corners on the ground none goes down, so the one that comes up
        fastest is at rest at least. It is taken not to slide either.
        """
        self.reset()
        model, data = estimator.model, estimator.data
        rotation = data.xmat[self._feet].reshape(2, 3, 3)
        corner = data.xpos[self._feet][:, None, :] + self._corners @ rotation.transpose(0, 2, 1)
        height, velocity = corner[:, :, 2].ravel(), self._velocities(data, corner)
        height -= height.min()
        on_ground = np.flatnonzero(height <= GROUND_M)
        if len(on_ground):
            velocity -= velocity[on_ground[np.argmax(velocity[on_ground, 2])]]
        rate = velocity[:, 2]
        comes = (rate < -LEAST_SPEED) & (height + self._ahead * rate < NEAR_M)
        if some(comes):
            change = self._changes(model, data, corner.reshape(-1, 3), velocity, np.flatnonzero(comes))
            np.minimum(change.min(axis=0), 0.0, out=self.change[0])
            np.maximum(change.max(axis=0), 0.0, out=self.change[1])

    def _velocities(self, data: mujoco.MjData, corner: Float) -> Float:
        """Velocities of the corners in the world frame, (8, 3) [m/s]."""
        twist = data.cvel[self._feet]  # angular velocity, then linear at the robot's centre of mass
        arm = corner - data.subtree_com[self._robot.torso_id]
        turning = twist[:, None, :3]
        velocity = np.empty((2, len(_CORNERS), 3))
        for axis, (second, third) in enumerate(((1, 2), (2, 0), (0, 1))):  # np.cross takes five times as long
            around = turning[:, :, second] * arm[:, :, third] - turning[:, :, third] * arm[:, :, second]
            velocity[:, :, axis] = twist[:, 3 + axis, None] + around
        return velocity.reshape(-1, 3)

    def _changes(
        self, model: mujoco.MjModel, data: mujoco.MjData, corner: Float, velocity: Float, which: NDArray[np.intp]
    ) -> Float:
        """Changes of the joints' speeds by the strikes of some corners, each on its own, (2 k, n) [rad/s]."""
        ways = np.zeros((len(which), 3, model.nv))
        for way, number in zip(ways, which.tolist(), strict=True):
            mujoco.mj_jac(model, data, way, None, corner[number], self._feet[number // len(_CORNERS)])
        mujoco.mj_crb(model, data)
        mujoco.mj_factorM(model, data)
        answer = np.zeros((3 * len(which), model.nv))
        mujoco.mj_solveM(model, data, answer, ways.reshape(-1, model.nv))
        answers = answer.reshape(ways.shape)
        impulse = _impulses(ways @ answers.transpose(0, 2, 1), velocity[which])
        found: Float = (impulse @ answers)[:, :, self._robot.dof_address].reshape(-1, self._robot.n)
        return found


def _impulses(inverse_inertia: Float, velocity: Float) -> Float:
    """Impulses that stop corners: without friction, and with it, (k, 2, 3) [N·s].

    Args:
        inverse_inertia: J M^-1 J', change of a corner's velocity by an impulse, (k, 3, 3) [1/kg].
        velocity: of the corners that come down, (k, 3) [m/s].
    """
    impulse = np.zeros((len(velocity), 2, 3))
    upward = inverse_inertia[:, 2, 2]
    impulse[:, :, 2] = (-velocity[:, 2] / upward)[:, None]
    stuck = np.linalg.solve(inverse_inertia, -velocity[:, :, None])[:, :, 0]
    along = np.hypot(stuck[:, 0], stuck[:, 1])
    # A floor does not pull: where the corner could stick only so, it slides.
    pressed = stuck[:, 2] > 0.0
    share = np.where(pressed, along / np.where(pressed, stuck[:, 2], 1.0), FRICTION)
    slides = np.minimum(share, FRICTION)
    against = stuck[:, :2] * (slides / np.maximum(along, 1e-12))[:, None]
    # Sliding or not, the upward part of the velocity ends. The sum is positive, as it is without friction and stuck.
    impulse[:, 1, 2] = -velocity[:, 2] / (upward + (inverse_inertia[:, 2, :2] * against).sum(axis=1))
    impulse[:, 1, :2] = against * impulse[:, 1, 2, None]
    return impulse
