"""Where a step may land: the human's foothold scaled to the robot, within its stride, its stance and its swing speed.

A foothold is relative to the place on the human's ground that the robot's other foot represents. It is behind the
human's foot by what the robot's steps fell short of, so that later steps make up for it, and for a human foot that
slides while it stands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, hypot, isnan, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot_file import Gait
from flexmotion.retarget.human import HumanWindow
from flexmotion.retarget.swing import Swings

Float = NDArray[np.float64]

_MAX_CARRY = 0.3
"""Most of a sideways step beyond the robot's stance width that is left to the other foot's step [m of the human]."""
_MAX_LAG_S = 1.5
"""Most that the robot lags behind the human and still makes up for, over its speed [s]: it goes on for as long after
the human has come to a stand."""
_TURN_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Shares of a foot's turn: the first that leaves the foot within a stride and within reach is taken, else the last."""
_AHEAD_FIRST = 0.97
"""Share of the longest stride down to which a foot goes less far aside instead of less far ahead."""
_STRIDE_TOLERANCE = 1e-3
"""By how much a foot may be further ahead than the longest stride [m]."""


@dataclass(frozen=True)
class Scaling:
    """How human lengths and headings become the robot's.

    Attributes:
        ratio: robot leg length over human leg length.
        heading: robot yaw minus human yaw [rad].
        human_width: distance between the human's feet in quiet stance [m].
    """

    ratio: float
    heading: float
    human_width: float


@dataclass(frozen=True, eq=False)
class Foothold:
    """Target of a step.

    Attributes:
        pose: x, y, z, yaw of the sole centre, (4,) [m, m, m, rad].
        human: position on the human's ground that it represents, (2,) [m]: the human's foot, moved by what is out of
            the robot's reach.
        bearing: direction on the robot's floor of what is ahead on the human's ground along +x [rad].
    """

    pose: Float
    human: Float
    bearing: float


