"""Which target counts, how long it holds, and the one answer that each gets."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.motion.heard import Heard, HeardChannel
from flexmotion.streamer.motion.intents import Intent, Stop, Text, Velocity, Waypoint
from flexmotion.streamer.motion.targets import NO_TARGET, TargetMailbox
from flexmotion.streamer.planning.target_ledger import TargetLedger

RATE = 100.0
WALK, WAVE = Velocity(0.3, 0.0, 0.0), Text("wave")


class Bench:
    """A ledger in lockstep; the test is source and loop."""

    def __init__(self, change_s: float = 0.0) -> None:
        self.mailbox = TargetMailbox()
        self.notes: list[str] = []
        self.told: list[Heard] = []
        inbox = self.mailbox.reader()
        self.ledger = TargetLedger(
            inbox, self.told.append, self.notes.append, rate_hz=RATE, change_s=change_s, lockstep=True
        )
        self._telemetry = Telemetry(1, RATE)
        self.taken = 0

    def look(self, tick: int, **row: Any) -> None:
        for name, value in {"state": State.STREAMING, "must_stop": False, **row}.items():
            getattr(self._telemetry.row, name)[...] = value
        self.ledger.take(tick)
        self.ledger.settle(self._telemetry.row, self.taken, lambda target: 1000 + target)

    @property
    def states(self) -> list[tuple[int, str]]:
        return [(answer.id, answer.state) for answer in self.told]

    def follow(self, tick: int, heard: Heard | None = None) -> None:
        """The source turns to the wanted target, and the loop takes the plan."""
        target = self.ledger.wanted
        self.ledger.turned(target, heard)
        self.taken = target.id
        self.look(tick, target=target.id)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_target_is_accepted_when_the_loop_has_taken_a_plan_and_not_before(bench: Bench) -> None:
    target = bench.mailbox.send(WAVE)
    bench.look(10)
    assert bench.ledger.wanted == target
    bench.ledger.turned(target, Heard(asked="wave", state="accepted", heard_as="wave-right-hand", certainty=0.9))
    bench.look(11)
    assert bench.told == [] and bench.ledger.wanted == target
    bench.taken = target.id
    bench.look(12)
    (answer,) = bench.told
    assert (answer.state, answer.tick, answer.heard_as) == ("accepted", 1001, "wave-right-hand")
    assert (answer.at_s, answer.certainty) == (10.01, 0.9)


def test_an_answer_names_a_stop_as_such(bench: Bench) -> None:
    """The history listed "True: too late"."""
    bench.mailbox.send(Stop())
    bench.mailbox.send(WALK)
    bench.look(10)
    (answer,) = bench.told
    assert (answer.asked, answer.state) == ("stand still", "superseded")


def test_words_that_mean_nothing_are_refused_with_what_the_robot_does_instead(bench: Bench) -> None:
    bench.mailbox.send(Text("fly"))
    bench.look(10)
    bench.follow(11, Heard(asked="fly", state="refused", reason="'fly' is not understood, the model stands still"))
    assert bench.states == [(1, "refused")] and "stands still" in str(bench.told[0].reason)


def test_only_the_newest_of_several_counts(bench: Bench) -> None:
    for intent in (WAVE, WALK, WAVE):
        newest = bench.mailbox.send(intent)
    bench.look(10)
    assert bench.states == [(1, "superseded"), (2, "superseded")] and bench.ledger.wanted == newest


def test_a_planned_target_is_superseded_only_when_the_source_turns_to_another(bench: Bench) -> None:
    """Answered at once, a target would have been called superseded by one that was then refused, and followed."""
    first = bench.mailbox.send(WAVE)
    bench.look(10)
    bench.ledger.turned(first, None)
    second = bench.mailbox.send(WALK)
    bench.look(11)
    assert bench.told == [] and bench.ledger.wanted == second
    bench.ledger.refuse(second, "cannot")
    assert bench.ledger.wanted == first
    bench.taken = first.id
    bench.look(12)
    assert bench.states == [(2, "refused"), (1, "accepted")]


def test_a_target_that_no_plan_follows_in_time_expires(bench: Bench) -> None:
    bench.mailbox.send(WAVE, take_up_s=2.0)
    bench.look(100)
    bench.look(299, state=State.READY)
    assert bench.told == []
    bench.look(301, state=State.READY)
    assert bench.states == [(1, "expired")] and bench.told[0].reason == "no plan followed it within 2 s"
    assert bench.ledger.wanted is NO_TARGET


def test_a_velocity_that_is_not_sent_again_brings_the_robot_to_a_stand(bench: Bench) -> None:
    bench.mailbox.send(WALK, holds_s=0.5)
    bench.look(100)
    bench.follow(104)
    bench.look(149)
    assert not bench.ledger.halted
    bench.look(151)
    assert bench.ledger.halted == "expired" and bench.ledger.wanted is NO_TARGET
    assert bench.notes == ["target 1 is over after 0.5 s: coming to a stand"]
    bench.mailbox.send(WAVE)
    bench.look(400)
    bench.follow(401)
    assert not bench.ledger.halted and bench.states == [(1, "accepted"), (2, "accepted")]


def test_a_target_that_was_cut_before_the_loop_had_its_plan_went_on_for_who_had_asked(bench: Bench) -> None:
    """Its answer was "accepted", and nothing told that the robot came to a stand at once."""
    bench.mailbox.send(WALK)
    bench.look(10)
    bench.ledger.turned(bench.ledger.wanted, None)
    bench.ledger.cut("left foot kept down")
    bench.look(11)
    assert bench.told == []
    bench.taken = 1
    bench.look(12, target=1)
    bench.look(13, target=1)
    assert [(one.state, one.over, one.reason) for one in bench.told] == [
        ("accepted", None, None),
        ("accepted", "stopped", "left foot kept down"),
    ]
    assert bench.ledger.halted == "stopped" and bench.ledger.wanted is NO_TARGET


def test_a_turn_that_is_taken_back_leaves_what_a_kept_foot_has_cut_over(bench: Bench) -> None:
    bench.mailbox.send(WALK)
    bench.look(10)
    bench.follow(11)
    bench.ledger.cut("left foot kept down")
    bench.mailbox.send(WAVE)
    bench.ledger.take(12)
    bench.ledger.turned(bench.ledger.wanted, None)
    bench.ledger.give_way()
    bench.look(13, target=1)
    assert bench.told[-1].over == "stopped" and bench.ledger.halted == "stopped"


def test_a_stick_that_is_held_goes_on_without_a_new_plan(bench: Bench) -> None:
    bench.mailbox.send(WALK, holds_s=0.5)
    bench.look(100)
    bench.follow(104)
    for tick in range(140, 500, 40):
        bench.mailbox.send(WALK, holds_s=0.5)
        bench.look(tick)
        assert bench.ledger.wanted.id == 1, "the loop would be offered a plan for each message"
    assert [state for _, state in bench.states] == ["accepted"] * 10 and not bench.ledger.halted
    bench.look(460 + 51)
    assert bench.ledger.halted


def test_a_flood_changes_what_is_followed_no_faster_than_the_robot_can_and_a_stop_does_not_wait() -> None:
    """25 changes a second felled the robot: steps are settled further ahead than its short plans reached."""
    bench = Bench(change_s=0.2)
    turned = []
    for tick in range(100, 200, 2):
        bench.mailbox.send(Velocity(0.0, 0.0, tick / 1000.0))
        bench.look(tick)
        if bench.ledger.wanted.id > bench.taken:
            turned.append(tick)
            bench.follow(tick + 1)
    gaps = [after - before for before, after in pairwise(turned)]
    assert len(turned) == 5 and min(gaps) >= 0.2 * RATE and max(gaps) <= 0.2 * RATE + 2
    newest = bench.mailbox.send(Stop())
    bench.look(200)
    assert bench.ledger.wanted == newest
    bench.follow(201)
    assert len(bench.told) == 51 and bench.states[-1] == (51, "accepted")


def test_of_two_targets_in_quick_succession_the_newer_counts_at_once() -> None:
    """The newer one waited until the older one had lasted for 0.2 s."""
    bench = Bench(change_s=0.2)
    first = bench.mailbox.send(WALK)
    bench.look(100)
    bench.ledger.turned(first, None)
    bench.mailbox.send(WALK)
    bench.look(100)
    assert not bench.ledger.replaces(first), "a velocity that is sent again only holds longer"
    newer = bench.mailbox.send(WAVE)
    bench.look(101)
    assert bench.ledger.wanted == first and bench.ledger.replaces(first)
    bench.ledger.give_way()
    assert bench.states == [(2, "superseded"), (1, "superseded")] and bench.ledger.wanted == newer
    bench.ledger.turned(newer, None)
    third = bench.mailbox.send(WALK)
    bench.look(102)
    assert not bench.ledger.replaces(newer), "a flood would leave no plan at all"
    bench.taken = newer.id
    bench.look(103)
    assert bench.states[-1] == (newer.id, "accepted") and bench.ledger.wanted == newer
    bench.look(122)
    assert bench.ledger.wanted == third, "0.2 s after the change that was made"


def test_words_that_are_sent_twice_at_once_are_one_change() -> None:
    """The second ones waited for 0.2 s, then cut short the motion of the first for the same one."""
    bench = Bench(change_s=0.2)
    first = bench.mailbox.send(WAVE)
    bench.look(100)
    bench.ledger.turned(first, None)
    again = bench.mailbox.send(WAVE)
    bench.look(101)
    assert bench.ledger.replaces(first)
    bench.ledger.give_way()
    assert bench.states == [(first.id, "superseded")] and bench.ledger.wanted == again


@pytest.mark.parametrize("intent", [WALK, Stop(), Waypoint(1.0, 0.0)], ids=str)
def test_what_holds_already_is_not_begun_again(intent: Intent) -> None:
    """A robot that comes to a stand because a stick sends zeros fifty times a second stands no later for it."""
    bench = Bench(change_s=0.2)
    first = bench.mailbox.send(intent)
    bench.look(100)
    bench.ledger.turned(first, None)
    bench.mailbox.send(intent)
    bench.look(101)
    assert not bench.ledger.replaces(first)


def test_a_target_that_gives_way_while_the_robot_is_to_stand_leaves_it_standing() -> None:
    """Had the newer one been refused, what was asked before the stop would have gone on."""
    bench = Bench()
    bench.ledger.halted = "stopped"
    first = bench.mailbox.send(WALK)
    bench.look(100)
    bench.ledger.turned(first, None)
    second = bench.mailbox.send(WAVE)
    bench.look(101)
    bench.ledger.give_way()
    bench.ledger.refuse(second, "cannot")
    assert bench.ledger.halted and bench.ledger.wanted is NO_TARGET


def test_a_stop_refuses_what_is_asked_meanwhile_and_what_was_asked_before_does_not_go_on(bench: Bench) -> None:
    """A robot that had been stopped walked on when the stop was released."""
    bench.mailbox.send(WALK)
    bench.look(100)
    bench.follow(104)
    bench.mailbox.send(WAVE)
    bench.look(110, must_stop=True)
    assert bench.states[-1] == (2, "refused") and "release the stop first" in str(bench.told[-1].reason)
    bench.look(300, must_stop=False, state=State.HOLD)
    assert bench.ledger.halted and bench.ledger.wanted is NO_TARGET


@pytest.mark.parametrize(
    ("state", "reason"),
    [
        (State.OFF, "arm the robot first"),
        (State.PARK, "lowers itself (PARK)"),
        (State.DAMPED, "the robot has fallen"),
        (State.FAULT, "clear the fault, then arm the robot"),
    ],
)
def test_no_target_is_followed_in_a_state_without_plans(bench: Bench, state: State, reason: str) -> None:
    bench.mailbox.send(WAVE)
    bench.look(100, state=state)
    assert bench.states == [(1, "refused")] and reason in str(bench.told[0].reason)


@pytest.mark.parametrize("state", [State.PARK, State.HOLD])
def test_a_refusal_after_a_fault_says_that_it_has_to_be_cleared(bench: Bench, state: State) -> None:
    """While the robot parked after an emergency stop it read "arm it after that", which was refused too."""
    bench.mailbox.send(WAVE)
    bench.look(100, state=state, must_stop=True, faulted=True)
    told = str(bench.told[0].reason)
    assert "a fault is latched" in told and "clear the fault" in told and "release the stop" not in told
    bench.mailbox.send(WAVE)
    bench.look(101, state=State.HOLD, must_stop=True, faulted=False)
    assert "flexmotion clear" in str(bench.told[-1].reason) and "fault" not in str(bench.told[-1].reason)


def test_targets_of_two_processes_have_ids_that_ascend_and_differ() -> None:
    """Each sender counted for itself: a target with a smaller id than one before it was never followed."""
    mailbox = TargetMailbox()
    other = mailbox.sender()
    reader = mailbox.reader()
    sent = [mailbox.send(WALK), other.send(WAVE), other.send(WALK), mailbox.send(WAVE), other.send(WALK)]
    ids = [target.id for target in sent]
    assert ids == sorted(set(ids))
    assert reader.read() == sent and mailbox.newest() == sent[-1]


def test_a_turn_that_is_given_up_leaves_the_target_before_it_as_it_was() -> None:
    """That one was answered "superseded", was played all the same, and was no longer what plans should follow."""
    bench = Bench()
    first = bench.mailbox.send(WALK)
    bench.look(100)
    bench.ledger.turned(first, None)
    bench.ledger.replaces(first)
    bench.look(101)
    bench.ledger.turned(first, None)  # no plan of it was taken, it is made once more
    second = bench.mailbox.send(WAVE)
    bench.look(102)
    bench.ledger.turned(second, None)
    assert bench.told == []
    third = bench.mailbox.send(Text("bow"))
    bench.ledger.take()
    assert bench.ledger.replaces(second)
    bench.ledger.give_way()
    assert bench.states == [(second.id, "superseded")] and bench.ledger.wanted == third
    bench.ledger.refuse(third, "cannot")
    assert bench.ledger.wanted == first
    bench.taken = first.id
    bench.look(103)
    assert bench.states[1:] == [(third.id, "refused"), (first.id, "accepted")]


@pytest.mark.parametrize(("taken", "answer"), [(1, "accepted"), (0, "superseded"), (2, "superseded")])
def test_a_target_that_another_displaces_is_answered_with_what_became_of_its_plan(taken: int, answer: str) -> None:
    bench = Bench()
    first = bench.mailbox.send(WALK)
    bench.look(100)
    bench.ledger.turned(first, None)
    second = bench.mailbox.send(WAVE)
    bench.look(101)
    bench.ledger.turned(second, None)
    bench.taken = taken
    bench.look(102)
    assert bench.states[0] == (first.id, answer)
    bench.taken = second.id
    bench.look(103)
    assert bench.states[-1] == (second.id, "accepted") and len(bench.told) == 2


def test_a_planner_that_succeeds_another_refuses_what_that_one_left_open_whatever_came_after_it(bench: Bench) -> None:
    """Answers to hands overtake that of the body: an open walk of a smaller number was never answered."""
    walk, hand, late = bench.mailbox.send(WALK), bench.mailbox.send(WAVE), bench.mailbox.send(WAVE)
    channel = HeardChannel()
    channel.publish(Heard(id=hand.id, asked="left hand", state="accepted"))
    bench.ledger.drop_old(channel.answered(), "send it again")
    assert bench.states == [(walk.id, "refused"), (late.id, "refused")]


def test_answers_that_are_no_longer_kept_count_as_given() -> None:
    channel = HeardChannel()
    for number in range(1, 201):
        channel.publish(Heard(id=number, asked="wave", state="accepted"))
    assert all(number in channel.answered() for number in range(1, 201)) and 201 not in channel.answered()


@pytest.mark.parametrize("begun", [False, True])
def test_a_target_whose_plan_a_stop_dropped_before_it_began_is_refused(bench: Bench, begun: bool) -> None:
    """Went wrong: "accepted, followed from tick 755" stayed the answer to a velocity that was never followed."""
    target = bench.mailbox.send(WALK)
    bench.look(10)
    bench.ledger.turned(target, None)
    bench.taken = target.id  # a plan for it waits
    bench.look(11, target=target.id if begun else 0)
    for tick in (12, 13):
        bench.look(tick, must_stop=True)
    assert [state for _, state in bench.states] == ["accepted", *([] if begun else ["refused"])]
    assert begun or "release the stop" in str(bench.told[-1].reason)


def test_getting_up_first_keeps_what_the_run_was_started_with(bench: Bench) -> None:
    """A get-up from OFF halted: a run that was started with words, lying, got up and then stood for ever."""
    bench.look(10, state=State.OFF)
    bench.look(11, state=State.GET_UP)
    bench.look(12, state=State.READY)
    assert not bench.ledger.halted
    bench.look(13, state=State.DAMPED)
    bench.look(14, state=State.FAULT)
    bench.look(15, state=State.GET_UP)
    bench.look(16, state=State.READY)
    assert bench.ledger.halted, "after a fall nothing goes on by itself"


def test_a_target_that_comes_while_the_robot_gets_up_is_refused_by_name(bench: Bench) -> None:
    bench.mailbox.send(WAVE)
    bench.look(10, state=State.GET_UP)
    assert bench.states == [(1, "refused")] and "wait until it stands" in str(bench.told[0].reason)


@pytest.mark.parametrize("holds_s, ends_s", [(float("inf"), 3.0), (0.5, 2.5)])
def test_a_change_of_speed_ends_with_what_it_changes(bench: Bench, holds_s: float, ends_s: float) -> None:
    """Regression: a stick's velocity held for .5 s; "slower" made it a walk without an end."""
    bench.mailbox.send(WALK, holds_s=3.0)
    bench.look(0)
    bench.follow(0)
    bench.mailbox.send(Text("slower"), holds_s=holds_s)
    bench.look(200)
    target = bench.ledger.wanted
    bench.ledger.turned(target, Heard(asked="slower", state="accepted", heard_as="walk"), goes_on=True)
    bench.taken = target.id
    bench.look(201)
    assert bench.told[-1].state == "accepted" and bench.told[-1].left_s == pytest.approx(1.0, abs=0.02)
    bench.look(round(ends_s * RATE) - 2)
    assert not bench.ledger.halted
    bench.look(round(ends_s * RATE) + 2)
    assert bench.ledger.halted


