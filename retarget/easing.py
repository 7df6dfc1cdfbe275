"""How a motion is eased until its torques are within the servos' envelope: slowed, then made smaller, then refused."""

from __future__ import annotations

from dataclasses import dataclass, replace

from flexmotion.retarget.effort import Effort

LEAST_PACE, LEAST_SIZE = 0.6, 0.4
"""A human is slowed to this share of its pace at most, then made smaller to this share: with less it is refused."""
_PACE_STEP, _SIZE_STEP = 0.8, 0.75
"""Largest step of one draft: pace and size change the load of the next steps, not of those that are settled."""
_RELAX = 1.15
"""Growth from one plan to the next, while there is room."""
_ROOM = 0.85
"""Load over the one allowed, below which the next plan is eased less: torques of motion grow with the square."""
DRAFTS = 3
"""Drafts of one plan at most: each takes as long as a plan without easing."""


@dataclass(frozen=True)
class Ease:
    """How much of a human's motion is followed.

    Attributes:
        pace: of the human's clock, in [`LEAST_PACE`, 1].
        size: of steps, gestures and bends, in [`LEAST_SIZE`, 1].
    """

    pace: float = 1.0
    size: float = 1.0

    @property
    def least(self) -> bool:
        """Whether the motion can be eased no further."""
        return self.pace <= LEAST_PACE and self.size <= LEAST_SIZE

    @property
    def whole(self) -> bool:
        """Whether nothing is eased."""
        return self.pace >= 1.0 and self.size >= 1.0

    def harder(self, effort: Effort, allowed: float) -> Ease:
        """The ease of the next draft, for a plan whose effort is above what is allowed: first slower, then smaller.

        The torque of motion grows with the square of its pace, so the root of what is too much is taken off.
        """
        share = (allowed / effort.load) ** 0.5
        if self.pace > LEAST_PACE:
            return replace(self, pace=max(self.pace * max(min(share, 0.95), _PACE_STEP), LEAST_PACE))
        return replace(self, size=max(self.size * max(min(share, 0.95), _SIZE_STEP), LEAST_SIZE))

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
        refused: the motion is beyond the envelope at its least ease: the plan comes to a stop instead.
    """

    ease: Ease
    drafts: int
    effort: Effort
    first: Effort
    refused: bool = False
