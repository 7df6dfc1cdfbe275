"""`PostureMove`: slow moves between poses with both feet on the ground: to the stand pose, and to the rest pose.

The torso is planned to be as its feet, flat on the ground, have it: parked out of a bow it comes up, and falls where it
does not.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.get_up import MINIMUM_JERK_PEAK
from flexmotion.configs.robot import Robot
from flexmotion.retarget.dynamics import RobotDynamics
from flexmotion.spatial.transitions import minimum_jerk
from flexmotion.streamer.control.reference import Reference

Float = NDArray[np.float64]

_KNOTS = 17
"""Poses on the path at which the holding torque is computed, all of them when the move begins; between them it is
interpolated. Computing one every tenth tick instead made each of those ticks as long as this one tick is now."""


class PostureMove:
    """A minimum-jerk path in joint space, with the torque that holds the robot up on it.

    Args:
        dynamics: the robot's inverse dynamics, for that torque.

    Attributes:
        tick, ticks: ticks of the move that are done, and all of them.
    """

    def __init__(self, robot: Robot, dynamics: RobotDynamics) -> None:
        self.robot, self.dynamics = robot, dynamics
        self.data = mujoco.MjData(robot.model)
        self._feet = list(robot.foot_ids)
        self.start, self.goal = np.zeros(robot.n), np.zeros(robot.n)
        self.ticks = self.tick = 0
        self._then: Callable[[], None] | None = None
        self._torque, self._attitude = np.zeros((_KNOTS, robot.n)), np.tile([1.0, 0.0, 0.0, 0.0], (_KNOTS, 1))

    def begin(self, start: Float, goal: Float, *, least_s: float, speed: float, through: Float | None = None) -> None:
        """Plan a move.

        Args:
            start, goal: poses, (n,) [rad].
            least_s: shortest duration [s].
            speed: greatest joint speed [rad/s].
            through: a pose on the way, where it comes to rest; each part takes as long as a move of its own.
        """
        self._then = None
        if through is not None:
            goal, self._then = through, partial(self.begin, through.copy(), goal.copy(), least_s=least_s, speed=speed)
        self.start[:], self.goal[:] = start, goal
        seconds = max(least_s, MINIMUM_JERK_PEAK * float(np.max(np.abs(goal - start), initial=0.0)) / speed)
        self.ticks, self.tick = max(int(np.ceil(seconds * self.robot.rate_hz)), 1), 0
        part = np.linspace(0.0, 1.0, _KNOTS)[:, None]
        torque, attitude = self._held(self.start + part * (self.goal - self.start))
        np.copyto(self._torque, torque)
        np.copyto(self._attitude, attitude)

    @property
    def done(self) -> bool:
        """Whether the goal has been reached."""
        return self.tick >= self.ticks and self._then is None

    def step(self, reference: Reference) -> None:
        """Fill `reference` for this tick and advance one tick."""
        if self.tick >= self.ticks and self._then is not None:
            self._then()
        s = np.array([self.tick, self.tick + 1]) / self.ticks
        now, after = minimum_jerk(s)
        span = self.goal - self.start
        np.copyto(reference.q, self.start + now * span)
        np.copyto(reference.qd, (after - now) * self.robot.rate_hz * span)
        place = now * (_KNOTS - 1)
        knot = min(int(place), _KNOTS - 2)
        part = place - knot
        np.copyto(reference.torque, self._torque[knot] + part * (self._torque[knot + 1] - self._torque[knot]))
        mean = self._attitude[knot] + part * (self._attitude[knot + 1] - self._attitude[knot])
        reference.base[3:] = mean / np.linalg.norm(mean)
        reference.stiffness.fill(1.0)
        reference.balanced = False
        self.tick = min(self.tick + 1, self.ticks)

    def _held(self, q: Float) -> tuple[Float, Float]:
        """Joint torques at rest, with the weight shared by the soles according to the centre of mass between them.

        Args:
            q: poses, (K, n) [rad].

        Returns:
            Torques (K, n) [N·m], and attitudes of the torso, quaternions w x y z of one sign, (K, 4).
        """
        robot, count = self.robot, len(q)
        foot, soles, com = self._feet_and_com(q)
        # Tilt the torso such that the soles lie flat on the ground.
        level = foot.swapaxes(1, 2)
        soles, com = soles @ foot, np.einsum("kij,kj->ki", level, com)
        base = np.zeros((count, 7))
        base[:, 3:] = Rotation.from_matrix(level).as_quat(scalar_first=True)
        across, away = (soles[:, 1] - soles[:, 0])[:, :2], (com - soles[:, 0])[:, :2]
        share = np.sum(across * away, axis=1) / np.maximum(np.sum(across**2, axis=1), 1e-6)
        feet = np.concatenate([soles, np.zeros((count, 2, 1))], axis=2)
        still, joints = np.zeros((count, 6)), np.zeros((count, robot.n))
        torque, _ = self.dynamics.inverse(
            base, still, still, q, joints, joints, feet, np.minimum(np.maximum(share, 0.0), 1.0)
        )
        attitude = base[:, 3:]
        return torque, attitude * np.where(attitude @ attitude[0] < 0.0, -1.0, 1.0)[:, None]

    def _feet_and_com(self, q: Float) -> tuple[Float, Float, Float]:
        """Attitude of the left foot (K, 3, 3), sole centres (K, 2, 3) and centre of mass (K, 3), in the torso frame."""
        robot, model, data = self.robot, self.robot.model, self.data
        rotations, places, com = np.empty((len(q), 2, 3, 3)), np.empty((len(q), 2, 3)), np.empty((len(q), 3))
        data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
        # Views, looked up once, as in `RobotDynamics.centre_of_mass`.
        qpos, xmat, xpos, centre = data.qpos, data.xmat, data.xpos, data.subtree_com[robot.torso_id]
        for k, row in enumerate(q):
            qpos[robot.qpos_address] = row
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            rotations[k], places[k], com[k] = xmat[self._feet].reshape(2, 3, 3), xpos[self._feet], centre
        return rotations[:, 0], places + (rotations @ robot.soles[:, :, None])[..., 0], com
