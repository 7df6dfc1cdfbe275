"""When a step may lift and when it lands: notice, rest of the feet between steps, and the human's timing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot_file import Gait
from flexmotion.retarget.human import Swing
from flexmotion.retarget.swing import Swings
from flexmotion.retarget.view import HumanView

Float = NDArray[np.float64]

INSERTED_SWING_S = 0.40
"""Duration of an inserted step."""
_UNKNOWN_SWING_S = 0.42
"""Assumed duration of a human swing whose landing is not in the window."""
_MAX_LATENESS_S = 0.30
"""A human step whose foot landed longer ago than this is left out: making up for it would delay the next one."""
_LATER_S = 0.06
"""By how much the robot's foot may land later than the human's."""
SAME_FOOT_REST_S = 0.3
"""A foot that has landed stays down this long, though the other foot may lift sooner: a robot that swings one leg
repeatedly over the same stance foot scuffs the ground and falls."""


class StepTiming:
    """Timing of steps in loop ticks.

    Args:
        gait: the robot's gait limits.
        swings: how long its swings take.
        rate_hz: loop ticks a second.
    """

    def __init__(self, gait: Gait, swings: Swings, rate_hz: float) -> None:
        self.gait, self.swings, self.rate = gait, swings, rate_hz
        self.pause = round(gait.double_support_min_s * rate_hz)
        """Ticks from a touch-down to the lift of the other foot, at least."""
        # Always later than the other foot, also of a robot that pauses for long.
        self._same_foot_rest = max(round(SAME_FOOT_REST_S * rate_hz), self.pause + 1)

    def ticks(self, seconds: float) -> int:
        """Duration in ticks."""
        return int(round(seconds * self.rate))

    def free(self, side: int, landed: float) -> Float:
        """Ticks from which each foot may lift after foot `side` landed, (2,)."""
        ticks = np.full(2, landed + self.pause)
        ticks[side] = landed + self._same_foot_rest
        return ticks

    def landed_by(self, side: int, lift: int) -> Float:
        """Ticks by which each foot must have landed before foot `side` lifts, (2,)."""
        ticks = np.full(2, float(lift - self.pause))
        ticks[side] = lift - self._same_foot_rest
        return ticks

    def is_too_late(self, view: HumanView, swing: Swing, lift: int) -> bool:
        """Whether a human step is left out because the robot could lift its foot at `lift` only."""
        return swing.landed and lift > view.tick_at(swing.land_s) + _MAX_LATENESS_S * self.rate

    def landing(self, view: HumanView, swing: Swing, lift: int) -> int:
        """Tick at which the foot of a step for `swing` lands, if it lifts at `lift`."""
        if swing.landed:
            land = view.tick_at(swing.land_s)
        else:
            land = max(view.tick_at(view.window.end_s), view.tick_at(swing.lift_s + _UNKNOWN_SWING_S))
        # A longer swing reaches further: it takes of the human's double support what the robot's does not need.
        lifts = (view.tick_at(other.lift_s) for other in view.window.swings if other.lift_s > swing.land_s)
        latest = min(lifts, default=land) - self.pause
        land = max(land, min(latest, land + self.ticks(_LATER_S)))
        return max(land, lift + int(np.ceil(self.swings.least_s * self.rate)))
