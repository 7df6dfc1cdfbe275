"""Plans through shared memory: they are read as written, and no slot in use is overwritten."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.plan_buffer import SLOTS, Offer, PlanBuffer, PlanHead, PlanRows, Ticket

TICKET = Ticket(
    id=1,
    resumed=0,
    asked_tick=90,
    target=3,
    target_ns=12345,
    effect_row=-1,
    partial=False,
    stops=True,
    source_over=False,
    sample_s=0.25,
    retarget_s=0.02,
)


@pytest.fixture(scope="module")
def retargeter() -> Retargeter:
    return Retargeter(load_robot("op3"), load_stream())


@pytest.fixture(scope="module")
def plan(retargeter: Retargeter) -> Plan:
    """A plan with a step in it."""
    made = retargeter.plan(retargeter.standing(), default_clip()[240:290], 0, 100)
    assert made.steps
    return made


@pytest.fixture
def buffer(retargeter: Retargeter) -> PlanBuffer:
    return PlanBuffer(retargeter.robot.n, retargeter.layout.size, retargeter.horizon, retargeter.rate)


def same(found: Plan, plan: Plan) -> None:
    for field in fields(Plan):
        value = getattr(plan, field.name)
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(found, field.name), value, err_msg=field.name)
    for kind, counts in plan.repairs.items():
        np.testing.assert_array_equal(found.repairs[kind], counts)
    assert (found.start_tick, found.stop_row, len(found.steps)) == (plan.start_tick, plan.stop_row, len(plan.steps))
    for one, other in zip(found.steps, plan.steps, strict=True):
        assert (one.side, one.lift, one.land, one.inserted) == (other.side, other.lift, other.land, other.inserted)
        np.testing.assert_array_equal(one.target, other.target)


def test_a_plan_is_read_as_it_was_written(buffer: PlanBuffer, plan: Plan) -> None:
    assert buffer.newest(0) is None and buffer.newest_id == 0
    buffer.publish(TICKET, plan)
    offer = buffer.newest(0)
    assert offer is not None and offer.ticket == TICKET
    same(offer.plan, plan)
    assert offer.plan.human is None  # frames of the source are not in shared memory
    assert buffer.newest(1) is None


def test_a_head_has_every_field_of_a_ticket() -> None:
    kinds = {"int": "i", "float": "f", "bool": "b"}
    head = PlanHead.dtype(joints=20)
    assert {field.name: kinds[str(field.type)] for field in fields(Ticket)} == {
        field.name: head[field.name].kind for field in fields(Ticket)
    }


def test_rows_have_every_array_of_a_plan(plan: Plan) -> None:
    arrays = {field.name for field in fields(Plan) if isinstance(getattr(plan, field.name), np.ndarray)}
    caps = {"torque_cap", "asked_cap"}
    assert arrays - caps | {"repairs"} == set(PlanRows.names())  # the caps are the plan's, in its head


def test_a_plan_too_long_for_a_slot_is_refused_with_a_reason(buffer: PlanBuffer, plan: Plan) -> None:
    longer = replace(plan, q=np.zeros((buffer.rows + 1, plan.q.shape[1])))
    with pytest.raises(RetargetError, match="plan for tick 100"):
        buffer.publish(TICKET, longer)


@settings(max_examples=60)
@given(st.lists(st.sampled_from(["publish", "look", "take", "begin", "drop"]), max_size=40))
def test_no_plan_in_use_is_ever_overwritten(plan: Plan, retargeter: Retargeter, turns: list[str]) -> None:
    """For any order of calls of planner and loop, the plans that the loop holds keep their rows."""
    buffer = PlanBuffer(retargeter.robot.n, retargeter.layout.size, retargeter.horizon, retargeter.rate)
    number, seen = 0, 0
    playing: Offer | None = None
    waiting: Offer | None = None
    for turn in turns:
        if turn == "publish":
            number += 1
            marked = replace(plan, zmp=np.full_like(plan.zmp, number))
            buffer.publish(replace(TICKET, id=number), marked)
        elif turn in ("look", "take"):
            offer = buffer.newest(seen)
            if offer is not None:
                seen = offer.ticket.id
                waiting = offer if turn == "take" else waiting
            buffer.hold(playing, waiting)
        elif turn == "begin" and waiting is not None:
            playing, waiting = waiting, None
            buffer.hold(playing, waiting)
        elif turn == "drop":
            playing = waiting = None
            buffer.hold(playing, waiting)
        for held in (playing, waiting):
            if held is not None:
                assert (held.plan.zmp == held.ticket.id).all()
    assert SLOTS == 5


def test_a_writer_that_dies_in_the_middle_of_a_plan_does_no_harm(
    buffer: PlanBuffer, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffer.publish(TICKET, plan)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("flexmotion.streamer.control.plan_buffer.pack_steps", stop)
    with pytest.raises(KeyboardInterrupt):
        buffer.publish(replace(TICKET, id=2), replace(plan, zmp=np.full_like(plan.zmp, 9.0)))
    offer = buffer.newest(0)
    assert offer is not None and offer.ticket.id == 1
    same(offer.plan, plan)
