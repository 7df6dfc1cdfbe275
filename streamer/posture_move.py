"""Slow moves between poses with both feet on the ground: to the stand pose before streaming, to rest after it."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from configs.robot import Robot
from retarget.balance import smoothstep
from retarget.dynamics import RobotDynamics
from streamer.reference import Reference

Float = NDArray[np.float64]

_KNOT_TICKS = 10
"""The torque that holds the robot up is worked out this often and interpolated between: the moves are slow."""


class PostureMove:
    """A minimum-jerk path in joint space that carries the robot's weight on the way.

    Args:
        dynamics: the robot's inverse dynamics, for the torque that holds it up.
    """

    def __init__(self, robot: Robot, dynamics: RobotDynamics) -> None:
        self.robot, self.dynamics = robot, dynamics
        self.data = mujoco.MjData(robot.model)
        self.start, self.goal = np.zeros(robot.n), np.zeros(robot.n)
        self.ticks = self.tick = 0
        self._before, self._after = np.zeros(robot.n), np.zeros(robot.n)

    def begin(self, start: Float, goal: Float, *, least_s: float, speed: float) -> None:
        """Plan from `start` to `goal` (n,) [rad] in at least `least_s` and at no joint faster than `speed`."""
        self.start[:], self.goal[:] = start, goal
        # A minimum-jerk profile peaks at 15/8 of its mean speed.
        seconds = max(least_s, 1.875 * float(np.max(np.abs(goal - start), initial=0.0)) / speed)
        self.ticks, self.tick = max(int(np.ceil(seconds * self.robot.rate_hz)), 1), 0

    @property
    def done(self) -> bool:
        """Whether the goal has been reached."""
        return self.tick >= self.ticks

    def step(self, reference: Reference) -> None:
        """Fill `reference` for this tick and go on one."""
        s = np.array([self.tick, self.tick + 1]) / self.ticks
        now, after = smoothstep(s)
        span = self.goal - self.start
        np.copyto(reference.q, self.start + now * span)
        np.copyto(reference.qd, (after - now) * self.robot.rate_hz * span)
        if self.tick % _KNOT_TICKS == 0 and self.tick < self.ticks:
            ahead = smoothstep(np.array([(self.tick + _KNOT_TICKS) / self.ticks]))
            np.copyto(self._before, self._after if self.tick else self._holding_torque(reference.q))
            np.copyto(self._after, self._holding_torque(self.start + ahead * span))
        part = (self.tick % _KNOT_TICKS) / _KNOT_TICKS if self.tick < self.ticks else 1.0
        np.copyto(reference.torque, self._before + part * (self._after - self._before))
        reference.balanced = False
        self.tick = min(self.tick + 1, self.ticks)

    def _holding_torque(self, q: Float) -> Float:
        """Joint torques at rest with the weight on both soles, by where the centre of mass lies between them."""
        robot, data = self.robot, self.data
        data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
        data.qpos[robot.qpos_address] = q
        mujoco.mj_kinematics(robot.model, data)
        # Lean the torso so that the soles lie flat: that is how the ground holds the robot.
        level = data.xmat[robot.foot_ids[0]].reshape(3, 3).T
        data.qpos[3:7] = Rotation.from_matrix(level).as_quat(scalar_first=True)
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_comPos(robot.model, data)
        soles = np.stack(
            [
                data.xpos[body] + data.xmat[body].reshape(3, 3) @ sole
                for body, sole in zip(robot.foot_ids, robot.soles, strict=True)
            ]
        )
        across = (soles[1] - soles[0])[:2]
        away = (data.subtree_com[robot.torso_id] - soles[0])[:2]
        share = np.clip(across @ away / max(across @ across, 1e-6), 0.0, 1.0)
        feet = np.hstack([soles, np.zeros((2, 1))])
        still, base = np.zeros((1, 6)), data.qpos[None, :7].copy()
        joints = np.zeros((1, robot.n))
        torque, _ = self.dynamics.inverse(base, still, still, q[None], joints, joints, feet[None], np.array([share]))
        return torque[0]
