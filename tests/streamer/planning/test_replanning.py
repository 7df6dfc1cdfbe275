"""When a plan is made, of which kind, and which plan it resumes; the test writes the loop's rows."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

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
from flexmotion.streamer.motion.heard import Heard, HeardChannel, heard_since
from flexmotion.streamer.motion.intents import Clip
from flexmotion.streamer.motion.targets import TargetMailbox
from flexmotion.streamer.planning.ease_notes import EASED
from flexmotion.streamer.planning.lead import FixedLead, Kind, Lead, MeasuredLead
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
    """A replanner with its inputs: rows of the loop, targets, plans."""

    def __init__(self, op3: Robot, retargeter: Retargeter, lead: Lead | None = None) -> None:
        motion = default_clip()
        self.library = ClipLibrary({"wave": motion[0:120], "walk": motion[225:330], "bow": motion[100:200]}, "wave")
        self.telemetry, self.targets = Telemetry(op3.n, op3.rate_hz), TargetMailbox()
        self.plans = PlanBuffer(op3.n, retargeter.layout.size, retargeter.horizon, op3.rate_hz)
        self.planner = Planner(retargeter, self.library, load_stream())
        self.replanner = Replanner(
            self.planner,
            self.plans,
            self.telemetry.ticks,
            load_stream(),
            self.targets,
            FixedLead(LEAD) if lead is None else lead,
            lockstep=lead is None,
        )

    def publish_row(self, tick: int, **fields: Any) -> None:
        usual: dict[str, Any] = {"state": State.READY, "ready": True, "must_stop": False}
        usual |= {"plan": 0, "pending": 0, "target": 0}
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
        self.publish_row(99)
        assert self.replanner.step(100)
        self.publish_row(105, state=State.STREAMING, plan=1, ready=False)


@pytest.fixture
def bench(op3: Robot, retargeter: Retargeter) -> Bench:
    return Bench(op3, retargeter)


def test_no_plan_is_made_before_the_robot_stands(bench: Bench) -> None:
    assert not bench.replanner.step(0)  # the loop has published no row
    bench.publish_row(5, ready=False)
    assert not bench.replanner.step(6)
    bench.publish_row(6)
    assert bench.replanner.step(7)
    assert bench.newest().resumed == 0


def test_the_next_plan_comes_after_a_quarter_second_and_not_while_one_waits(bench: Bench) -> None:
    bench.first()
    assert not bench.replanner.step(106)
    bench.publish_row(129, state=State.STREAMING, plan=1)
    assert not bench.replanner.step(130)
    bench.publish_row(130, state=State.STREAMING, plan=1)
    assert bench.replanner.step(131)
    assert (bench.newest().resumed, bench.newest().partial) == (1, False)
    bench.publish_row(132, state=State.STREAMING, plan=1, pending=2)
    assert not bench.replanner.step(133)


def test_a_push_of_a_robot_on_one_foot_is_answered_before_the_next_plan_is_due(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench.replanner.made, "lands_in", lambda _row: 30)
    swayed = {"state": State.STREAMING, "plan": 1, "contact_ref": (False, True), "dcm_ref": (0.0, 0.0)}
    bench.first()
    bench.publish_row(110, **swayed, dcm=(0.03, 0.0))
    assert not bench.replanner.step(111)  # one row alone may be a lie
    bench.publish_row(111, **swayed, dcm=(0.03, 0.0))
    assert bench.replanner.step(112)
    assert (bench.newest().resumed, bench.newest().stops) == (1, False)
    bench.publish_row(112, **swayed, dcm=(0.03, 0.0), pending=2)
    assert not bench.replanner.step(113)  # not while one waits


def test_a_robot_that_is_frozen_on_one_foot_is_watched_past_the_end_of_its_plan(bench: Bench) -> None:
    """Went wrong: no row of the plan was left, the planner ended, and the held robot parked on one leg after 2 s."""
    bench.first()
    plan = bench.replanner.made.plan(1)
    assert plan is not None
    frozen = {"state": State.HOLD, "plan": 1, "contact_ref": (False, True), "must_stop": True}
    for tick in (plan.end_tick - 1, plan.end_tick, plan.end_tick + 1, plan.end_tick + 5000):
        bench.publish_row(tick, **frozen)
        bench.replanner.step(tick + 1)
    assert bench.replanner.push.sway is None


def test_a_push_makes_no_plan_of_a_robot_that_must_stop(bench: Bench) -> None:
    bench.first()
    bench.publish_row(110, state=State.STREAMING, plan=1, must_stop=True)
    assert bench.replanner.step(111)
    assert bench.newest().stops
    for tick in (120, 121, 122):
        fields = {"contact_ref": (False, True), "dcm_ref": (0.0, 0.0), "dcm": (0.05, 0.0)}
        bench.publish_row(tick, state=State.STREAMING, plan=2, must_stop=True, **fields)
        assert not bench.replanner.step(tick + 1)


def test_a_refused_plan_is_made_again_at_once(bench: Bench) -> None:
    bench.first()
    bench.publish_row(130, state=State.STREAMING, plan=1)
    assert bench.replanner.step(131)
    bench.publish_row(137, state=State.STREAMING, plan=1, late_plans=1)
    assert bench.replanner.step(138)
    assert bench.newest().resumed == 1


def test_a_new_target_gets_a_short_plan_at_once_and_the_whole_one_after_it(bench: Bench) -> None:
    bench.first()
    target = bench.targets.send(Clip("walk"))
    assert bench.replanner.step(106)
    ticket = bench.newest()
    assert (ticket.target, ticket.target_ns, ticket.partial) == (target.id, target.stamp_ns, True)
    offer = bench.plans.newest(1)
    assert offer is not None and offer.plan.stop_row == round(load_stream().first_s * 125)
    bench.publish_row(108, state=State.STREAMING, plan=1, pending=2)
    assert not bench.replanner.step(109)
    bench.publish_row(112, state=State.STREAMING, plan=2, target=target.id)
    assert bench.replanner.step(113)
    assert not bench.newest().partial and bench.newest().resumed == 2


def test_a_target_is_planned_for_while_another_plan_waits(bench: Bench) -> None:
    """A plan that joined in 100 ms delayed a target by as much."""
    bench.first()
    bench.publish_row(130, state=State.STREAMING, plan=1)
    assert bench.replanner.step(131)  # joins at 136
    bench.publish_row(131, state=State.STREAMING, plan=1, pending=2)
    bench.targets.send(Clip("walk"))
    assert bench.replanner.step(132)  # would join at 137: the plan that waits plays by then
    assert bench.newest().resumed == 2
    offer = bench.plans.newest(0)
    assert offer is not None and offer.plan.start_tick == 137
    other = Bench(bench.planner.retargeter.robot, bench.planner.retargeter)
    other.first()
    other.publish_row(130, state=State.STREAMING, plan=1)
    assert other.replanner.step(140)  # joins at 145
    other.publish_row(131, state=State.STREAMING, plan=1, pending=2)
    other.targets.send(Clip("walk"))
    assert other.replanner.step(132)  # joins at 137, before the one that waits
    assert other.newest().resumed == 1


def test_a_stop_is_planned_at_once_and_once(bench: Bench) -> None:
    bench.first()
    bench.publish_row(110, state=State.STREAMING, plan=1, must_stop=True)
    assert bench.replanner.step(111)
    assert bench.newest().stops
    bench.publish_row(120, state=State.STREAMING, plan=2, must_stop=True)
    assert not bench.replanner.step(121)


def test_a_plan_in_the_making_is_dropped_for_a_stop_and_for_a_target(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.first()
    bench.publish_row(130, state=State.STREAMING, plan=1)
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
    assert not bench.replanner.step(131)
    assert bench.plans.newest_id == 1
    assert bench.replanner.step(132)
    assert bench.newest().partial


def test_frequent_targets_do_not_prevent_plans(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """A joystick's velocities come faster than plans: one is given up for a newer target, the one after it is not."""
    bench.first()
    plan = bench.planner.plan

    def hurried(*arguments: object, checkpoint: Callable[[], None], **how: object) -> object:
        clips.reverse()
        bench.targets.send(Clip(clips[0]))
        checkpoint()
        return plan(*arguments, checkpoint=checkpoint, **how)  # type: ignore[arg-type]

    clips = ["bow", "walk"]
    monkeypatch.setattr(bench.planner, "plan", hurried)
    bench.targets.send(Clip("bow"))
    assert not bench.replanner.step(107) and bench.replanner.gave_up
    assert bench.replanner.step(107) and bench.newest().target == 2 and not bench.replanner.gave_up
    bench.publish_row(120, state=State.STREAMING, plan=2, target=2)
    assert bench.replanner.step(121) and bench.newest().target == 2  # the whole plan: a target lasts for 0.2 s
    bench.publish_row(132, state=State.STREAMING, plan=3, target=2)
    assert not bench.replanner.step(133) and bench.replanner.step(133)
    assert bench.newest().target == 5


