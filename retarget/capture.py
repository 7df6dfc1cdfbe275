"""`CaptureSteps`: moves the foothold of the next foot to land to where it captures a robot that was pushed.

The divergent component of a pendulum leaves its zero-moment point with e^(wt). Of an error that the sole does not hold,
e^(wT) times as much is left when the foot lands after T. A foothold that is moved by as far has the robot over it as it
was planned (Englsberger et al. 2015, IEEE T-RO 31(2); Khadiv et al. 2020, IEEE T-RO 36(4), without its step timing).
A foot that is in the air already gets no further than it can without being faster than swings are.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot_file import Gait
from flexmotion.retarget.schedule import step_path
from flexmotion.retarget.steps import Bend, Step
from flexmotion.retarget.swing import Swings

Float = NDArray[np.float64]

DEAD_M = 0.015
"""Smaller errors move no foothold [m]. In mid-swing of unpushed walks, 95 % of the errors are smaller. Answers begin at
22 mm (`PushWatch`)."""
HELD_SHARE = np.array([0.5, 0.65])
"""Share of half a sole, ahead and aside, up to which servos and balance feedback hold an error as it is: pushes of .6
N·s, 26 mm aside, stayed the same from the push to the landing. What is beyond grows."""
_LEAST_S = 0.1
"""A foot that lands sooner keeps its foothold: its servos could not bring it elsewhere [s]."""
_STRIDE = 1.5
"""How far a foot may be ahead of the other after a push, over the longest stride of a steady walk: the foot behind has
only to come beside it, which is half of the next swing of a walk."""
_SPEED = 0.5
"""Most that a foothold moves, over the time until the foot lands [m/s]: the mean speed of a brisk swing."""
_HURRY = 1.25
"""Shortest time of a swing to the new foothold, over the time that the step has: swings of the table have a margin. A
plan gives a foot that is on the ground still the time that it needs."""
_BENT = 0.84
"""Most speed of a foot that is bent in the air, over that of the fastest swings: its way is not the one that is easiest
for the knee and the ankle. Of 96 answers late in a swing joints were at up to 1.22 of their no-load speed at .9, 1.14
at .84 and 1.10 at .78; where an answer makes a foot no faster they are at up to 1.18, in the swings themselves 1.01."""
_SHARES = np.linspace(0.05, 1.0, 20)
"""Shares of a change that are tried for the greatest one that the leg can follow."""
_LEAST_M = 1e-3
"""A change that is smaller is left out [m]."""


class CaptureSteps:
    """Footholds of one robot after pushes.

    Args:
        gait: bounds of the distance between its feet.
        swings: how far its feet get in which time.
        sole_half_size: half the length and width of a sole, (2,) [m].
        omega: natural frequency of its pendulum [1/s].
        rate_hz: loop ticks a second.
    """

    def __init__(self, gait: Gait, swings: Swings, sole_half_size: Float, omega: float, rate_hz: float) -> None:
        self.swings, self.omega, self.rate = swings, omega, rate_hz
        self._held = HELD_SHARE * sole_half_size
        stride = _STRIDE * swings.longest_stride
        self.nearest = np.array([-stride, gait.lateral[0]])
        """Bounds of a foothold in the frame of the other foot: ahead, and aside, away from it [m]."""
        self.farthest = np.array([stride, gait.lateral[1]])
        self.fastest = _BENT * _fastest(swings)
        """Most speed of a foot over the hips after a change in the air [m/s]."""

    def answer(self, steps: list[Step], feet: Float, tick: int, error: Float) -> tuple[list[Step], Float]:
        """Move the foothold of the first step, and with it those of the steps after it.

        How far it is moved in all depends on the error alone, so an error that is answered again moves nothing, and
        one that is gone moves the foothold back.

        Args:
            steps: settled steps, in order; the first may be under way.
            feet: poses of both feet, (2, 4) [m, m, m, rad].
            tick: from which the steps change.
            error: divergent component, measured minus planned, (2,) [m].

        Returns:
            The steps, and by how much the plan's divergent component at `tick` changes with them, (2,) [m].
        """
        unchanged = steps, np.zeros(2)
        if not steps or not np.isfinite(error).all():
            return unchanged
        step = steps[0]
        left = (step.land - tick) / self.rate
        if left < _LEAST_S:
            return unchanged
        shrink = float(np.exp(-self.omega * left))
        change = self._change(step, feet[1 - step.side], error, tick, left, shrink)
        if float(np.hypot(*change)) < _LEAST_M:
            return unchanged
        moved = [self._bent(step, change, tick) if step.lift < tick else self._moved(step, change)]
        for later in steps[1:]:
            before = next((one for one in reversed(moved) if one.side == later.side), None)
            start = later.start if before is None else before.target.copy()
            moved.append(replace(self._moved(later, change), start=start, shift=later.shift))
        return moved, shrink * change

    def _change(self, step: Step, stance: Float, error: Float, tick: int, left: float, shrink: float) -> Float:
        """By how much the foothold of a step moves from where it is now, (2,) [m].

        Args:
            stance: pose of the other foot, (4,) [m, m, m, rad].
            tick: from which it moves.
            left: time until the foot lands [s]; shrink: e^(-wT) of it.
        """
        away = 1.0 if step.side == 0 else -1.0
        cos, sin = np.cos(stance[3]), np.sin(stance[3])
        turn = np.array([[cos, sin], [-away * sin, away * cos]])
        # The plan has moved with the foothold already: the error is that from the plan before it.
        whole = turn @ (error + shrink * step.shift)
        size = np.abs(whole)
        grown = np.maximum(size - self._held, 0.0) * (1.0 / shrink - 1.0)
        wanted = np.sign(whole) * (np.maximum(size - DEAD_M, 0.0) + grown)
        planned = turn @ (step.target[:2] - step.shift - stance[:2])
        low, high = np.minimum(self.nearest, planned), np.maximum(self.farthest, planned)
        local = np.clip(planned + wanted, low, high) - planned
        change: Float = turn.T @ local - step.shift
        change *= min(1.0, _SPEED * left / max(float(np.hypot(*change)), 1e-9))
        if step.lift < tick:
            return self._turned_in_time(step, change, tick)
        return next(
            (share * change for share in _SHARES[::-1] if self._swings_in_time(step, share * change)), np.zeros(2)
        )

    def _swings_in_time(self, step: Step, change: Float) -> bool:
        """Whether a foot on the ground can swing to where a change has it."""
        target = self._moved(step, change).target
        return self.swings.shortest_s(step.side, step.start, target) <= _HURRY * (step.land - step.lift) / self.rate

    def _turned_in_time(self, step: Step, change: Float, tick: int) -> Float:
        """The greatest share of a change to which a foot in the air can be bent in the time that is left, (2,) [m].

        The bend comes on top of the speed that the foot has, with 15/8 of its mean in the middle, so it is the path
        itself that is measured: it gets faster with the share, from where it gets faster at all. A step that is faster
        without the change may stay as fast.
        """
        most = max(self.fastest, self._speed(step, tick))
        if self._speed(self._bent(step, change, tick), tick) <= most:
            return change
        tried = bisect_left(
            _SHARES, True, key=lambda share: self._speed(self._bent(step, share * change, tick), tick) > most
        )
        found: Float = _SHARES[tried - 1] * change if tried else np.zeros(2)
        return found

    def _speed(self, step: Step, tick: int) -> float:
        """Most speed of a foot over the hips, over the ground, from a tick until it lands [m/s].

        The hips go half of the way of the swing as it was planned, from one touch-down to the next (`SwingEffort`), and
        with a foothold that is moved as the pendulum does whose divergent component is moved for it.
        """
        ticks = np.arange(tick, step.land + 1.0)
        path = step_path(self.swings, step, ticks, self.rate)[:, :2]
        way = step.target[:2] - step.shift - step.start[:2]
        hips = 0.5 * way / ((step.land - step.lift) / self.rate + self.swings.pause_s)
        since = self.omega * (ticks - tick) / self.rate
        sway = self.omega * np.exp(-since[-1]) * np.cosh(since[:-1])
        over = np.diff(path, axis=0) * self.rate - hips - np.outer(sway, step.shift)
        return float(np.hypot(*over.T).max())

    def _moved(self, step: Step, change: Float) -> Step:
        target = step.target.copy()
        target[:2] += change
        return replace(step, target=target, shift=step.shift + change)

    def _bent(self, before: Step, change: Float, tick: int) -> Step:
        """A step that is changed in the air: its foot goes on smoothly from where it is, as fast as it is."""
        at = tick + np.array([-0.5, 0.0, 0.5])
        after = replace(self._moved(before, change), bend=Bend())
        gap = step_path(self.swings, before, at, self.rate) - step_path(self.swings, after, at, self.rate)
        return replace(after, bend=Bend(tick, gap[1], (gap[2] - gap[0]) * self.rate))


def _fastest(swings: Swings) -> float:
    """Most speed of a foot over the hips in the shortest swings straight ahead and back [m/s]."""
    seconds = swings.shortest[:, len(swings.aside) // 2, len(swings.turns) // 2]
    phases = swings.progress.shape[1] - 1
    foot = np.abs(np.diff(swings.progress, axis=1)).max(axis=1) * phases / seconds
    hips = 0.5 / (seconds + swings.pause_s)
    return float((np.abs(swings.ahead) * (foot - hips)).max())
