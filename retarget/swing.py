"""`Swings`: the paths of a robot's feet during steps, and how long they take, from what its servos give.

Made once for a robot: the fastest shape for each of a few travels ahead (`swing_shapes.py`), then the shortest time of
that shape for travels ahead, aside and with a turn (`swing_effort.py`). Swings that take longer have the same shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot
from flexmotion.retarget.legs import Leg
from flexmotion.retarget.swing_effort import SwingEffort
from flexmotion.retarget.swing_shapes import TOLERANCE, Basis, Shape, between, fastest_shape

Float = NDArray[np.float64]

_SHAPED = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2)
"""Travels ahead and back for which a shape is found, over the length of a leg. Shorter ones have a mix of the two
shortest: the progress of a foot that goes nowhere is not determined."""
_FIRST_SHAPED = 6
"""The travel whose shape is found first, that of fast walks; the others are found from their neighbours."""
_ASIDE = (-0.5, -0.25, 0.0, 0.25, 0.5)
"""Travels to the side, over the length of a leg; positive is outward."""
_TURNS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Turns, over the greatest that a foot can make; positive is outward."""
_STRETCHED = np.array([0.85, 1.0, 1.12, 1.25, 1.45, 1.75, 2.2])
"""Durations at which swings aside and with a turn are measured, over the shortest straight ahead."""
_FINE = np.linspace(1.0, 0.0, 65)
"""Shares of a travel that are tried for the greatest one."""
_FAST, _SLOW = 0.98, 0.8
"""Shares of the robot's best speed in a steady walk: of its longest stride, and of its shortest swing."""
_BRISK = 0.92, 0.95, 0.97
"""Shares of it in a steady walk with room for disturbances: of its shortest swing, its best and its longest."""
_LONGEST_S = 2.0
"""Longest swing [s]."""
_OUTLINE = np.linspace(0.0, 1.0, 129)
"""Phases at which the shapes are kept; between them they are interpolated."""


