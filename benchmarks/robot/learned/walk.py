"""`Walk`: one episode: the robot is to walk ahead at a speed, by a gait and the corrections of a policy.

A policy acts at half the loop's rate, and sees what the loop has, all as old as the bus makes it: tilt and gyroscope,
the turn of the torso that the gyroscope adds up, encoders, and the speed over the standing foot. It corrects the gait's
leg angles and shoulders, and how fast the cycle goes on. In the second half of a cycle it sees, and moves, the robot's
mirror image: left and right are one task. The reward, and what a critic sees besides, may use the true state.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.robot.learned.gait import GaitTable
from benchmarks.robot.learned.ground import Ground
from benchmarks.robot.learned.walker import Walker
from flexmotion.configs.robot import Robot
from flexmotion.drivers.sim.options import SimOptions

Float = NDArray[np.float64]

TICKS = 2
"""Ticks of the loop that an action holds: 62.5 Hz."""
ACTIONS, SEEN, PRIVATE = 15, 54, 12
"""Numbers of an action, of an observation, and of what the critic sees besides."""
REACH = 0.25
"""Angle that an action of 1 adds to a joint [rad]."""
HURRY = 0.25
"""Share by which an action of 1 speeds the cycle up."""
SMOOTHING = 0.5
"""Weight of a new action in the corrections: a first-order low-pass."""
BLEND_S, RAMP_S = 0.4, 1.5
"""From the stand pose into the gait, and from rest to the asked speed [s]."""
SPEED_S = 0.4
"""Time constant of the speed that is rewarded [s]: about half a cycle."""
CLEARANCE_M = 0.012
"""Height of a sole in the middle of its swing below which it is penalised [m]."""


class Walk:
    """One robot, episode after episode.

    Args:
        robot: to simulate; one without a six-axis leg is refused.
        table: of the gait.

    Attributes:
        seen: observation of the newest tick, (SEEN,); private: of the critic, (PRIVATE,).
        speed: asked for [m/s].
        ground: what the feet do.
        walker: the robot; None before the first `begin`.
    """

    def __init__(self, robot: Robot, table: GaitTable) -> None:
        self.robot, self.table = robot, table
        self.seen, self.private = np.zeros(SEEN), np.zeros(PRIVATE)
        self.speed = 0.0
        self._stand, self._legs = robot.stand_pose, table.legs
        self._q, self._qd = np.zeros(robot.n), np.zeros(robot.n)
        self._previous, self._correction = np.zeros(ACTIONS), np.zeros(ACTIONS)
        self._base = np.zeros((2, 6))
        self._dt = 1.0 / robot.rate_hz

    def begin(self, options: SimOptions, speed: float, *, right_first: bool = False) -> None:
        """Stand, about to walk at a speed [m/s]."""
        self.walker = Walker(self.robot, options)
        self.walker.open()
        self.ground = Ground(self.walker.driver)
        self.ground.update()
        self._options, self.speed = options, speed
        # The middle of the double support before the left foot, or the right one, lifts.
        self.phase = (-0.5 * (0.5 - self.table.gait.swing) + 0.5 * right_first) % 1.0
        self._previous[:] = self._correction[:] = 0.0
        self.velocity = np.zeros(2)
        self._position = self.ground.position.copy()
        self._base[:] = self._stand[self._legs]
        self._right_share = 0.5
        self.walker.read(self._right_share)
        self._observe()

    @property
    def time(self) -> float:
        """Since `begin` [s]."""
        return self.walker.ticks * self._dt

    @property
    def fell(self) -> bool:
        """Whether the robot has fallen."""
        return self.walker.fell

    @property
    def asked(self) -> float:
        """Speed asked for now: it rises from rest [m/s]."""
        return self.speed * min(self.time / RAMP_S, 1.0)

    def step(self, action: Float) -> float:
        """Let `TICKS` ticks pass under an action, (ACTIONS,), of which [-1, 1] counts; returns the reward."""
        action = np.clip(action, -1.0, 1.0)
        change = action - self._previous
        own = mirrored_action(action) if self.mirrored else action
        self._previous[:] = action
        for tick in range(TICKS):
            if tick:
                self.walker.read(self._right_share)
            self._correction += SMOOTHING * (own - self._correction)
            self._tick()
            if self.fell:
                break
        self.ground.update()
        reward = self._reward(change)
        mirrored = self.mirrored
        self.walker.read(self._right_share)
        self._observe()
        if self.mirrored != mirrored:
            self._previous[:] = mirrored_action(self._previous)
            self._observe()
        return reward

    @property
    def mirrored(self) -> bool:
        """Whether the policy sees the mirror image: the right foot's half of the cycle."""
        return self.phase >= 0.5

    def _tick(self) -> None:
        walker, table, correction = self.walker, self.table, self._correction
        gait, asked = table.gait, self.asked
        pace = (1.0 + HURRY * correction[14]) / gait.period
        self.phase = (self.phase + pace * self._dt) % 1.0
        angles, slopes, loads = table.at(self.phase, asked)
        blend = min(self.time / BLEND_S, 1.0)
        self._base[:], self._right_share = angles, float(loads[1])
        angles = angles + table.feedback(loads, walker.estimator.tilt, walker.estimator.tilt_rate)
        angles += REACH * correction[:12].reshape(2, 6)
        q, qd = self._q, self._qd
        q[:], qd[:] = self._stand, 0.0
        q[self._legs] = (1.0 - blend) * q[self._legs] + blend * angles
        qd[self._legs] = blend * gait.lead * pace * slopes
        q[table.shoulders] += blend * table.arms(self.phase, asked) + REACH * correction[12:14]
        walker.follow(q, qd)

    def _observe(self) -> None:
        """Fill `seen` and `private`."""
        state, estimator, seen = self.walker.state, self.walker.estimator, self.seen
        side = -1.0 if self.mirrored else 1.0
        order = slice(None, None, -1) if self.mirrored else slice(None)
        around = 4.0 * math.pi * self.phase
        seen[0], seen[1], seen[2] = math.sin(around), math.cos(around), 3.0 * self.asked
        seen[3], seen[4] = 4.0 * side * estimator.tilt[0], 4.0 * estimator.tilt[1]
        seen[5] = 4.0 * side * estimator.odometry[2]
        seen[6:9] = 0.5 * state.gyro * (side, 1.0, side)
        seen[9], seen[10], seen[11] = 0.1 * side * state.accel[1], 0.1 * state.accel[0], 0.1 * (state.accel[2] - 9.81)
        seen[12:24] = 4.0 * side * (state.position[self._legs] - self._base)[order].ravel()
        seen[24:36] = 0.2 * side * state.velocity[self._legs][order].ravel()
        seen[36:51] = self._previous
        seen[51] = min(self.time / RAMP_S, 1.0)
        seen[52], seen[53] = 3.0 * estimator.com_velocity[0], 5.0 * side * estimator.com_velocity[1]
        private, ground = self.private, self.ground
        private[0], private[1] = 5.0 * self.velocity[0], 5.0 * side * self.velocity[1]
        private[2:4] = np.clip(ground.load[order] / 30.0, 0.0, 2.0)
        private[4:6] = 20.0 * ground.height[order]
        private[6] = 5.0 * (ground.position[2] - 0.26)
        options = self._options
        private[7] = 10.0 * (options.kp_scale - 1.0)
        private[8] = 2.0 * ((options.friction or 0.8) - 0.8)
        private[9] = 200.0 * options.extra_latency_s
        private[10] = 2.0 * ((options.total_mass or self.robot.mass) - 3.2)
        private[11] = options.slope_deg[0]

    def _reward(self, change: Float) -> float:
        ground, estimator, seconds = self.ground, self.walker.estimator, TICKS * self._dt
        moved = (ground.position - self._position)[:2] / seconds
        self._position[:] = ground.position
        self.velocity += (seconds / SPEED_S) * (moved - self.velocity)
        asked = self.asked
        along = min(self.velocity[0], asked) - max(self.velocity[0] - 1.1 * asked, 0.0)
        usable = self.robot.usable_torque
        loaded = np.clip(ground.load / 15.0, 0.0, 1.0)
        half = self.phase % 0.5 / self.table.gait.swing
        low = 0.0
        if 0.3 < half < 0.7:
            foot = 0 if self.phase < 0.5 else 1
            low = max(CLEARANCE_M - float(ground.height[foot]), 0.0) / CLEARANCE_M
        turn = float(estimator.odometry[2])
        roll, pitch = estimator.tilt
        return (
            0.4
            + 4.0 * along
            - 1.0 * abs(self.velocity[1])
            - 1.5 * min(abs(turn), 0.5)
            - 2.0 * (roll * roll + (pitch - self.table.gait.lean) ** 2)
            - 0.02 * float(change @ change)
            - 0.02 * float(self._previous @ self._previous)
            - 0.4 * float(np.square(ground.torque / usable).mean())
            - 0.4 * float((loaded * np.minimum(ground.slip, 0.5)).sum())
            - 0.8 * low
            - (5.0 if self.fell else 0.0)
        )


def mirrored_action(action: Float) -> Float:
    """The action of the mirror image, (ACTIONS,): sides change places, and with them the signs of angles."""
    other = np.empty_like(action)
    other[:6], other[6:12] = -action[6:12], -action[:6]
    other[12], other[13], other[14] = -action[13], -action[12], action[14]
    return other