def test_a_target_right_after_another_is_followed_at_once(
    op3: Robot, retargeter: Retargeter, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It waited for the shortest time between two changes: of 1,000 targets the slowest hundredth took 231 ms.

    The plan is the one that would have been made had the other target never come.
    """
    benches = [Bench(op3, retargeter) for _ in range(2)]
    for bench, sent in zip(benches, (["bow", "walk"], ["walk"]), strict=True):
        answers = list[Heard]()
        monkeypatch.setattr(bench.replanner.ledger, "publish", answers.append)
        plan = bench.planner.plan

        def interrupted(*arguments: object, checkpoint: Callable[[], None], **how: object) -> object:
            made = plan(*arguments, checkpoint=lambda: None, **how)  # type: ignore[arg-type]  # noqa: B023
            if len(sent) > 1:  # noqa: B023
                bench.targets.send(Clip(sent.pop()))  # noqa: B023
            checkpoint()
            return made

        bench.first()
        monkeypatch.setattr(bench.planner, "plan", interrupted)
        bench.targets.send(Clip(sent[0]))
        if bench is benches[0]:
            assert not bench.replanner.step(107)
            assert bench.replanner.has_target, "it would be looked at with the loop's next row"
        assert bench.replanner.step(107)
        bench.publish_row(112, state=State.STREAMING, plan=2, target=bench.newest().target)
        bench.replanner.step(113)
        states = [(answer.asked, answer.state) for answer in answers]
        assert states == [*([("bow", "superseded")] if bench is benches[0] else []), ("walk", "accepted")]
    offers = [bench.plans.newest(1) for bench in benches]
    assert offers[0] is not None and offers[1] is not None
    np.testing.assert_array_equal(offers[0].plan.q, offers[1].plan.q)


def test_frequent_targets_do_not_prevent_the_first_plan(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Right after it was armed a robot did not move for a stick: each newer target ended the making of its first plan.

    Seen where that plan takes longer than a target must last (`change_s`).
    """
    plan = bench.planner.plan
    must_stop = True

    def slow(*arguments: object, checkpoint: Callable[[], None], **how: object) -> object:
        bench.targets.send(Clip("bow"))
        bench.publish_row(140, must_stop=must_stop)
        bench.replanner.ledger.take(140)  # the time that a target must last is over
        checkpoint()
        return plan(*arguments, checkpoint=checkpoint, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(bench.planner, "plan", slow)
    first = bench.targets.send(Clip("walk"))
    bench.publish_row(99)
    assert not bench.replanner.step(100)  # a stop ends the making of any plan
    must_stop = False
    bench.publish_row(199)
    assert bench.replanner.step(200)
    assert not bench.newest().partial and bench.newest().target > first.id


def test_an_effect_is_two_degrees_away_from_what_would_have_been_sent(bench: Bench) -> None:
    bench.first()
    bench.publish_row(200, state=State.STREAMING, plan=1)
    bench.targets.send(Clip("bow"))
    assert bench.replanner.step(201)
    offer = bench.plans.newest(1)
    assert offer is not None
    before = bench.replanner.made.plan(1)
    assert before is not None
    row = offer.ticket.effect_row
    assert row > 0
    offset = offer.plan.start_tick - before.start_tick
    apart = np.abs(offer.plan.q[: row + 1] - before.q[offset : offset + row + 1]).max(axis=1)
    assert apart[row] > np.radians(2.0) and (apart[:row] <= np.radians(2.0)).all()


def _ticks(lead: MeasuredLead, kind: Kind, now: float = 100.0, spent_s: float | None = None) -> int:
    return lead.join(kind, now, spent_s) - 100


def test_the_lead_follows_the_times_of_plans_but_not_one_slow_plan() -> None:
    lead = MeasuredLead(125.0, dict.fromkeys(Kind, 0.05), 0.75)
    assert _ticks(lead, Kind.WHOLE) == 8  # 1.15 * 50 ms
    for _ in range(40):
        lead.record(Kind.WHOLE, 0.0, 0.012)
    assert _ticks(lead, Kind.WHOLE) == 2 and _ticks(lead, Kind.STOP) == 7  # a stop may come a tick late
    lead.record(Kind.WHOLE, 0.0, 0.2)
    assert _ticks(lead, Kind.WHOLE) == 2
    for _ in range(5):
        lead.record(Kind.WHOLE, 0.0, 0.03)
    assert _ticks(lead, Kind.WHOLE) == 5


def test_the_lead_counts_from_now_and_not_from_the_next_tick() -> None:
    """A plan of 14 ms that began just after a tick joined 24 ms later, at the third tick instead of the second."""
    lead = MeasuredLead(125.0, dict.fromkeys(Kind, 0.012), 0.75)  # 1.725 ticks with the margin
    assert [_ticks(lead, Kind.WHOLE, 100.0 + part) for part in (0.05, 0.25, 0.3, 0.95)] == [2, 2, 3, 3]


def test_a_target_does_not_wait_for_the_slowest_plans_where_the_loop_still_takes_them() -> None:
    """Each target waited for the slowest of twenty plans: 14 ms of 42 in which nothing was done for it."""
    lead = MeasuredLead(125.0, dict.fromkeys(Kind, 0.02), 0.75)
    for took in (*[0.014] * 30, *[0.02] * 2):
        for kind in Kind:
            lead.record(kind, 0.0, took)
    assert (_ticks(lead, Kind.WHOLE), _ticks(lead, Kind.PARTIAL), _ticks(lead, Kind.STOP)) == (3, 2, 2)
    for _ in range(4):
        lead.record(Kind.PARTIAL, 0.0, 0.028)  # 4.025 ticks with the margin, of which the loop takes one
    assert _ticks(lead, Kind.PARTIAL) == 4


def test_a_person_who_is_mirrored_does_not_wait_for_the_slowest_plans_either() -> None:
    """Each pose waited for a tick in which the loop would have taken its plan: the arm came 8 ms later."""
    lead = MeasuredLead(125.0, dict.fromkeys(Kind, 0.02), 0.75)
    for took in (*[0.014] * 30, *[0.02] * 2):
        lead.record(Kind.WHOLE, 0.0, took)
    assert (lead.join(Kind.WHOLE, 0.0), lead.join(Kind.WHOLE, 0.0, soon=True)) == (3, 2)


def test_a_target_does_not_wait_for_the_median_of_plans_either() -> None:
    """It joined after the median: of plans that were ready sooner each waited, though slower ones cost nothing."""
    lead = MeasuredLead(125.0, dict.fromkeys(Kind, 0.02), 0.75)
    for took in (*[0.0125] * 12, *[0.0165] * 20):
        lead.record(Kind.PARTIAL, 0.0, took)
    # The slowest take 2.37 ticks with the margin, of which the loop takes one; hardly any is ready before 1.56.
    assert [_ticks(lead, Kind.PARTIAL, 100.0 + part) for part in (0.05, 0.4, 0.45)] == [2, 2, 3]


def test_slow_sampling_puts_a_plan_off_and_does_not_make_it_late() -> None:
    """Words that are read for the first time took longer than the lead: the plan was late, and was made once more."""
    lead = MeasuredLead(125.0, dict.fromkeys(Kind, 0.01), 0.75)
    for took in (0.01, 0.012, 0.09):
        lead.record(Kind.PARTIAL, took, 0.01)
    assert _ticks(lead, Kind.PARTIAL) == 3  # the median of sampling
    assert _ticks(lead, Kind.PARTIAL, spent_s=0.004) == 2
    assert _ticks(lead, Kind.PARTIAL, spent_s=0.09) == 13


class _SlowSampling:
    """A lead that finds out, once the motion is sampled, that a plan joins later."""

    def join(self, kind: Kind, now: float, spent_s: float | None = None, *, soon: bool = False) -> int:
        return math.ceil(now) + (LEAD if spent_s is None else 3 * LEAD)

    def record(self, kind: Kind, sampling_s: float, rest_s: float) -> None:
        assert sampling_s > 0.0 and rest_s > 0.0


def test_a_plan_whose_sampling_took_long_joins_later(op3: Robot, retargeter: Retargeter) -> None:
    bench = Bench(op3, retargeter, _SlowSampling())
    bench.publish_row(99)
    assert bench.replanner.step(100)
    bench.publish_row(115, state=State.STREAMING, plan=1, ready=False)
    bench.targets.send(Clip("walk"))
    assert bench.replanner.step(116, early=0.25)
    offer = bench.plans.newest(1)
    assert offer is not None and offer.plan.start_tick == 131


class _HalfATick(_SlowSampling):
    """A lead of half a tick."""

    def join(self, kind: Kind, now: float, spent_s: float | None = None, *, soon: bool = False) -> int:
        return math.ceil(now + 0.5)


def test_a_way_is_measured_by_the_stop_that_would_be_made(
    op3: Robot, retargeter: Retargeter, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the real clock "walk half a metre" ended after .28 m.

    The stop joined one tick before the one that the way was foreseen with, and did not make the step that settled in
    between.
    """
    bench = Bench(op3, retargeter, _HalfATick())
    joins: list[int] = []

    def stands_at(join: int, plan: object) -> np.ndarray:
        joins.append(join)
        return np.zeros(3)

    monkeypatch.setattr(bench.planner, "stands_at", stands_at)

    def update(row: object, *, halted: object, stands_at: Callable[[], np.ndarray]) -> None:
        stands_at()

    runner = SimpleNamespace(
        update=update, wanted=None, aside=0.0, faces=False, over=False, travels=False, under_way=None
    )
    monkeypatch.setattr(bench.replanner, "_runner", runner)
    bench.publish_row(99)
    for early in (0.0, 0.25, 0.75):
        bench.replanner.step(100, early=early)
    assert joins == [_HalfATick().join(Kind.STOP, 100 - early) for early in (0.0, 0.25, 0.75)] == [101, 101, 100]


def test_after_any_number_of_refused_plans_the_next_is_made(bench: Bench) -> None:
    """After four late plans in a row the planner had dropped the one that plays, and made no more plans."""
    bench.first()
    for tick in range(131, 161, 3):
        bench.publish_row(tick, state=State.STREAMING, plan=1)
        assert bench.replanner.step(tick + 1)
        assert bench.newest().resumed == 1
    bench.targets.send(Clip("walk"))
    bench.publish_row(170, state=State.STREAMING, plan=1, pending=bench.plans.newest_id)
    assert bench.replanner.step(171)


def test_a_target_that_cannot_be_followed_is_reported_and_planning_continues(bench: Bench) -> None:
    notes: list[str] = []
    bench.replanner.on_note = notes.append
    bench.first()
    bench.targets.send(Clip("fly"))
    assert not bench.replanner.step(107)
    assert notes == ["target: unknown clip 'fly', expected one of: bow, walk, wave"]
    bench.publish_row(140, state=State.STREAMING, plan=1)
    assert bench.replanner.step(141) and bench.newest().target == 0
    bench.targets.send(Clip("walk"))
    bench.publish_row(150, state=State.STREAMING, plan=2)
    assert bench.replanner.step(151) and bench.newest().target == 2


def test_the_lead_is_bounded_and_ignores_delayed_plans() -> None:
    """A planner that had been stopped for seconds made plans that joined seconds ahead."""
    lead = MeasuredLead(125.0, dict.fromkeys(Kind, 0.02), 0.75)
    lead.record(Kind.STOP, 0.0, 3.6)
    assert _ticks(lead, Kind.STOP) == 3
    for _ in range(40):
        lead.record(Kind.STOP, 0.0, 0.74)
    assert _ticks(lead, Kind.STOP) == 94


@pytest.mark.parametrize(("share", "state"), [(0.6, "slowed"), (0.12, "refused")])
def test_a_target_beyond_the_envelope_is_eased_and_its_answer_says_so(op3: Robot, share: float, state: str) -> None:
    """Of two robots with less torque one follows a walk more slowly, the other comes to a stand."""
    weak = copy.copy(op3)
    for name in ("stall_torque", "usable_torque", "back_emf"):
        setattr(weak, name, share * getattr(op3, name))
    settings = load_stream().model_copy(update={"effort_limit": 1.0})
    bench, heard, notes = Bench(op3, Retargeter(weak, settings)), HeardChannel(), list[str]()
    bench.replanner = Replanner(
        bench.planner,
        bench.plans,
        bench.telemetry.ticks,
        settings,
        bench.targets,
        FixedLead(LEAD),
        notes.append,
        heard,
        lockstep=True,
    )
    reader, answers = heard.reader(), list[Heard]()
    bench.first()
    target, tick = bench.targets.send(Clip("walk")), 106
    while not any(answer.state == state for answer in answers):
        assert tick < 1500
        if bench.replanner.step(tick):
            offer = bench.plans.newest(0)
            assert offer is not None
            bench.plans.hold(None, None)
            tick = max(offer.plan.start_tick, tick) + 1
            playing = offer.ticket
            bench.publish_row(tick - 1, state=State.STREAMING, plan=playing.id, target=playing.target, ready=False)
        else:
            tick += 5
            bench.publish_row(tick - 1, state=State.STREAMING, plan=playing.id, target=playing.target, ready=False)
        answers += heard_since(reader)
    assert answers[-1].id == target.id
    assert "times its servo's envelope" in str(answers[-1].reason if state == "refused" else answers[-1].notes)
    assert any(note.startswith(EASED) for note in notes)
    assert bool(bench.replanner.ledger.halted) is (state == "refused")
