"""Where the head may be asked to be while both feet stand, and how hips and trunk bring it there.

A neck turns the head and moves it nowhere: its place follows from the height of the hips and from the trunk's roll and
pitch. The centre of mass stays over the middle of the feet, as in every stand: where the trunk leans, the hips go to
the other side. So three numbers give the three coordinates of the place, and nothing of the balance is used up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.retarget.bend import TrunkBend
from flexmotion.retarget.part_paths import path_places
from flexmotion.retarget.whole_body import WholeBody
from flexmotion.spatial.rotations import matrices, yaw_matrices

Float = NDArray[np.float64]

Place = tuple[float | None, float | None, float | None]
"""x, y, z from the middle between both soles [m]: x as they point, y left, z up. None: wherever the others lead."""

THERE_M = 0.003
"""A head that is this near to its place is there [m]."""
_STRAIGHTEST = 0.96
"""Share of the leg's length that a leg may use here. It is .92 on the way of a swing (`BENT_KNEE`); here the speed of
knees that are nearly straight is checked, and one leg is longer than the other where the trunk leans aside."""
_MARGIN_RAD = 0.03
"""Kept from the limits of the legs' joints: the balance feedback turns ankles and hips by that [rad]."""
_AWAY_M = 2e-3
"""A posture stands if its centre of mass is this close to the middle of the feet [m]."""
_MISSING_LEG = 1e-4
"""And its legs are not too short by more than this [m]."""
_STEEPEST, _BACK = 0.7, 0.3
"""Greatest roll and pitch forward, and pitch to the back, where no arm breaks a fall, that are tried [rad]."""
_POINTS = (4, 5, 6)
"""Heights, rolls and pitches at which the search begins: 3 cm, .35 and .2 rad apart."""
_FINEST = 2.0**-7
"""The search ends with steps of this share of the first ones: .2 mm, 3 and 2 mrad."""
_ROUNDS = 40
_PASSES = 3
_NUDGES, _NUDGE, _NUDGED_M = 4, 1e-3, 5e-4
"""Newton steps from a posture, differences by which they are taken [m, rad], and where they end [m]: arms shift a head
by 1 cm."""
_ROWS = 17
"""Moments of a way at which its torques are judged."""
_SHORTEST_S, _LONGEST_S = 0.2, 10.0
"""Bounds of its time [s]."""
_HALVINGS = 3
"""A way that needs too much is given twice the time until it does not; so often the last step is halved."""
_LOAD = 0.6
"""Greatest share of the servos' envelope that a way may need: the rest is for arms, balance feedback and gestures."""


@dataclass(frozen=True)
class HeadPosture:
    """Hips and trunk that bring the head to a place.

    Attributes:
        channels: of `POSTURE`, the yaw that of the feet, (4,) [m, rad].
        moved: to what the place was moved, in words; None: it is as asked.
    """

    channels: Float
    moved: str | None = None


