"""The states from which later plans resume: one for each row of a plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.state import SETTLED_STEPS, RetargetState, StateLayout
from flexmotion.retarget.steps import pack_steps, settled_from
from flexmotion.retarget.view import HumanView
from flexmotion.retarget.walk import Walk

Float = NDArray[np.float64]


@dataclass(frozen=True)
class BodyMotion:
    """Trunk, joints and centre of mass over the rows of a plan.

    Attributes:
        com: (T, 2) [m].
        position, velocity: filtered trunk channels and upper-body joints, (T, C).
        base: torso position and quaternion w x y z, (T, 7).
        q: joint angles, (T, n) [rad].
        offset: centre of mass minus torso, (T, 2) [m].
        tension: of the human's limbs, (T, 3).
    """

    com: Float
    position: Float
    velocity: Float
    base: Float
    q: Float
    offset: Float
    tension: Float


def resume_states(
    layout: StateLayout, vector: Float, walk: Walk, body: BodyMotion, view: HumanView | None, rate_hz: float
) -> Float:
    """States of all rows: row k holds what a plan that joins at row k resumes from, (T, S).

    Args:
        vector: the state at which the plan itself resumed, (S,).
        view: the human that it follows; None for a stop.
        rate_hz: rows a second.
    """
    rows = len(walk.ticks)
    vectors = np.broadcast_to(vector, (rows, layout.size)).copy()
    before, states = layout.view(vector), layout.view(vectors)
    states.feet, states.com, states.dcm = walk.schedule.feet, body.com, walk.balance.dcm
    states.com_offset = _row_before(before.com_offset, body.offset)
    states.position = _row_before(before.position, body.position)
    states.velocity = _row_before(before.velocity, body.velocity)
    states.tension = _row_before(before.tension, body.tension)
    states.q, states.base = _two_rows_before(before.q, body.q), _two_rows_before(before.base, body.base)
    _write_steps(states, before, walk, rate_hz)
    if view is not None:
        _write_human(states, view, walk.ticks)
    return vectors


def _row_before(first: Float, values: Float) -> Float:
    """Values (T, ...) one row later, `first` (...) in the first row."""
    return np.concatenate([first[None], values[:-1]])


def _two_rows_before(first: Float, values: Float) -> Float:
    """The two rows before each row of values (T, n), newest first, (T, 2, n); `first` (2, n) those before the first."""
    rows = len(values)
    line = np.concatenate([first[::-1], values])
    return np.stack([line[1 : rows + 1], line[:rows]], axis=1)


def _write_steps(states: RetargetState, before: RetargetState, walk: Walk, rate_hz: float) -> None:
    """Write to each row the steps that are settled and not landed, and the effects of those before."""
    ticks = walk.ticks
    consumed, human_feet = before.consumed.copy(), before.human_feet.copy()
    settled = settled_from(walk.steps, rate_hz)
    for step, tick in zip(walk.steps, settled, strict=True):
        landed = ticks >= step.land
        states.landed[landed], states.stance[landed] = step.land, step.stance
        consumed[step.side] = max(consumed[step.side], step.consumed_s)
        states.consumed[ticks >= tick] = consumed
        human_feet[step.side] = step.human
        states.human_feet[landed] = human_feet
    for edge in sorted({ticks[0], *np.ceil(settled), *(step.land for step in walk.steps)}):
        current = [step for step, tick in zip(walk.steps, settled, strict=True) if tick <= edge < step.land]
        states.steps[ticks >= edge] = pack_steps(current, SETTLED_STEPS)


def _write_human(states: RetargetState, view: HumanView, ticks: Float) -> None:
    """Write what was known before the frame at or before each row: `Retargeter.next_frame` gives that frame again."""
    frames = view.window.frame_before(view.seconds(ticks))
    known = frames >= 1
    if view.ease.pace != 1.0:
        follow = view.follow
        eased = ticks - view.seconds(ticks) * view.rate_hz
        # In the stop tail the human's clock goes on at its own pace.
        states.source_tick = np.concatenate([eased[:follow], np.full(len(ticks) - follow, eased[follow - 1])])
    states.detector[known] = view.window.detector_states[frames[known] - 1]
    states.yaws[known] = view.window.yaws[frames[known] - 1]
