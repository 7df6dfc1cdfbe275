"""`Reach`: joint angles that bring a robot's hand to a place, or its arm into a direction, clear of its body.

Damped least squares with the analytic Jacobian (Nakamura and Hanafusa 1986), within the joint limits, for all starts at
once: the arm as it is, and the nearest of a table of configurations that are clear of the body, and of the other arm
where it is. A result that touches them is drawn back along the way from its start until it is clear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.retarget.arm_distance import ArmDistance
from flexmotion.retarget.legs import SIDE_NAMES
from flexmotion.retarget.spread_points import sobol

Float = NDArray[np.float64]

_TABLE = 9
"""Binary logarithm of the number of configurations in the table of each arm."""
_STARTS = 10
"""Configurations of the table that are begun from: those with the nearest hands, clear of the other arm."""
_CHECKED = 48
"""Nearest ones that are checked for it."""
_ITERATIONS = 30
_LONGEST = 0.3
"""Longest step of a joint in an iteration [rad]."""
_DAMPING = 1e-3
"""Added to the squared lever arms, over the squared length of the arm."""
_SAME = 2e-3
"""Results that are this near to the best are as good: the one with the shortest way counts [m]."""
_MISSING = 0.25
"""Share of the distance kept from the body that may be missing."""
_HALVINGS = 6
_WAY = np.linspace(0.0, 1.0, 9)[1:-1]
"""Places on the way from the arm as it is at which it should be clear of the body."""
_STRAIGHT = 0.97
"""Length of an arm that points, over its greatest."""


@dataclass(frozen=True)
class Reached:
    """The best that an arm can do.

    Attributes:
        angles: of the arm's joints, from torso to hand, (m,) [rad].
        hand: place of the hand, (3,) [m], trunk frame.
        error: distance from the place that was asked [m], or angle from the direction [rad].
    """

    angles: Float
    hand: Float
    error: float


class Reach:
    """Solves the arms of one robot.

    Args:
        robot: the robot file.
        chain: its arms; distance: of their forearms from the body.
    """

    def __init__(self, robot: Robot, chain: ArmChain, distance: ArmDistance) -> None:
        self._chain, self._distance = chain, distance
        self._allowed = _MISSING * distance.kept
        self._damping = _DAMPING * float(chain.lengths.sum(axis=1).mean()) ** 2
        self._speed = robot.no_load_speed[chain.joints]
        count = chain.joints.shape[1]
        share = sobol(_TABLE, count)
        self._table = [self._clear_ones(robot, side, share) for side in (0, 1)]

    def _clear_ones(self, robot: Robot, side: int, share: Float) -> tuple[Float, Float]:
        """Configurations of one arm that are clear of the robot in its stand pose, (K, m), and their hands, (K, 3)."""
        angles = self._chain.lower[side] + share * (self._chain.upper - self._chain.lower)[side]
        clear = self._missing(side, angles, robot.stand_pose) <= self._allowed
        angles = np.concatenate([angles[clear], robot.stand_pose[self._chain.joints[side]][None]])
        return angles, self._hands(side, angles)[0]

    def to_place(self, side: int, place: Float, q: Float) -> Reached:
        """The arm whose hand is at a place in the trunk frame (3,) [m], or as near as it gets.

        Args:
            side: 0 left, 1 right.
            q: all joint angles now, (n,) [rad]: where the arm starts, and what else it keeps clear of.

        Raises:
            ConfigError: the other arm is in the way wherever this one could go.
        """
        angles, hands = self._solve(side, place, q)
        errors = np.linalg.norm(hands - place, axis=1)
        best = self._nearest(side, angles, errors, q)
        return Reached(angles[best], hands[best], float(errors[best]))

    def towards(self, side: int, direction: Float, q: Float) -> Reached:
        """The arm that points into a direction in the trunk frame (3,), from shoulder to hand, almost straight.

        Args:
            side, q: as of `to_place`; so are the errors.
        """
        unit = direction / np.linalg.norm(direction)
        stand = self._chain.poses(q[self._chain.joints])
        length = _STRAIGHT * float(self._chain.lengths[side].sum())
        angles, hands = self._solve(side, stand.shoulder[side] + length * unit, q)
        arms = self._chain.poses(self._both(side, angles))
        along = hands - arms.shoulder[:, side]
        cosine = along @ unit / np.linalg.norm(along, axis=1)
        errors = np.arccos(np.clip(cosine, -1.0, 1.0))
        best = self._nearest(side, angles, errors * length, q)
        return Reached(angles[best], hands[best], float(errors[best]))

    def farthest(self, side: int) -> float:
        """Greatest distance of a hand from its shoulder [m]."""
        return float(self._chain.lengths[side].sum())

    def _solve(self, side: int, place: Float, q: Float) -> tuple[Float, Float]:
        """Clear configurations near a place, (K, m) [rad], and their hands, (K, 3) [m]."""
        table, hands = self._table[side]
        near = np.argsort(np.linalg.norm(hands - place, axis=1))[:_CHECKED]
        now = np.clip(q[self._chain.joints[side]], self._chain.lower[side], self._chain.upper[side])
        starts = np.concatenate([now[None], table[near]])
        # The table is clear of the stand pose; the other arm may be elsewhere by now. What is drawn back ends at its
        # start at last, so that the start has to be clear as well.
        starts = starts[self._missing(side, starts, q) <= self._allowed][: _STARTS + 1]
        if not len(starts):
            raise ConfigError(f"the other arm is in the way of the {SIDE_NAMES[side]} one: relax it, or move it first")
        angles = self._drawn_back(side, starts, self._refined(side, starts, place), q)
        return angles, self._hands(side, angles)[0]

    def _refined(self, side: int, angles: Float, place: Float) -> Float:
        """Configurations (K, m) whose hands are nearer to a place, by damped least squares within the limits."""
        lower, upper = self._chain.lower[side], self._chain.upper[side]
        eye = self._damping * np.eye(angles.shape[1])
        for _ in range(_ITERATIONS):
            hands, jacobian = self._hands(side, angles)
            missing = place - hands
            pull = np.einsum("kmx,kx->km", jacobian, missing)
            # A joint at its limit that is pulled beyond it is left out.
            free = ~((angles <= lower) & (pull < 0.0) | (angles >= upper) & (pull > 0.0))
            jacobian = jacobian * free[:, :, None]
            # Damped where far, exact near the place: the damping shrinks with what is missing.
            weight = np.minimum(np.linalg.norm(missing, axis=1) / self._chain.lengths[side].sum(), 1.0)
            square = jacobian @ jacobian.swapaxes(1, 2) + (weight[:, None, None] + 1e-3) * eye
            step = np.linalg.solve(square, (pull * free)[:, :, None])[:, :, 0]
            step /= np.maximum(np.abs(step).max(axis=1, keepdims=True) / _LONGEST, 1.0)
            angles = np.clip(angles + step, lower, upper)
        return angles

    def _drawn_back(self, side: int, starts: Float, ends: Float, q: Float) -> Float:
        """`ends`, those that touch the body drawn back towards their `starts`, (K, m)."""
        clear = self._missing(side, ends, q) <= self._allowed
        low, high = np.where(clear, 1.0, 0.0), np.ones(len(ends))
        for _ in range(0 if clear.all() else _HALVINGS):
            middle = 0.5 * (low + high)
            fits = self._missing(side, starts + middle[:, None] * (ends - starts), q) <= self._allowed
            low, high = np.where(fits, middle, low), np.where(fits, high, middle)
        drawn: Float = starts + low[:, None] * (ends - starts)
        return drawn

    def _nearest(self, side: int, angles: Float, errors: Float, q: Float) -> int:
        """The best of some configurations: of those as near as any, a clear way first, then the shortest."""
        good = np.flatnonzero(errors <= errors.min() + _SAME)
        now = q[self._chain.joints[side]]
        way = (angles[good] - now)[:, None]
        places = (now + _WAY[:, None] * way).reshape(-1, angles.shape[1])
        touches = self._missing(side, places, q).reshape(len(good), -1).max(axis=1) > self._allowed
        seconds = (np.abs(way[:, 0]) / self._speed[side]).max(axis=1)
        return int(good[np.lexsort((seconds, touches))[0]])

    def _missing(self, side: int, angles: Float, q: Float) -> Float:
        """What lacks of the distance from the body, with the rest of the robot at `q` (n,), (K,) [m]."""
        rows = np.repeat(q[None], len(angles), axis=0)
        rows[:, self._chain.joints[side]] = angles
        missing: Float = self._distance.nearest(rows).missing[:, :, side].max(axis=0)
        return missing

    def _hands(self, side: int, angles: Float) -> tuple[Float, Float]:
        """Places (K, 3) [m] and Jacobians (K, m, 3) [m/rad] of the hands of one arm."""
        poses = self._chain.poses(self._both(side, angles))
        return poses.hand[:, side], poses.hand_jacobian[:, side]

    def _both(self, side: int, angles: Float) -> Float:
        """Angles of one arm (K, m) as of both, (K, 2, m)."""
        both = np.zeros((len(angles), 2, angles.shape[1]))
        both[:, side] = angles
        return both