class HeadPlaces:
    """Places of one robot's head.

    Args:
        robot: the robot file.
        body: of it; bend: how far its trunk may tilt.
    """

    def __init__(self, robot: Robot, body: WholeBody, bend: TrunkBend) -> None:
        self._robot, self._body, self._most_tilt = robot, body, bend.limit
        self._point = _point(robot)
        self._longest_leg = max(_STRAIGHTEST * body.leg_length, robot.gait.stand_hip_height)
        self._legs = np.concatenate([leg.indices for leg in body.legs])
        self._envelope = Envelope.of(robot)

    def nearest(
        self, place: Place, tolerance: float, feet: Float, upper: Float, begin: Float | None = None
    ) -> HeadPosture:
        """The posture whose head is nearest to a place.

        Args:
            place: asked for; tolerance: greatest distance from it [m].
            feet: poses of both soles, (2, 4) [m, m, m, rad].
            upper: angles of arms and head meanwhile, by `UpperBody.joints`, (C,) [rad].
            begin: a posture whose head was there with other arms, (4,) [m, rad]: where that is enough, the search is
                short and leads not far from it; None: it is of everything in reach.

        Raises:
            ConfigError: it is farther out of reach, and names the nearest place; or the robot file names no head.
        """
        if self._point is None:
            raise ConfigError(f"head: the robot file of {self._robot.name} names no point of a head (field head)")
        own = _about_middle(feet)
        asked = np.array([np.nan if value is None else value for value in place])
        known = np.isfinite(asked)

        def cost(tried: Float) -> Float:
            heads, stands = self._heads(tried, own, upper)
            return np.where(stands, np.linalg.norm((heads - asked)[:, known], axis=1), np.inf)

        # The trunk leans and bends for what is asked alone; and bends where the hips cannot be low enough.
        free = np.array([True, known[1], known[0]])
        near = None
        if begin is not None:
            near = self._nudged(begin[:3], asked, free | [False, False, begin[2] != 0.0], own, upper)
        found = self._search(cost, free) if near is None else near
        if not free[2] and cost(found[None])[0] > THERE_M:
            found = self._search(cost, free | [False, False, True])
        heads, stands = self._heads(found[None], own, upper)
        if not stands[0]:
            raise ConfigError("head: the robot cannot stand otherwise on feet as far apart as they are")
        head = heads[0]
        gap = float(np.linalg.norm((head - asked)[known]))
        told = ", ".join(f"{value:.3f}" for value in head)
        told = f"[{told}] m, {100 * gap:.1f} cm from there"
        if gap > max(tolerance, THERE_M):
            given = ", ".join("any" if value is None else f"{value:g}" for value in place)
            raise ConfigError(
                f"head: [{given}] m is out of reach while both feet stand; the nearest place is {told}, the tolerance "
                f"{100 * tolerance:g} cm"
            )
        channels = np.append(found, float(feet[:, 3].mean()))
        return HeadPosture(channels, told if gap > THERE_M else None)

    def place(self, channels: Float, feet: Float, upper: Float) -> Float:
        """Where the head is at a posture, from the middle between the soles, (3,) [m].

        Args:
            channels: of `POSTURE`, (4,) [m, rad]; feet, upper: as of `nearest`.
        """
        found: Float = self._heads(channels[None, :3], _about_middle(feet), upper)[0][0]
        return found

    def measured(self, q: Float) -> Float | None:
        """Where the head is by measured joints, from the middle between the soles and normal to them, (3,) [m].

        Args:
            q: all joint angles, (n,) [rad].

        Returns:
            None where a joint is not known, or the robot file names no head.
        """
        robot, feet = self._robot, list(self._robot.foot_ids)
        if self._point is None or not np.isfinite(q).all():
            return None
        data = mujoco.MjData(robot.model)
        data.qpos[robot.qpos_address] = q
        mujoco.mj_kinematics(robot.model, data)
        turns, torso = data.xmat[feet].reshape(2, 3, 3), robot.torso_id
        soles = data.xpos[feet] + np.einsum("fij,fj->fi", turns, robot.soles)
        up = turns[:, :, 2].sum(axis=0) / np.linalg.norm(turns[:, :, 2].sum(axis=0))
        ahead = turns[:, :, 0].sum(axis=0)
        ahead -= (ahead @ up) * up
        ahead /= np.linalg.norm(ahead)
        head = data.xpos[torso] + data.xmat[torso].reshape(3, 3) @ self._point - soles.mean(axis=0)
        found: Float = np.stack([ahead, np.cross(up, ahead), up]) @ head
        return found

    def seconds(self, begin: Float, goal: Float, feet: Float, upper: Float) -> float:
        """Least time for a way between postures, from rest to rest, within the legs' share of the envelope [s].

        Args:
            begin, goal: of `POSTURE`, (4,) [m, rad].
            feet, upper: as of `nearest`.

        Raises:
            ConfigError: no time is long enough: to stand at a posture on the way needs more.
        """
        share = path_places(np.linspace(0.0, 1.0, _ROWS), 1.0, 0.0, 0.5)
        channels = np.hstack([begin + share[:, None] * (goal - begin), np.broadcast_to(upper, (_ROWS, len(upper)))])
        own = np.broadcast_to(feet, (_ROWS, 2, 4))
        middle = np.broadcast_to(feet[:, :2].mean(axis=0), (_ROWS, 2))
        base, q, _, _ = self._body.solve(own, middle, channels, np.zeros(2), _PASSES, smooth=False)
        seconds = short = _SHORTEST_S
        while (load := self._load(base, q, own, seconds)) > _LOAD:
            if seconds >= _LONGEST_S:
                raise ConfigError(
                    f"head: the legs' servos need {load:.2f} of their envelope on a way of {_LONGEST_S:g} s there or "
                    f"back; expected {_LOAD:g} at most: ask for a place that is nearer to the stand"
                )
            short, seconds = seconds, min(2.0 * seconds, _LONGEST_S)
        for _ in range(_HALVINGS if seconds > short else 0):
            half = 0.5 * (short + seconds)
            needs = self._load(base, q, own, half)
            short, seconds = (half, seconds) if needs > _LOAD else (short, half)
        return seconds

    def _load(self, base: Float, q: Float, feet: Float, seconds: float) -> float:
        """Greatest share of the envelope of a leg's servo on a way that takes so long.

        The trunk turns by less than a radian: the rates of its rotation vector stand for its angular velocity.
        """
        step = seconds / (_ROWS - 1)
        turn = np.array([_turn_vector(base[0, 3:], pose) for pose in base[:, 3:]])
        moved = np.hstack([base[:, :3], turn, q])
        rate = np.gradient(moved, step, axis=0)
        pull = np.gradient(rate, step, axis=0)
        torque, _ = self._body.dynamics.inverse(
            base, rate[:, :6], pull[:, :6], q, rate[:, 6:], pull[:, 6:], feet, np.full(len(q), 0.5)
        )
        load = self._envelope.load(torque, rate[:, 6:])
        return float(load[:, self._legs].max())

    def _search(self, cost: Callable[[Float], Float], free: NDArray[np.bool_]) -> Float:
        """Height, roll and pitch of the least cost, (3,): a grid, then a pattern search that halves its steps.

        Args:
            cost: of many, (N, 3) to (N,), infinite where the robot cannot stand so.
            free: those that may be other than 0, (3,).
        """
        lower, upper = self._bounds(free)
        counts = np.where(free, _POINTS, 1)
        lines = [np.linspace(low, high, count) for low, high, count in zip(lower, upper, counts, strict=True)]
        grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
        step = (upper - lower) / (np.array(_POINTS) - 1)
        ways = [[-1.0, 0.0, 1.0] if one else [0.0] for one in free]
        around = np.stack(np.meshgrid(*ways, indexing="ij"), axis=-1).reshape(-1, 3)
        costs = cost(grid)
        best, least = grid[np.argmin(costs)], float(costs.min())
        share = 0.5
        for _ in range(_ROUNDS):
            tried = np.clip(best + share * step * around, lower, upper)
            costs = cost(tried)
            if costs.min() < least:
                best, least = tried[np.argmin(costs)], float(costs.min())
            elif share > _FINEST:
                share *= 0.5
            else:
                break
        return best

    def _nudged(self, begin: Float, asked: Float, free: NDArray[np.bool_], feet: Float, upper: Float) -> Float | None:
        """Height, roll and pitch near others whose head is where it is asked to be, (3,); None: Newton finds none.

        Args:
            asked: place, not a number where it is free, (3,) [m]; free: as of `_search`; feet, upper: as of `_heads`.
        """
        known, steps = np.isfinite(asked), _NUDGE * np.eye(3)[free]
        lower, highest = self._bounds(free)
        found = begin.copy()
        for _ in range(_NUDGES):
            heads, stands = self._heads(np.vstack([found[None], found - steps]), feet, upper)
            off = (asked - heads[0])[known]
            if np.linalg.norm(off) <= _NUDGED_M:
                return found if stands[0] else None
            slope = (heads[0] - heads[1:])[:, known] / _NUDGE
            found[free] += np.linalg.lstsq(slope.T, off)[0]
            if (found < lower).any() or (found > highest).any():
                return None
        return None

    def _bounds(self, free: NDArray[np.bool_]) -> tuple[Float, Float]:
        """Least and greatest heights, rolls and pitches that are tried, (3,) each; `free`: as of `_search`."""
        gait = self._robot.gait
        lower = np.where(free, [gait.min_hip_height, -_STEEPEST, -_BACK], 0.0)
        return lower, np.where(free, [gait.stand_hip_height, _STEEPEST, _STEEPEST], 0.0)

    def _heads(self, tried: Float, feet: Float, upper: Float) -> tuple[Float, NDArray[np.bool_]]:
        """Places of the head (N, 3) [m] at heights, rolls and pitches (N, 3), and which of these the robot can hold.

        Args:
            feet: about the middle between them, (2, 4) [m, m, m, rad]; upper: as of `nearest`.
        """
        assert self._point is not None  # `nearest` has refused it
        robot, body, rows = self._robot, self._body, len(tried)
        channels = np.hstack([tried, np.zeros((rows, 1)), np.broadcast_to(upper, (rows, len(upper)))])
        own = np.broadcast_to(feet, (rows, 2, 4))
        base, q, _, short = body.solve(own, np.zeros((rows, 2)), channels, np.zeros(2), _PASSES, smooth=False)
        away = np.linalg.norm(body.dynamics.centre_of_mass(base, q)[:, :2], axis=1)
        turned = matrices(base[:, 3:])
        tilt = np.arccos(np.clip(turned[:, 2, 2], -1.0, 1.0))
        legs = q[:, self._legs]
        low, high = robot.lower[self._legs] + _MARGIN_RAD, robot.upper[self._legs] - _MARGIN_RAD
        # A knee in the stand pose may be as straight as it is there.
        stand = robot.stand_pose[self._legs]
        within = ((legs >= np.minimum(low, stand)) & (legs <= np.maximum(high, stand))).all(axis=1)
        long = np.zeros(rows)
        for side, leg in enumerate(body.legs):
            hip = base[:, :3] + turned @ leg.hip
            ankle = feet[side, :3] - yaw_matrices(feet[side, 3:])[0] @ leg.sole
            long = np.maximum(long, np.linalg.norm(hip - ankle, axis=1))
        stands = within & (away <= _AWAY_M) & (short <= _MISSING_LEG) & (tilt <= self._most_tilt)
        stands &= long <= self._longest_leg
        assert self._point is not None
        return base[:, :3] + turned @ self._point, stands


def _point(robot: Robot) -> Float | None:
    """The head's point in the torso's frame, in the stand pose, (3,) [m]; None: the robot file names none."""
    head = robot.config.head
    if head is None:
        return None
    data = mujoco.MjData(robot.model)
    data.qpos[robot.qpos_address] = robot.stand_pose
    mujoco.mj_kinematics(robot.model, data)
    body, torso = data.body(head.body), robot.torso_id
    place = body.xpos + body.xmat.reshape(3, 3) @ np.asarray(head.point) - data.xpos[torso]
    found: Float = data.xmat[torso].reshape(3, 3).T @ place
    return found


def _about_middle(feet: Float) -> Float:
    """Both soles from the middle between them, along the mean of their headings, (2, 4) [m, m, m, rad]."""
    middle = feet.mean(axis=0)
    found = feet - middle
    found[:, :2] = found[:, :2] @ yaw_matrices(middle[3:])[0, :2, :2]
    return found


def _turn_vector(begin: Float, end: Float) -> Float:
    """Rotation vector from one quaternion w x y z to another, in the frame of the first, (3,) [rad]."""
    found = np.zeros(3)
    mujoco.mju_subQuat(found, end, begin)
    return found
