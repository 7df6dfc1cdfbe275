"""`PartSolver`: what an arm, the head or a joint is asked for, as joint angles that the robot can take."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.retarget.arm_distance import ArmDistance
from flexmotion.retarget.arms import UpperBody
from flexmotion.retarget.legs import SIDE_NAMES
from flexmotion.retarget.reach import Reach
from flexmotion.spatial.angle_words import told_angle, told_range

Float = NDArray[np.float64]

EXACT_M, EXACT_RAD = 0.003, math.radians(1.0)
"""Nearer than that counts as there [m, rad]."""
_THERE_RAD = math.radians(3.0)
"""A joint of a plan that is this near to its goal is there: paths end within 1° [rad]."""


@dataclass(frozen=True)
class Solved:
    """Joint angles for one part.

    Attributes:
        columns: places among `UpperBody.joints`, (K,).
        angles: there [rad], (K,).
        moved: to what it was moved, in words; None: it is as asked.
    """

    columns: NDArray[np.int64]
    angles: Float
    moved: str | None = None


class PartSolver:
    """Solves parts of one robot.

    Args:
        robot: the robot file; upper: its arms and head; distance: of its forearms from its body.
    """

    def __init__(self, robot: Robot, upper: UpperBody, distance: ArmDistance) -> None:
        self._robot, self._upper = robot, upper
        self._reach = Reach(robot, upper.chain, distance)

    def hand(self, side: str, place: Float, tolerance: float, q: Float) -> Solved:
        """An arm whose hand is at a place in the trunk's frame (3,) [m].

        Args:
            side: "left" or "right".
            tolerance: greatest distance from the place [m].
            q: all joint angles now, (n,) [rad].

        Raises:
            ConfigError: the place is farther out of reach; names the nearest one.
        """
        arm = SIDE_NAMES.index(side)
        found = self._reach.to_place(arm, place, q)
        moved = None
        if found.error > EXACT_M:
            told = ", ".join(f"{value:.3f}" for value in found.hand)
            moved = f"[{told}] m, {100 * found.error:.1f} cm from there"
        if found.error > max(tolerance, EXACT_M):
            raise ConfigError(
                f"hand: out of reach of the {side} hand, or inside the body; the nearest place is {moved}, "
                f"the tolerance {100 * tolerance:g} cm"
            )
        return Solved(self._arm(arm), found.angles, moved)

    def point(self, side: str, direction: Float, tolerance: float, q: Float) -> Solved:
        """An arm that points into a direction in the trunk's frame (3,).

        Args:
            side, q: as of `hand`; tolerance: greatest angle from the direction [rad].

        Raises:
            ConfigError: the arm cannot take a direction within it.
        """
        arm = SIDE_NAMES.index(side)
        found = self._reach.towards(arm, direction, q)
        moved = _turned("a direction", found.error)
        if found.error > max(tolerance, EXACT_RAD):
            raise ConfigError(
                f"point: the {side} arm cannot point there; nearest is {moved}, the tolerance "
                f"{math.degrees(tolerance):.0f}°"
            )
        return Solved(self._arm(arm), found.angles, moved)

    def look(self, direction: Float, tolerance: float) -> Solved:
        """The head looking into a direction in the trunk's frame (3,).

        Args:
            tolerance: greatest angle from the direction [rad].

        Raises:
            ConfigError: the head cannot take a direction within it, or there is none.
        """
        upper = self._upper
        if not upper.head:
            raise ConfigError(f"look: {self._robot.name} has no head that turns")
        x, y, z = direction
        wanted = {"pan": math.atan2(y, x), "tilt": -math.atan2(z, math.hypot(x, y))}
        turned = {"pan": 0.0, "tilt": 0.0}
        columns = np.arange(upper.arms.size, len(upper.joints))
        joints = upper.joints[columns]
        angles = np.zeros(len(joints))
        for role, joint in upper.head.items():
            sign, own = upper.head_sign(role), int(np.flatnonzero(joints == joint)[0])
            angles[own] = np.clip(sign * wanted[role], self._robot.lower[joint], self._robot.upper[joint])
            turned[role] = sign * float(angles[own])
        error = _angle(_gaze(**turned), np.asarray(direction, float))
        moved = _turned("a direction", error)
        if error > max(tolerance, EXACT_RAD):
            raise ConfigError(
                f"look: the head cannot look there; nearest is {moved}, the tolerance {math.degrees(tolerance):.0f}°"
            )
        return Solved(columns, angles, moved)

    def joint(self, name: str, angle: float, tolerance: float) -> Solved:
        """One joint of arms or head at an angle [rad].

        Args:
            tolerance: greatest distance of the angle from the joint's limits [rad].

        Raises:
            ConfigError: there is no such joint in arms and head, or the angle is farther beyond its limits.
        """
        robot, joints = self._robot, self._upper.joints
        names = [robot.joint_names[joint] for joint in joints]
        if name not in names:
            kind = "moves with the legs, which keep the balance" if name in robot.joint_names else "is not known"
            raise ConfigError(f"joint: {name!r} {kind}; expected one of: {', '.join(names)}")
        column = names.index(name)
        lower, upper = float(robot.lower[joints[column]]), float(robot.upper[joints[column]])
        clipped = min(max(angle, lower), upper)
        if abs(clipped - angle) > max(tolerance, EXACT_RAD):
            raise ConfigError(f"joint: {name}: {told_angle(angle)}, expected {told_range(lower, upper)}")
        moved = None if abs(clipped - angle) <= EXACT_RAD else f"{told_angle(clipped)}, the joint's limit"
        return Solved(np.array([column]), np.array([clipped]), moved)

    def kept_away(self, columns: NDArray[np.int64], angles: Float, q: Float) -> str | None:
        """How far a plan keeps a part from its goal, so that it stays clear of the body; None: it is there.

        Args:
            columns, angles: as of `Solved`.
            q: joint angles of the plan while the part is to be there, (T, n) [rad].
        """
        joints = self._upper.joints[columns]
        away = np.abs(q[:, joints] - angles).max(axis=1)
        row = int(away.argmax())
        if away[row] <= _THERE_RAD:
            return None
        text = f"{math.degrees(away[row]):.0f}° of a joint from there"
        wanted, chain = q[row].copy(), self._upper.chain
        wanted[joints] = angles
        for arm, own in enumerate(chain.joints):
            if np.isin(own, joints).all():
                there, hand = (chain.poses(one[chain.joints]).hand[arm] for one in (wanted, q[row]))
                told = ", ".join(f"{value:.3f}" for value in hand)
                text = f"[{told}] m, {100 * float(np.linalg.norm(hand - there)):.1f} cm from there"
        return f"{text}, clear of the body"

    def measured(self, columns: NDArray[np.int64], angles: Float, q: Float, *, place: bool) -> tuple[float | None, str]:
        """How far a part is from its goal, and that in words.

        Args:
            columns, angles: as of `Solved`.
            q: measured joint angles, (n,) [rad]; NaN where they are not known.
            place: the distance of the hand of the arm that these joints are [m]; else the greatest of a joint [rad].
        """
        joints, chain = self._upper.joints[columns], self._upper.chain
        if not np.isfinite(q[joints]).all():
            return None, "not measured"
        if not place:
            off = float(np.abs(q[joints] - angles).max())
            return off, f"{math.degrees(off):.1f}° of a joint from there"
        wanted = np.nan_to_num(q)
        wanted[joints] = angles
        arm = next(arm for arm, own in enumerate(chain.joints) if np.isin(own, joints).all())
        there, hand = (chain.poses(one[chain.joints]).hand[arm] for one in (wanted, np.nan_to_num(q)))
        off = float(np.linalg.norm(hand - there))
        return off, f"{100 * off:.1f} cm from there"

    def _arm(self, arm: int) -> NDArray[np.int64]:
        count = self._upper.arms.shape[1]
        return np.arange(arm * count, (arm + 1) * count)


def _gaze(pan: float, tilt: float) -> Float:
    """Direction of a head that is turned left and then down, (3,)."""
    return np.array([math.cos(pan) * math.cos(tilt), math.sin(pan) * math.cos(tilt), -math.sin(tilt)])


def _angle(one: Float, other: Float) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def _turned(what: str, error: float) -> str | None:
    return None if error <= EXACT_RAD else f"{what} {math.degrees(error):.0f}° from there"
