"""`CaptureSteps`: moves the foothold of the next foot to land to where it captures a robot that was pushed.

The divergent component of a pendulum leaves its zero-moment point with e^(wt). Of an error that the sole does not hold,
e^(wT) times as much is left when the foot lands after T. A foothold that is moved by as far has the robot over it as it
was planned (Englsberger et al. 2015, IEEE T-RO 31(2); Khadiv et al. 2020, IEEE T-RO 36(4), without its step timing).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot_file import Gait
from flexmotion.retarget.schedule import step_path
from flexmotion.retarget.steps import Bend, Step
from flexmotion.retarget.swing import Swings

Float = NDArray[np.float64]

DEAD_M = 0.015
"""An error up to this moves no foothold [m]: in mid-swing, walks that nobody pushes have less in 95 % of the time
(answers begin at 22 mm: `PushWatch`)."""
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
"""Shortest time of a swing to the new foothold, over the time that the step has: swings of the table have a margin."""
_SHARES = (1.0, 0.75, 0.5, 0.25)
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
        change = self._change(step, feet[1 - step.side], error, left, shrink)
        if float(np.hypot(*change)) < _LEAST_M:
            return unchanged
        moved = [self._moved(step, change)]
        if step.lift < tick:
            moved[0] = self._bent(step, moved[0], tick)
        for later in steps[1:]:
            before = next((one for one in reversed(moved) if one.side == later.side), None)
            start = later.start if before is None else before.target.copy()
            moved.append(replace(self._moved(later, change), start=start, shift=later.shift))
        return moved, shrink * change

    def _change(self, step: Step, stance: Float, error: Float, left: float, shrink: float) -> Float:
        """By how much the foothold of a step moves from where it is now, (2,) [m].

        Args:
            stance: pose of the other foot, (4,) [m, m, m, rad].
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
        allowed = _HURRY * (step.land - step.lift) / self.rate
        for share in _SHARES:
            target = self._moved(step, share * change).target
            if self.swings.shortest_s(step.side, step.start, target) <= allowed:
                return share * change
        return np.zeros(2)

    def _moved(self, step: Step, change: Float) -> Step:
        target = step.target.copy()
        target[:2] += change
        return replace(step, target=target, shift=step.shift + change)

    def _bent(self, before: Step, after: Step, tick: int) -> Step:
        """A step that was changed in the air: its foot goes on smoothly from where it is, as fast as it is."""
        at = tick + np.array([-0.5, 0.0, 0.5])
        after = replace(after, bend=Bend())
        gap = step_path(self.swings, before, at, self.rate) - step_path(self.swings, after, at, self.rate)
        return replace(after, bend=Bend(tick, gap[1], (gap[2] - gap[0]) * self.rate))
