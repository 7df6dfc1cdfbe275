"""When a plan is made, which kind, and what it goes on from; the loop's rows are written by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.plan_buffer import PlanBuffer, Ticket
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.motion.clip_library import ClipLibrary
from flexmotion.streamer.motion.intents import Clip
from flexmotion.streamer.motion.targets import TargetMailbox
from flexmotion.streamer.planning.lead import FixedLead, Kind, MeasuredLead
from flexmotion.streamer.planning.planner import Planner
from flexmotion.streamer.planning.replanning import Replanner, Superseded

LEAD = 5


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def retargeter(op3: Robot) -> Retargeter:
    return Retargeter(op3, load_stream())


class Bench:
    """A planner's surroundings: the loop's row, targets, plans."""

    def __init__(self, op3: Robot, retargeter: Retargeter) -> None:
        motion = default_clip()
        self.library = ClipLibrary({"wave": motion[0:120], "walk": motion[225:330], "bow": motion[100:200]}, "wave")
        self.telemetry, self.targets = Telemetry(op3.n, op3.rate_hz), TargetMailbox()
        self.plans = PlanBuffer(op3.n, retargeter.layout.size, retargeter.horizon, op3.rate_hz)
        self.planner = Planner(retargeter, self.library, load_stream())
        self.planning = Replanner(
            self.planner, self.plans, self.telemetry.ticks, load_stream(), self.targets, FixedLead(LEAD)
        )

    def loop_says(self, tick: int, **fields: int) -> None:
        usual = {"state": State.READY, "ready": True, "plan": 0, "pending": 0, "target": 0, "must_stop": False}
        for name, value in {**usual, "tick": tick, "offer": self.plans.newest_id, **fields}.items():
            getattr(self.telemetry.row, name)[...] = value
        self.telemetry.commit()

    def newest(self) -> Ticket:
        offer = self.plans.newest(0)
        assert offer is not None
        self.plans.hold(None, None)
        return offer.ticket

    def first(self) -> None:
        """The first plan, made at tick 100, plays from 105 on."""
        self.loop_says(99)
        assert self.planning.step(100)
        self.loop_says(105, state=State.STREAMING, plan=1, ready=False)


@pytest.fixture
def bench(op3: Robot, retargeter: Retargeter) -> Bench:
    return Bench(op3, retargeter)


def test_nothing_is_planned_before_the_robot_stands(bench: Bench) -> None:
    assert not bench.planning.step(0)  # the loop has said nothing yet
    bench.loop_says(5, ready=False)
    assert not bench.planning.step(6)
    bench.loop_says(6)
    assert bench.planning.step(7)
    assert bench.newest().resumed == 0


def test_a_plan_that_waits_is_waited_for_and_the_next_comes_after_a_quarter_second(bench: Bench) -> None:
    bench.first()
    assert not bench.planning.step(106)
    bench.loop_says(129, state=State.STREAMING, plan=1)
    assert not bench.planning.step(130)
    bench.loop_says(130, state=State.STREAMING, plan=1)
    assert bench.planning.step(131)
    assert (bench.newest().resumed, bench.newest().partial) == (1, False)
    bench.loop_says(132, state=State.STREAMING, plan=1, pending=2)
    assert not bench.planning.step(133)


def test_a_refused_plan_is_made_again_at_once(bench: Bench) -> None:
    bench.first()
    bench.loop_says(130, state=State.STREAMING, plan=1)
    assert bench.planning.step(131)
    bench.loop_says(137, state=State.STREAMING, plan=1, late_plans=1)
    assert bench.planning.step(138)
    assert bench.newest().resumed == 1


def test_a_new_target_gets_a_short_plan_at_once_and_the_whole_one_after_it(bench: Bench) -> None:
    bench.first()
    target = bench.targets.send(Clip("walk"))
    assert bench.planning.step(106)
    ticket = bench.newest()
    assert (ticket.target, ticket.target_ns, ticket.partial) == (target.id, target.stamp_ns, True)
    offer = bench.plans.newest(1)
    assert offer is not None and offer.plan.stop_row == round(load_stream().first_s * 125)
    bench.loop_says(108, state=State.STREAMING, plan=1, pending=2)
    assert not bench.planning.step(109)
    bench.loop_says(112, state=State.STREAMING, plan=2, target=target.id)
    assert bench.planning.step(113)
    assert not bench.newest().partial and bench.newest().resumed == 2


def test_a_target_does_not_wait_for_a_plan_that_waits(bench: Bench) -> None:
    """A plan that joins in 100 ms held up a target for as long."""
    bench.first()
    bench.loop_says(130, state=State.STREAMING, plan=1)
    assert bench.planning.step(131)  # joins at 136
    bench.loop_says(131, state=State.STREAMING, plan=1, pending=2)
    bench.targets.send(Clip("walk"))
    assert bench.planning.step(132)  # would join at 137: the plan that waits plays by then
    assert bench.newest().resumed == 2
    offer = bench.plans.newest(0)
    assert offer is not None and offer.plan.start_tick == 137
    other = Bench(bench.planner.retargeter.robot, bench.planner.retargeter)
    other.first()
    other.loop_says(130, state=State.STREAMING, plan=1)
    assert other.planning.step(140)  # joins at 145
    other.loop_says(131, state=State.STREAMING, plan=1, pending=2)
    other.targets.send(Clip("walk"))
    assert other.planning.step(132)  # joins at 137, before the one that waits
    assert other.newest().resumed == 1


def test_a_stop_is_planned_at_once_and_once(bench: Bench) -> None:
    bench.first()
    bench.loop_says(110, state=State.STREAMING, plan=1, must_stop=True)
    assert bench.planning.step(111)
    assert bench.newest().stops
    bench.loop_says(120, state=State.STREAMING, plan=2, must_stop=True)
    assert not bench.planning.step(121)


def test_what_is_being_made_gives_way_to_a_stop_and_to_a_target(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.first()
    bench.loop_says(130, state=State.STREAMING, plan=1)
    plan = bench.planner.plan
    interrupted: list[str] = []

    def interrupt(*arguments: object, checkpoint: Callable[[], None], **how: object) -> object:
        checkpoint()
        if interrupted:
            return plan(*arguments, checkpoint=checkpoint, **how)  # type: ignore[arg-type]
        interrupted.append("by a target")
        bench.targets.send(Clip("walk"))
        with pytest.raises(Superseded):
            checkpoint()
        raise Superseded

    monkeypatch.setattr(bench.planner, "plan", interrupt)
    assert not bench.planning.step(131)
    assert bench.plans.newest_id == 1
    assert bench.planning.step(132)
    assert bench.newest().partial


def test_targets_in_quick_succession_do_not_starve_one_another(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """A joystick's velocities come faster than plans are made: each plan is finished, the newest target comes next."""
    bench.first()
    plan = bench.planner.plan

    def hurried(*arguments: object, checkpoint: Callable[[], None], **how: object) -> object:
        bench.targets.send(Clip("bow"))
        checkpoint()
        return plan(*arguments, checkpoint=checkpoint, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(bench.planner, "plan", hurried)
    bench.targets.send(Clip("walk"))
    assert bench.planning.step(107) and bench.newest().target == 1
    bench.loop_says(112, state=State.STREAMING, plan=2, target=1)
    assert bench.planning.step(113) and bench.newest().target == 2


def test_an_effect_is_two_degrees_away_from_what_would_have_been_sent(bench: Bench) -> None:
    bench.first()
    bench.loop_says(200, state=State.STREAMING, plan=1)
    bench.targets.send(Clip("bow"))
    assert bench.planning.step(201)
    offer = bench.plans.newest(1)
    assert offer is not None
    before = bench.planning._made[1][1]
    row = offer.ticket.effect_row
    assert row > 0
    offset = offer.plan.start_tick - before.start_tick
    apart = np.abs(offer.plan.q[: row + 1] - before.q[offset : offset + row + 1]).max(axis=1)
    assert apart[row] > np.radians(2.0) and (apart[:row] <= np.radians(2.0)).all()


def test_the_lead_follows_what_plans_take_but_not_one_slow_one() -> None:
    lead = MeasuredLead(125.0, dict.fromkeys(Kind, 0.05), 0.75)
    assert lead.ticks(Kind.WHOLE) == 8  # 1.15 * 50 ms
    for _ in range(40):
        lead.record(Kind.WHOLE, 0.012)
    assert lead.ticks(Kind.WHOLE) == 2 and lead.ticks(Kind.STOP) == 8
    lead.record(Kind.WHOLE, 0.2)
    assert lead.ticks(Kind.WHOLE) == 2
    for _ in range(5):
        lead.record(Kind.WHOLE, 0.03)
    assert lead.ticks(Kind.WHOLE) == 5


def test_however_many_plans_are_refused_the_next_is_made(bench: Bench) -> None:
    """After four late plans in a row the planner had forgotten the one that plays, and fell silent for good."""
    bench.first()
    for tick in range(131, 161, 3):
        bench.loop_says(tick, state=State.STREAMING, plan=1)
        assert bench.planning.step(tick + 1)
        assert bench.newest().resumed == 1
    bench.targets.send(Clip("walk"))
    bench.loop_says(170, state=State.STREAMING, plan=1, pending=bench.plans.newest_id)
    assert bench.planning.step(171)


def test_a_target_that_cannot_be_followed_is_told_and_the_rest_goes_on(bench: Bench) -> None:
    told: list[str] = []
    bench.planning.on_note = told.append
    bench.first()
    bench.targets.send(Clip("fly"))
    assert not bench.planning.step(107)
    assert told == ["target: unknown clip 'fly', expected one of: bow, walk, wave"]
    bench.loop_says(140, state=State.STREAMING, plan=1)
    assert bench.planning.step(141) and bench.newest().target == 0
    bench.targets.send(Clip("walk"))
    bench.loop_says(150, state=State.STREAMING, plan=2)
    assert bench.planning.step(151) and bench.newest().target == 2


def test_the_lead_is_bounded_and_forgets_what_was_held_up() -> None:
    """A planner that had been stopped for seconds once asked for plans that would join seconds ahead."""
    lead = MeasuredLead(125.0, dict.fromkeys(Kind, 0.02), 0.75)
    lead.record(Kind.STOP, 3.6)
    assert lead.ticks(Kind.STOP) == 3
    for _ in range(40):
        lead.record(Kind.STOP, 0.74)
    assert lead.ticks(Kind.STOP) == 94