class Footholds:
    """Footholds of one robot.

    Args:
        gait: the robot's gait limits.
        swings: how far its feet get in which time.
        stand_width: distance between the robot's sole centres at its stand pose [m].
        sole_half_length: from a sole's centre to its toe edge [m].
    """

    def __init__(self, gait: Gait, swings: Swings, stand_width: float, sole_half_length: float) -> None:
        self.gait, self.swings = gait, swings
        self.stand_width, self.sole_half_length = stand_width, sole_half_length
        self.most_lag = _MAX_LAG_S * swings.speed

    def of_swing(
        self,
        window: HumanWindow,
        scaling: Scaling,
        side: int,
        land_s: float,
        heading_s: tuple[float, float],
        feet: Float,
        human_feet: Float,
        seconds: float,
    ) -> Foothold:
        """Foothold of a step of foot `side`, as near to the human's as the foot can get in time.

        A foot that turns reaches less far. Where it falls behind, it may end more than a stride from the other foot in
        the frame that has turned, further with each step. Then it turns less.

        Args:
            land_s, heading_s: as in `target`.
            feet: poses of both feet before the step, (2, 4) [m, m, m, rad].
            human_feet: positions of the human's feet that these represent, (2, 2) [m].
            seconds: duration of the swing [s].
        """
        start, stance = feet[side], feet[1 - side]
        for share in _TURN_SHARES:
            turn = (float(start[3]), share)
            wanted = self.target(window, scaling, side, land_s, heading_s, stance, human_feet[1 - side], seconds, turn)
            pose = self.swings.farthest(side, start, wanted.pose, seconds)
            found = replace(wanted, pose=pose, human=wanted.human + self._on_ground(scaling, wanted, pose))
            in_time = self.swings.shortest_s(side, start, found.pose) <= seconds + 1e-6
            ahead = ahead_of(stance, found.pose)
            if in_time and abs(ahead) <= self.swings.stride(seconds, ahead < 0.0) + _STRIDE_TOLERANCE:
                break
        return found

    def target(
        self,
        window: HumanWindow,
        scaling: Scaling,
        side: int,
        land_s: float,
        heading_s: tuple[float, float],
        stance: Float,
        human_stance: Float,
        seconds: float,
        turn: tuple[float, float] = (0.0, 1.0),
    ) -> Foothold:
        """Foothold of foot `side` relative to the robot's other foot, within the stance limits of the gait.

        Args:
            land_s: source time at which the foot takes the place of the human's foot [s].
            heading_s: source times between which the mean yaw of the human's pelvis is the heading [s]: the pelvis
                oscillates once a stride.
            stance: pose of the other foot, (4,) [m, m, m, rad].
            human_stance: position of the human's other foot when the robot's was put down for it, (2,) [m]: a foot that
                slides while it stands moves the human, so it must move the robot. NaN: its position at `land_s`.
            seconds: duration of the swing, which bounds the stride [s].
            turn: yaw of the foot before the swing [rad], and the share of the turn from there that this step makes.
        """
        gait = self.gait
        # Plain numbers: numpy takes ten times as long for one at a time.
        human_x, human_y = window.place(side, land_s).tolist()
        beside_x, beside_y = window.left(1 - side, land_s).tolist()
        human_yaw = window.mean_heading(*heading_s)
        from_x, from_y = human_stance.tolist()
        if isnan(from_x) or isnan(from_y):
            from_x, from_y = beside_x, beside_y
        stance_x, stance_y, _, stance_yaw = stance.tolist()
        inward = -1.0 if side == 0 else 1.0
        askew = _bounded(human_yaw + scaling.heading - stance_yaw, gait.max_foot_yaw)
        # Toes that turn in meet the other foot sooner than toes that turn out.
        askew = max(askew, -gait.max_toe_in) if inward < 0 else min(askew, gait.max_toe_in)
        start_yaw, share = turn
        askew = share * askew + (1.0 - share) * (start_yaw - stance_yaw)
        c, s = cos(human_yaw), sin(human_yaw)
        dx, dy = human_x - from_x, human_y - from_y
        forward, sideways = c * dx + s * dy, c * dy - s * dx
        behind = beside_x - from_x, beside_y - from_y
        lag, before = (_along(behind, yaw) for yaw in (human_yaw, stance_yaw - scaling.heading))
        if lag * before < 0.0:
            # The human has turned about and comes toward the robot. Making up for the lag would be a walk backward.
            forward -= lag
        scale = gait.stride_factor * scaling.ratio
        forward *= scale
        asked = forward
        longest = max(self.swings.stride(seconds, forward < 0.0), 1e-6)
        forward = _bounded(forward, longest)
        wanted = self.stand_width + scaling.ratio * (-inward * sideways - scaling.human_width)
        narrowest, widest = self.apart(askew)
        apart = min(max(wanted, narrowest), widest)
        # Far ahead and far to the side at once is out of the leg's reach: an ellipse bounds both, what is aside first.
        ahead, aside = abs(forward) / longest, (apart - narrowest) / max(widest - narrowest, 1e-6)
        if ahead * ahead + aside * aside > 1.0:
            reached = max(ahead / hypot(ahead, aside), min(ahead, _AHEAD_FIRST))
            forward, apart = forward * reached / ahead, narrowest + (widest - narrowest) * sqrt(1.0 - reached**2)
        # In sidesteps the feet soon meet each other: the rest of the way is left to the next step of the other foot.
        carry = _bounded(-inward * (apart - wanted) / scaling.ratio, _MAX_CARRY)
        short = _bounded(asked - forward, self.most_lag) / scale
        human = np.array([human_x - carry * s - short * c, human_y + carry * c - short * s])
        frame = stance_yaw + 0.5 * askew
        c, s = cos(frame), sin(frame)
        sideways = -inward * apart
        x, y = stance_x + c * forward - s * sideways, stance_y + s * forward + c * sideways
        return Foothold(np.array([x, y, 0.0, stance_yaw + askew]), human, frame - human_yaw)

    def apart(self, askew: float) -> tuple[float, float]:
        """Least and greatest distance of a foot from the other one to its side [m].

        Args:
            askew: yaw between the feet [rad].
        """
        # A turned foot needs room for its corners.
        narrowest = self.gait.lateral[0] + self.sole_half_length * abs(sin(askew))
        return narrowest, max(narrowest, self.gait.lateral[1])

    def _on_ground(self, scaling: Scaling, wanted: Foothold, pose: Float) -> Float:
        """How far on the human's ground a pose of the foot is from the one that was wanted, (2,) [m]."""
        x, y = ((pose - wanted.pose)[:2] / (self.gait.stride_factor * scaling.ratio)).tolist()
        c, s = cos(wanted.bearing), sin(wanted.bearing)
        return np.array([c * x + s * y, c * y - s * x])


def _along(way: tuple[float, float], yaw: float) -> float:
    """Part of a way in the direction of a yaw."""
    return cos(yaw) * way[0] + sin(yaw) * way[1]


def _bounded(value: float, most: float) -> float:
    """A value within a bound to both sides."""
    return min(max(value, -most), most)


def ahead_of(stance: Float, pose: Float) -> float:
    """How far a foot is ahead of the other foot, in the frame midway between both [m]."""
    (from_x, from_y, _, from_yaw), (x, y, _, yaw) = stance.tolist(), pose.tolist()
    midway = 0.5 * (from_yaw + yaw)
    return cos(midway) * (x - from_x) + sin(midway) * (y - from_y)