def test_a_change_of_speed_of_what_has_no_end_has_none(bench: Bench) -> None:
    bench.mailbox.send(WALK)
    bench.look(0)
    bench.follow(0)
    bench.mailbox.send(Text("slower"))
    bench.look(200)
    bench.ledger.turned(bench.ledger.wanted, Heard(asked="slower", state="accepted"), goes_on=True)
    bench.taken = 2
    bench.look(100_000)
    assert bench.told[-1].left_s is None and not bench.ledger.halted


@pytest.mark.parametrize("rest", [Stop(), Velocity(0.0, 0.0, 0.0), Text("stop")])
def test_a_stand_that_is_asked_for_again_waits_for_the_plan_of_the_first(bench: Bench, rest: Intent) -> None:
    """Went wrong: where the source knows no stand, each that was sent made a new stop plan, and put it off."""
    first = bench.mailbox.send(rest)
    bench.look(10)
    bench.ledger.turned(first, None, rests=("send mirror",))
    bench.ledger.halted = "stopped"
    again = bench.mailbox.send(rest)
    bench.look(11, plan=1)
    assert bench.ledger.wanted == first and not bench.ledger.has_target and not bench.ledger.replaces(first)
    bench.taken = first.id
    bench.look(12, plan=1)
    assert bench.states == [(first.id, "accepted"), (again.id, "accepted")]
    assert (bench.told[1].reason, bench.told[1].notes) == ("goes on as before", ("send mirror",))
    assert bench.ledger.wanted == NO_TARGET
    walk = bench.mailbox.send(WALK)
    bench.look(13, plan=1)
    assert bench.ledger.wanted == walk