@dataclass(frozen=True, eq=False)
class Swings:
    """Swings of one robot; travels of the left foot, of the right foot they are mirrored.

    Attributes:
        ahead, aside, turns: travels of the table, ascending, (A,), (S,), (Y,) [m, m, rad].
        shortest: shortest swing for each, (A, S, Y) [s]; infinite where the leg cannot reach.
        progress, lift: of a swing over `_OUTLINE` for each travel ahead, (A, P): share of the way, and height over the
            clearance.
        clearance: height over the floor that a foot has in the middle of its way, at least [m].
        pause_s: shortest double support [s].
    """

    ahead: Float
    aside: Float
    turns: Float
    shortest: Float
    progress: Float
    lift: Float
    clearance: float
    pause_s: float

    @classmethod
    def of(cls, robot: Robot, legs: tuple[Leg, Leg], omega: float) -> Swings:
        """The swings of a robot.

        Args:
            robot: whose servos swing the legs.
            legs: left and right.
            omega: natural frequency of its pendulum [1/s].

        Raises:
            RetargetError: its servos cannot swing a leg.
        """
        return _made(_Key(str(robot.file), SwingEffort(robot, legs, omega)))

    def path(self, phase: Float, side: int, start: Float, target: Float) -> Float:
        """Sole centre and yaw during a swing.

        Args:
            phase: 0 at lift-off, 1 at touch-down, (T,).
            side: of the foot, 0 left, 1 right.
            start, target: x, y, z, yaw, (4,) [m, m, m, rad].

        Returns:
            (T, 4) [m, m, m, rad].
        """
        ahead = min(max(_travel(side, start, target)[0], float(self.ahead[0])), float(self.ahead[-1]))
        above = min(max(int(self.ahead.searchsorted(ahead)), 1), len(self.ahead) - 1)
        share = (ahead - self.ahead[above - 1]) / (self.ahead[above] - self.ahead[above - 1])
        progress, lift = (
            np.interp(phase, _OUTLINE, (1.0 - share) * shapes[above - 1] + share * shapes[above])
            for shapes in (self.progress, self.lift)
        )
        path: Float = start + progress[:, None] * (target - start)
        path[:, 2] += self.clearance * lift
        return path

    def shortest_s(self, side: int, start: Float, target: Float) -> float:
        """Duration of the shortest swing between two poses of a foot, (4,) [m, m, m, rad], in [s].

        Beyond the table it grows with the travel.
        """
        travel = _travel(side, start, target)
        most = self.ahead[0 if travel[0] < 0.0 else -1], self.aside[-1], self.turns[-1]
        beyond = max(1.0, *(abs(way / float(end)) for way, end in zip(travel, most, strict=True)))
        ahead, aside, turn = (way / beyond for way in travel)
        found = beyond * float(np.interp(ahead, self.ahead, self._shortest(aside, turn)))
        return min(found, _LONGEST_S)

    def farthest(self, side: int, start: Float, target: Float, seconds: float) -> Float:
        """The target, or as near to it as the foot gets in time: it goes less far ahead, aside and turning as asked.

        Args:
            side: of the foot; start, target: of the swing, (4,) [m, m, m, rad].
            seconds: duration of the swing [s].

        Returns:
            The pose of the foot, (4,) [m, m, m, rad]; also where that is too fast without going ahead at all.
        """
        if self.shortest_s(side, start, target) <= seconds:
            return target
        ahead, aside, turn = _travel(side, start, target)
        beyond = max(1.0, abs(aside) / self.aside[-1], abs(turn) / self.turns[-1])  # as in `shortest_s`
        shortest = beyond * self._shortest(aside / beyond, turn / beyond)
        tried = ahead * _FINE
        within = np.interp(tried / beyond, self.ahead, shortest, left=np.inf, right=np.inf) <= seconds
        less = ahead - float(tried[np.argmax(within)] if within.any() else 0.0)
        yaw = 0.5 * (start[3] + target[3])
        bounded: Float = target - less * np.array([np.cos(yaw), np.sin(yaw), 0.0, 0.0])
        return bounded

    def stride(self, seconds: float, backward: bool = False) -> float:
        """How far one foot may be ahead of the other in a steady walk: half of the longest swing of this time [m]."""
        travels, shortest = self._straight(backward)
        return 0.5 * float(np.interp(seconds, shortest, travels, left=0.0))

    def stride_s(self, ahead: float) -> float:
        """Duration of the shortest swing with which one foot may be so far ahead of the other in a steady walk [s].

        Args:
            ahead: negative: behind [m].
        """
        travels, shortest = self._straight(ahead < 0.0)
        return float(np.interp(2.0 * abs(ahead), travels, shortest))

    @property
    def longest_stride(self) -> float:
        """The stride of a steady walk that is nearly as fast as the robot can walk [m]."""
        return self._steady(_FAST)[0]

    @property
    def brisk_s(self) -> tuple[float, float, float]:
        """Shortest, best and longest swing of fast walks that leave room for disturbances [s]."""
        shortest, best, longest = (self._steady(share)[1] for share in _BRISK)
        return shortest, best, longest

    @property
    def speed(self) -> float:
        """The speed of that walk, as far as swings bound it [m/s]."""
        stride, seconds = self._steady(_FAST)
        return stride / (seconds + self.pause_s)

    @property
    def least_s(self) -> float:
        """Shortest swing that is made [s]: shorter ones get the robot nowhere."""
        return self._steady(_SLOW)[1]

    @lru_cache(maxsize=8)  # noqa: B019 - the table is read-only and lives as long as the robot
    def _steady(self, share: float) -> tuple[float, float]:
        """Stride [m] and swing [s] of the steady walk of shortest strides that has this share of the best speed."""
        travels, shortest = self._straight(False)
        stride = 0.5 * travels[-1] * _FINE[::-1]
        seconds = np.interp(2.0 * stride, travels, shortest)
        speed = stride / (seconds + self.pause_s)
        found = int(np.argmax(speed >= share * speed.max()))
        return float(stride[found]), float(seconds[found])

    @lru_cache(maxsize=2)  # noqa: B019 - the table is read-only and lives as long as the robot
    def _straight(self, backward: bool) -> tuple[Float, Float]:
        """Lengths of straight travels from 0 on, and their shortest swings, none shorter than one before, (A',)."""
        column = self.shortest[:, len(self.aside) // 2, len(self.turns) // 2]
        middle = int(np.searchsorted(self.ahead, 0.0))
        own = slice(middle, None, -1) if backward else slice(middle, None)
        return np.abs(self.ahead[own]), np.maximum.accumulate(column[own])

    def _shortest(self, aside: float, turn: float) -> Float:
        """Shortest swings for all travels ahead with a travel aside and a turn, (A,) [s]."""
        column = _between(self.aside, aside, self.shortest.transpose(1, 0, 2))
        return _between(self.turns, turn, column.T)


def _travel(side: int, start: Float, target: Float) -> tuple[float, float, float]:
    """Travel of a foot ahead, outward and turning outward, in the frame midway [m, m, rad]."""
    (from_x, from_y, _, from_yaw), (x, y, _, yaw) = start.tolist(), target.tolist()
    midway, outward = 0.5 * (from_yaw + yaw), 1.0 if side == 0 else -1.0
    c, s, dx, dy = cos(midway), sin(midway), x - from_x, y - from_y
    return c * dx + s * dy, outward * (c * dy - s * dx), outward * (yaw - from_yaw)


def _between(nodes: Float, value: float, table: Float) -> Float:
    """Linear interpolation in the first axis of a table; infinite beyond its ends."""
    if not nodes[0] <= value <= nodes[-1]:
        return np.full(table.shape[1:], np.inf)
    above = min(max(int(nodes.searchsorted(value)), 1), len(nodes) - 1)
    low, high = float(nodes[above - 1]), float(nodes[above])
    share = (value - low) / (high - low)
    if share == 0.0 or share == 1.0:
        return table[above - 1 if share == 0.0 else above]
    mixed: Float = (1.0 - share) * table[above - 1] + share * table[above]
    return mixed


class _Key:
    """A robot's swing leg; two with the same figures are equal, so that their swings are made once."""

    def __init__(self, file: str, effort: SwingEffort) -> None:
        self.file, self.effort = file, effort
        self._figures = effort.figures().tobytes()

    def __hash__(self) -> int:
        return hash(self._figures)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self._figures == other._figures


@lru_cache(maxsize=8)
def _made(key: _Key) -> Swings:
    effort = key.effort
    gait, length = effort.gait, effort.leg.thigh + effort.leg.shank
    aside = length * np.array(_ASIDE)
    turns = (gait.max_foot_yaw + gait.max_toe_in) * np.array(_TURNS)
    ahead, shapes = _shapes(key, length * np.array(_SHAPED))
    shortest = [_shortest(effort, shape, travel, aside, turns) for shape, travel in zip(shapes, ahead, strict=True)]
    outline = Basis.at(_OUTLINE)
    return Swings(
        ahead=ahead,
        aside=aside,
        turns=turns,
        shortest=np.array(shortest),
        progress=np.array([outline.progress(shape) for shape in shapes]),
        lift=np.array([outline.height(shape) for shape in shapes]),
        clearance=gait.clearance,
        pause_s=gait.double_support_min_s,
    )


def _shapes(key: _Key, lengths: Float) -> tuple[Float, list[Shape]]:
    """Travels ahead, ascending, and their shapes: back and ahead by lengths as far as the servos swing the leg, and 0.

    Raises:
        RetargetError: not even as far as the shortest of the lengths.
    """
    travels, shapes = [], []
    for sign in (-1.0, 1.0):
        own = _outward(key.effort, sign * lengths)
        if not own:
            gait = key.effort.gait
            raise RetargetError(
                f"{key.file}: the servos cannot swing a leg by {lengths[0]:.3f} m: lower gait.clearance "
                f"({gait.clearance:g} m) or change gait.walk_hip_height ({gait.walk_hip_height:g} m)"
            )
        travels += list(sign * lengths[: len(own)])
        shapes += own
    back = sum(travel < 0.0 for travel in travels)
    travels.append(0.0)
    shapes.append(between(shapes[0], shapes[back]))
    order = np.argsort(travels)
    return np.array(travels)[order], [shapes[k] for k in order]


def _outward(effort: SwingEffort, travels: Float) -> list[Shape]:
    """Shapes of travels that grow, from the first on, as far as the servos swing the leg.

    The first that is found is that of `_FIRST_SHAPED`, or of a shorter one where the servos cannot make it; from there
    on they are found downward, then upward. Where the way down breaks off they are found from the shortest travel on.
    """
    for number in range(min(_FIRST_SHAPED, len(travels) - 1), -1, -1):
        if down := _one_by_one(effort, travels[number::-1]):
            break
    if len(down) <= number:
        return _one_by_one(effort, travels)
    return down[::-1] + _one_by_one(effort, travels[number + 1 :], down[0])


def _one_by_one(effort: SwingEffort, travels: Float, near: Shape | None = None) -> list[Shape]:
    """Shapes of travels, as far as the servos swing the leg: each from the one before, or without it where that fails.

    Args:
        near: one like the first; None: there is none.
    """
    found = list[Shape]()
    for travel in travels:
        shape = fastest_shape(effort, _ahead(travel), near)
        if shape is None and near is not None:
            shape = fastest_shape(effort, _ahead(travel))
        if shape is None:
            break
        found.append(shape)
        near = shape
    return found


def _ahead(travel: float) -> Float:
    return np.array([travel, 0.0, 0.0])


def _shortest(effort: SwingEffort, shape: Shape, ahead: float, aside: Float, turns: Float) -> Float:
    """Shortest swings of a shape that also go aside and turn, (S, Y) [s]; infinite where the leg cannot reach."""
    basis = Basis.at(effort.phase)
    seconds = shape.seconds * _STRETCHED
    cells = np.array(np.meshgrid([ahead], aside, turns, seconds, indexing="ij")).reshape(4, -1).T
    rows = len(cells), len(effort.phase)
    progress, lift = np.broadcast_to(basis.progress(shape), rows), np.broadcast_to(basis.height(shape), rows)
    asked = effort.asked(progress, effort.gait.clearance * lift, cells[:, :3], cells[:, 3])
    most = np.abs(np.nan_to_num(asked, nan=np.inf)).reshape(len(aside), len(turns), len(seconds), -1).max(axis=-1)
    found = np.full(most.shape[:2], np.inf)
    for place in np.ndindex(found.shape):
        beyond = np.flatnonzero(most[place] > 1.0 + TOLERANCE)
        last = int(beyond[-1]) if len(beyond) else -1
        if last < 0:
            found[place] = seconds[0]
        elif last + 1 < len(seconds):
            # What the rotors ask falls with the square of the duration.
            low, high = most[place][last], most[place][last + 1]
            share = (low - 1.0) / (low - high) if np.isfinite(low) else 1.0
            found[place] = seconds[last] + min(share, 1.0) * (seconds[last + 1] - seconds[last])
    return found
