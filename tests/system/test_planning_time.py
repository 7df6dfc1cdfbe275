"""Plans that take time to make, on the real clock of the program: they join in time, at the distance measured."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.intents import Text, Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.run.session import Session

from ..streamer.stub_sampler import StubSampler
from ..virtual_time import Costs

Live = Callable[..., Any]

WALKED = [State.READY, State.STREAMING, State.HOLD, State.PARK, State.OFF]
MARGIN = 1.15
"""The measured lead is this much longer than plans took."""
AT_FIRST_S = 0.02
"""Assumed time of a plan for a new target, until one was made [s]."""
WHOLE_AT_FIRST_S = 0.05
"""Likewise of a whole plan [s]."""
POLL_TICKS = 2
"""A plan is begun this long after it is due: the planner looks every 2 ms, at rows of the tick before."""


def costs_s(run: Any) -> np.ndarray:
    """Time that each plan took, by the trace [s]."""
    return np.array([plan.sample_s + plan.retarget_s for plan in run.record.plans])


def test_a_robot_walks_on_plans_that_take_time(live: Live) -> None:
    """With a lead of 0 every plan came too late, no test saw it, and the run ended with "no plan for 5 s"."""
    run = live([(4.0, lambda _session: None)], end_s=1.5, costs=Costs(plan_s=0.02, checkpoint_s=0.001))
    assert run.states == WALKED and run.upright
    assert run.messages("fault") == [] and run.record.underruns == 0
    assert run.record.steps_planned > 3 and run.record.true_base[-1, 0] > 0.1
    assert (costs_s(run) >= 0.02).all()


@pytest.mark.parametrize("plan_s", [0.06, 0.12])
def test_the_lead_follows_the_time_that_plans_take(live: Live, plan_s: float) -> None:
    """A first plan that takes longer than assumed is refused, and the one after it joins."""
    run = live([(3.0, lambda _session: None)], end_s=1.0, costs=Costs(plan_s=plan_s))
    assert run.states == WALKED and run.messages("fault") == [] and run.record.underruns == 0
    lead = np.array([plan.join_tick - plan.asked_tick for plan in run.record.plans])
    assert len(lead) > 8
    assert costs_s(run) == pytest.approx(plan_s, abs=1e-6)
    rate = run.record.rate_hz
    # The first plan and the stop at the end are the first of their kinds: what they take after sampling is assumed.
    assert lead.min() > plan_s * rate - 1 and lead[1:-1].max() <= MARGIN * plan_s * rate + POLL_TICKS
    assert lead.max() <= MARGIN * (plan_s + WHOLE_AT_FIRST_S) * rate + POLL_TICKS


def test_a_target_becomes_commands_within_the_time_of_one_plan(live: Live) -> None:
    """The plan that is being made is dropped for a new target at its next checkpoint."""
    sent: list[int] = []

    def turn(session: Session) -> None:
        sent.append(session.targets.send(Velocity(0.0, 0.0, 0.3)).id)

    source = ModelSource(StubSampler(), [Item(0.0, Text("stand still"))], "model:stub")  # type: ignore[arg-type]
    costs = Costs(plan_s=0.01, checkpoint_s=0.0005)
    run = live([(2.0, turn)], end_s=1.5, source=source, costs=costs)
    assert run.states == WALKED and run.messages("fault") == [] and run.record.underruns == 0
    after = run.record.rows[run.record.stamp_ns > run.acted_ns[0]]
    followed = int(np.argmax(after["target"] == sent[0]))
    assert after["target"][followed] == sent[0]
    # The plan in the making goes on until its first checkpoint; the next one joins at the lead assumed at first.
    assert followed <= (costs.plan_s + MARGIN * AT_FIRST_S) * run.record.rate_hz + POLL_TICKS + 1
