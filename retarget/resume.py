"""The states from which later plans resume: one for each row of a plan."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

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
    _write_row_before(states.com_offset, before.com_offset, body.offset)
    _write_row_before(states.position, before.position, body.position)
    _write_row_before(states.velocity, before.velocity, body.velocity)
    _write_row_before(states.tension, before.tension, body.tension)
    _write_two_rows_before(states.q, before.q, body.q)
    _write_two_rows_before(states.base, before.base, body.base)
    _write_steps(states, before, walk, rate_hz)
    if view is not None:
        _write_human(states, view, walk.ticks)
    return vectors


def _write_row_before(out: Float, first: Float, values: Float) -> None:
    """Write values (T, ...) one row later to `out`, and `first` (...) to its first row."""
    out[0], out[1:] = first, values[:-1]


def _write_two_rows_before(out: Float, first: Float, values: Float) -> None:
    """Write the two rows before each row of values (T, n), newest first, to `out` (T, 2, n).

    Args:
        first: those before the first row, (2, n).
    """
    out[0], out[1:2, 1] = first, first[0]
    out[1:, 0], out[2:, 1] = values[:-1], values[:-2]


def _write_steps(states: RetargetState, before: RetargetState, walk: Walk, rate_hz: float) -> None:
    """Write to each row the steps that are settled and not landed, and the effects of those before."""
    now = float(walk.ticks[0])

    def row(tick: float) -> int:
        """The first row at or after a tick."""
        return max(ceil(tick - now), 0)

    consumed, human_feet = before.consumed.copy(), before.human_feet.copy()
    settled = settled_from(walk.steps, rate_hz).tolist()
    for step, tick in zip(walk.steps, settled, strict=True):
        landed = slice(row(step.land), None)
        states.landed[landed], states.stance[landed] = step.land, step.stance
        consumed[step.side] = max(consumed[step.side], step.consumed_s)
        states.consumed[row(tick) :] = consumed
        human_feet[step.side] = step.human
        states.human_feet[landed] = human_feet
    packed, records = pack_steps(walk.steps), states.steps
    edges = sorted({0, *map(row, settled), *(row(step.land) for step in walk.steps)})
    for edge, end in zip(edges, [*edges[1:], None], strict=True):
        tick = now + edge
        current = [k for k, step in enumerate(walk.steps) if settled[k] <= tick < step.land]
        record = pack_steps([], SETTLED_STEPS)
        record[: len(current)] = packed[current]
        records[edge:end] = record


def _write_human(states: RetargetState, view: HumanView, ticks: Float) -> None:
    """Write what was known before the frame at or before each row: `Retargeter.next_frame` gives that frame again."""
    frames = view.window.frame_before(view.seconds(ticks))
    known = int(frames.searchsorted(1))
    if view.ease.pace != 1.0:
        follow = view.follow
        eased = ticks - view.seconds(ticks) * view.rate_hz
        # In the stop tail the human's clock goes on at its own pace.
        states.source_tick = np.concatenate([eased[:follow], np.full(len(ticks) - follow, eased[follow - 1])])
    earlier = frames[known:] - 1
    states.detector[known:] = view.window.detector_states.take(earlier, axis=0)
    states.yaws[known:] = view.window.yaws.take(earlier, axis=0)
