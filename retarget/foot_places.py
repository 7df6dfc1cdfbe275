"""Where a foot may be asked to stand: its place seen from the other foot, within what the robot's steps reach."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError
from flexmotion.retarget.foot_goal import THERE_M, THERE_RAD
from flexmotion.retarget.footholds import Footholds
from flexmotion.retarget.legs import SIDE_NAMES
from flexmotion.spatial.angle_words import told_angle, told_range

Float = NDArray[np.float64]

_ARC = np.linspace(0.0, np.pi, 721)
"""Angles at which the edge of what is in reach is tried: 1 mm apart on a stride of 20 cm [rad]."""


@dataclass(frozen=True)
class NearestPlace:
    """A place in reach.

    Attributes:
        ahead, left, turn: as of `FootGoal` [m, m, rad].
        moved: to what it was moved, in words; None: it is as asked.
    """

    ahead: float
    left: float
    turn: float
    moved: str | None = None


class FootPlaces:
    """Places in reach of a robot's feet: those at which its gait may put them down in a walk (`Footholds.target`).

    Args:
        footholds: of the robot.
    """

    def __init__(self, footholds: Footholds) -> None:
        self._footholds, swings = footholds, footholds.swings
        longest = swings.longest_stride
        self._longest = longest, min(longest, swings.stride(np.inf, backward=True))

    def nearest(
        self, side: str, place: tuple[float, float], turn: float, tolerance: float, tolerance_rad: float
    ) -> NearestPlace:
        """The place in reach that is nearest to the one that is asked for.

        Args:
            side: "left" or "right".
            place, turn: as of `FootGoal` [m, m], [rad].
            tolerance, tolerance_rad: greatest distance from them [m], [rad].

        Raises:
            ConfigError: it is farther away; names what is in reach.
        """
        foot = SIDE_NAMES.index(side)
        outward = 1.0 if foot == 0 else -1.0
        gait = self._footholds.gait
        least, most = sorted((-outward * min(gait.max_toe_in, gait.max_foot_yaw), outward * gait.max_foot_yaw))
        turned = min(max(turn, least), most)
        if abs(turned - turn) > max(tolerance_rad, THERE_RAD):
            raise ConfigError(
                f"foot: heading {told_angle(turn)}, expected {told_range(least, most)} for the {side} foot"
            )
        # What is ahead and aside of a foot that turns counts in the frame midway between both; see `Footholds`.
        cos, sin = math.cos(0.5 * turned), math.sin(0.5 * turned)
        x, y = place
        ahead, apart = self._within(cos * x + sin * y, outward * (cos * y - sin * x), turned)
        aside = outward * apart
        found = cos * ahead - sin * aside, sin * ahead + cos * aside
        gap = math.hypot(found[0] - x, found[1] - y)
        told = f"[{found[0]:.3f}, {found[1]:.3f}] m, {100 * gap:.1f} cm from there"
        if gap > max(tolerance, THERE_M):
            narrowest, widest = self._footholds.apart(turned)
            raise ConfigError(
                f"foot: out of reach of a step of the {side} foot; the nearest place is {told}, the tolerance "
                f"{100 * tolerance:g} cm; expected {-self._longest[1]:.3f} to {self._longest[0]:.3f} m ahead and "
                f"{narrowest:.3f} to {widest:.3f} m to the {side} of the other foot, the less aside the farther ahead"
            )
        words = [told] if gap > THERE_M else []
        if abs(turned - turn) > THERE_RAD:
            words.append(f"heading {told_angle(turned)}")
        return NearestPlace(*found, turned, ", ".join(words) or None)

    def _within(self, ahead: float, apart: float, turn: float) -> tuple[float, float]:
        """The nearest place to one so far ahead and outward [m]: in half an ellipse over the narrowest stance."""
        narrowest, widest = self._footholds.apart(turn)
        forward, back = self._longest
        wide = widest - narrowest
        share = ahead / (forward if ahead >= 0.0 else back), (apart - narrowest) / max(wide, 1e-6)
        if share[1] >= 0.0 and math.hypot(*share) <= 1.0:
            return ahead, apart
        arc = np.cos(_ARC)
        edge = np.column_stack([np.where(arc >= 0.0, forward, back) * arc, narrowest + wide * np.sin(_ARC)])
        edge = np.vstack([edge, [[min(max(ahead, -back), forward), narrowest]]])
        x, y = edge[np.argmin(np.hypot(*(edge - (ahead, apart)).T))]
        return float(x), float(y)
