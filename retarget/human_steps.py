"""Which swings of the human's feet are steps for the robot."""

from __future__ import annotations

from math import hypot

from flexmotion.human.contacts import ContactDetector
from flexmotion.human.motion import Motion
from flexmotion.retarget.human import HumanWindow, Swing

_LEAST_DISTANCE, _LEAST_YAW, _LEAST_LIFT = 0.06, 0.2, 0.04
"""A swing that moves, turns and lifts the foot less than these is a shuffle [m, rad, m]."""
_REDRAWN_S = 0.15
"""A new window may show the swing of a step that is settled already with a later landing, by up to this much."""


def is_step(window: HumanWindow, swing: Swing) -> bool:
    """Whether a human swing is a step, rather than a shuffle or a lifted heel."""
    start, end = window.foot(swing.side, swing.lift_s), window.foot(swing.side, swing.land_s)
    return bool(
        hypot(*(end - start)[:2].tolist()) > _LEAST_DISTANCE
        or abs(end[2] - start[2]) > _LEAST_YAW
        or window.foot_height(swing.side, swing.lift_s, swing.land_s) > _LEAST_LIFT
    )


def is_consumed(swing: Swing, consumed_s: float) -> bool:
    """Whether the robot has stepped for a swing already.

    A swing that began before its foot's last step was to land is the swing of that step, seen again in a new window.

    Args:
        consumed_s: source time up to which the swings of this foot are used up.
    """
    margin = _REDRAWN_S if swing.lift_s < consumed_s else 1e-6
    return swing.land_s <= consumed_s + margin


def count_steps(motion: Motion) -> int:
    """Steps that the human makes in a motion and completes."""
    window = HumanWindow(motion, 0.0, ContactDetector().initial(), None)
    return sum(swing.landed and is_step(window, swing) for swing in window.swings)
