"""How a motion is eased until its torques are within the servos' envelope: slowed, then made smaller, then refused."""

from __future__ import annotations

from dataclasses import dataclass, replace

from flexmotion.retarget.effort import Effort

LEAST_PACE, LEAST_SIZE = 0.6, 0.4
"""A human is slowed to this share of its pace at most, and made smaller to this share."""
_PACE_STEP, _SIZE_STEP = 0.8, 0.75
"""Largest step of one draft: pace and size change the load of the next steps, not of those that are settled."""
STANDING_PACE = 0.3
"""Likewise where a torque of arms or head is capped and the robot makes no step: it may take any time."""
_STANDING_STEP = 0.4
"""Largest step of one draft then."""
_LEAST_STEP = 0.95
"""Smallest step of one draft, as a share."""
_RELAX = 1.15
"""Growth from one plan to the next, while there is room."""
_ROOM = 0.85
"""Load over the one allowed, below which the next plan is eased less: torques of motion grow with the square."""


@dataclass(frozen=True)
class Ease:
    """How much of a human's motion is followed.

    Attributes:
        pace: of the human's clock, in [`LEAST_PACE`, 1], or in [`STANDING_PACE`, 1] for a torque cap.
        size: of steps, gestures and bends, in [`LEAST_SIZE`, 1].
    """

    pace: float = 1.0
    size: float = 1.0

    @property
    def whole(self) -> bool:
        """Whether nothing is eased."""
        return self.pace >= 1.0 and self.size >= 1.0

    def slower(self, effort: Effort, allowed: float) -> Ease:
        """For a plan whose effort is above what is allowed; the same where it can be slowed no further.

        The torque of motion grows with the square of its pace, so the root of what is too much is taken off.
        """
        least, step = (STANDING_PACE, _STANDING_STEP) if effort.may_wait else (LEAST_PACE, _PACE_STEP)
        share = min((allowed / effort.load) ** 0.5, _LEAST_STEP)
        return replace(self, pace=max(self.pace * max(share, step), min(least, self.pace)))

    def smaller(self, effort: Effort, allowed: float) -> Ease:
        """Likewise; the same where it can be made no smaller."""
        share = min(allowed / effort.load, _LEAST_STEP)
        return replace(self, size=max(self.size * max(share, _SIZE_STEP), min(LEAST_SIZE, self.size)))

    def relaxed(self, effort: Effort, allowed: float) -> Ease:
        """The ease with which the next plan begins: less, where this one leaves room; first larger, then faster."""
        if effort.load > _ROOM * allowed:
            return self
        if self.size < 1.0:
            return replace(self, size=min(self.size * _RELAX, 1.0))
        return replace(self, pace=min(self.pace * _RELAX, 1.0))


WHOLE = Ease()
"""Nothing is eased."""


@dataclass(frozen=True)
class Eased:
    """What a plan was eased to, and why.

    Attributes:
        ease: of the plan.
        drafts: how many were made.
        effort: of the plan; `first`: of the first draft, before it was eased any further.
        refused: no easing helped, and a joint would fall behind too far: the plan comes to a stop instead.
        lag: how far it would have fallen behind; 0 where that was not asked [rad].
    """

    ease: Ease
    drafts: int
    effort: Effort
    first: Effort
    refused: bool = False
    lag: float = 0.0
