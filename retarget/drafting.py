"""Drafts of one plan, each eased further, until one needs no more of the servos' envelope than is allowed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from flexmotion.retarget.easing import Ease
from flexmotion.retarget.effort import Effort
from flexmotion.retarget.plan import Plan

DRAFTS = 3
"""Drafts of one plan at most: each takes as long as a plan without easing. The next plan goes on from its ease."""
CAPPED_DRAFTS = 5
"""Likewise where a torque is capped: no plan beyond it is played, and the whole way down takes four steps."""
_GAIN = 0.98
"""A draft that does not lower the load to this share is dropped: what is too much is not in what was eased."""


@dataclass(frozen=True)
class Drafted:
    """The draft that is kept.

    Attributes:
        plan, ease, effort: of this draft.
        first: effort of the first one.
        drafts: how many were made.
    """

    plan: Plan
    ease: Ease
    effort: Effort
    first: Effort
    drafts: int


def best_draft(make: Callable[[Ease], tuple[Plan, Effort]], ease: Ease, allowed: float, most: int = DRAFTS) -> Drafted:
    """The first draft within what is allowed, or the one that came closest: slower first, then smaller.

    Args:
        make: the plan at an ease, and its effort.
        ease: with which the plan before ended.
        allowed: greatest load, as a share of the envelope.
        most: drafts at most.
    """
    plan, effort = make(ease)
    first, drafts = effort, 1
    for further in (Ease.slower, Ease.smaller):
        while drafts < most and effort.load > allowed and (tried := further(ease, effort, allowed)) != ease:
            other, found = make(tried)
            drafts += 1
            if found.load > _GAIN * effort.load:
                break
            plan, ease, effort = other, tried, found
    return Drafted(plan, ease, effort, first, drafts)
