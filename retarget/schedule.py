"""Foot paths, contacts and load share over the rows of a plan, from its footsteps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.steps import Step
from flexmotion.retarget.swing import Swings
from flexmotion.spatial.transitions import minimum_jerk

Float = NDArray[np.float64]

SHIFT_S = 0.25
"""Time in which the weight moves onto or off a foot where the steps allow it."""
_CROUCH_BEFORE_S, _CROUCH_AFTER_S = 0.7, 0.6
"""The hips lower to walking height this long before a step, and rise this long after it."""


@dataclass(frozen=True)
class Schedule:
    """Feet over the rows of a plan.

    Attributes:
        feet: sole centres and yaw, (T, 2, 4) [m, m, m, rad].
        contacts: which feet carry load, (T, 2) bool.
        share: load share of the right foot, (T,) in [0, 1].
        walking: where the hips lower to walking height, (T,) bool.
    """

    feet: Float
    contacts: NDArray[np.bool_]
    share: Float
    walking: NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        feet: Float,
        landed: float,
        last_stance: float,
        steps: list[Step],
        ticks: Float,
        quiet: Float,
        rate: float,
        swings: Swings,
    ) -> Schedule:
        """Lay out `steps`.

        Args:
            feet: poses of the soles at the first row, (2, 4) [m, m, m, rad].
            landed, last_stance: tick of the last touch-down before the first row, and its stance foot.
            ticks: loop tick of each row, (T,).
            quiet: load share of the right foot while the weight does not move for a step, (T,).
            rate: rows a second.
            swings: paths of the feet.
        """
        paths = np.broadcast_to(feet, (len(ticks), 2, 4)).copy()
        contacts = np.ones((len(ticks), 2), np.bool_)
        walking = ticks < landed + _CROUCH_AFTER_S * rate
        for step in steps:
            moving = ticks >= step.lift
            paths[moving, step.side] = step_path(swings, step, ticks[moving], rate)
            contacts[moving & (ticks < step.land), step.side] = False
            walking |= (ticks >= step.lift - _CROUCH_BEFORE_S * rate) & (ticks < step.land + _CROUCH_AFTER_S * rate)
        return cls(paths, contacts, _load_share(landed, last_stance, steps, ticks, quiet, SHIFT_S * rate), walking)


def step_path(swings: Swings, step: Step, ticks: Float, rate: float) -> Float:
    """Sole centre and yaw at loop ticks from the lift of a step on, (T, 4) [m, m, m, rad].

    Of a step that was changed in the air, what its new path lacked of the old one decays until the foot lands: the
    quintic that begins with that offset and speed, ends with none, and has no acceleration at either end.
    """
    path = swings.path((ticks - step.lift) / (step.land - step.lift), step.side, step.start, step.target)
    bend, left = step.bend, step.land - step.bend.tick
    if left <= 0 or not (bend.offset.any() or bend.speed.any()):
        return path
    s = np.clip((ticks - bend.tick) / left, 0.0, 1.0)[:, None]
    path += (1.0 - minimum_jerk(s)) * bend.offset + s * (1.0 - s) ** 3 * (1.0 + 3.0 * s) * (left / rate) * bend.speed
    return path


def _load_share(
    landed: float, last_stance: float, steps: list[Step], ticks: Float, quiet: Float, shift: float
) -> Float:
    share = np.empty(len(ticks))
    begin = -np.inf
    for step in steps:
        gap = (ticks >= begin) & (ticks < step.lift)
        t = ticks[gap]
        if step.lift - landed <= shift:
            towards = minimum_jerk((t - landed) / max(step.lift - landed, 1))
            share[gap] = last_stance + towards * (step.stance - last_stance)
        else:
            leaving = 1.0 - minimum_jerk((t - landed) / shift)
            coming = minimum_jerk((t - step.lift + shift) / shift)
            # In a gap shorter than two shifts the weight is never at rest between the feet.
            total = np.maximum(leaving + coming, 1.0)
            leaving, coming = leaving / total, coming / total
            share[gap] = leaving * last_stance + coming * step.stance + (1.0 - leaving - coming) * quiet[gap]
        share[(ticks >= step.lift) & (ticks < step.land)] = step.stance
        begin, landed, last_stance = step.land, step.land, step.stance
    rest = ticks >= begin
    leaving = 1.0 - minimum_jerk((ticks[rest] - landed) / shift)
    share[rest] = leaving * last_stance + (1.0 - leaving) * quiet[rest]
    return share
