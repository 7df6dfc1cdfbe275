"""Answers to targets beside the one for the whole body."""

from __future__ import annotations

from contextlib import suppress
from typing import TypedDict

import pytest

from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import Heard, Over, State
from flexmotion.streamer.motion.part_intents import Relax
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.planning.answers import Answers

RATE = 100.0


class Ending(TypedDict):
    over: Over
    state: State
    reason: str


class Told:
    """Answers with what they have published and noted."""

    def __init__(self) -> None:
        self.heard: list[Heard] = []
        self.notes: list[str] = []
        self.answers = Answers(RATE, self.heard.append, self.notes.append)

    @property
    def states(self) -> list[tuple[int, str, str | None]]:
        return [(heard.id, heard.state, heard.over) for heard in self.heard]


def plays(plan: int, pending: int = 0) -> TickRow:
    row = Telemetry(1, RATE).row
    row.plan[...], row.pending[...] = plan, pending
    return row


def let_go(number: int) -> Target:
    return Target(number, 0, Relax("left hand"), take_up_s=1.0)


def following(number: int, state: str = "accepted", **known: object) -> Heard:
    return Heard.model_validate({"id": number, "asked": "left hand", "state": state, "tick": 250, **known})


@pytest.fixture
def told() -> Told:
    return Told()


def test_what_is_let_go_is_answered_by_the_plan_that_knows_of_it_and_by_no_earlier_one(told: Told) -> None:
    told.answers.revisions.made(plan=3, playing=3, tick=0)
    told.answers.revisions.change()
    told.answers.relaxed(let_go(7))
    assert told.answers.taken(plays(3)) == 0
    assert not told.heard and told.answers.waits
    told.answers.revisions.made(plan=4, playing=3, tick=10)
    # The loop has accepted the plan, which plays soon.
    assert told.answers.taken(plays(3, pending=4)) == 1
    assert told.states == [(7, "accepted", None)] and told.heard[0].heard_as == "relax"
    told.answers.taken(plays(4))
    assert len(told.heard) == 1 and not told.answers.waits


def test_what_is_let_go_when_nothing_holds_any_more_waits_for_no_plan(told: Told) -> None:
    told.answers.revisions.change()
    told.answers.relaxed(let_go(7))
    told.answers.nothing_holds()
    assert told.states == [(7, "accepted", None)] and not told.answers.waits


def test_an_answer_says_when_its_plan_begins_and_the_operator_hears_of_what_is_not_as_asked(told: Told) -> None:
    heard = told.answers.followed(following(1))
    assert heard.at_s == pytest.approx(2.5) and not told.heard
    told.answers.tell(heard)
    assert told.heard == [heard] and not told.notes
    told.answers.tell(told.answers.followed(following(2, "slowed", slowed="0.90 s until it is there")))
    assert len(told.notes) == 1 and "0.90 s" in told.notes[0]


def test_who_was_answered_hears_how_it_ended_and_who_was_not_hears_why(told: Told) -> None:
    ending = Ending(over="superseded", state="refused", reason="the robot is to walk")
    told.answers.ended(following(1), answered=True, **ending)
    told.answers.ended(following(2), answered=False, **ending)
    assert told.states == [(1, "accepted", "superseded"), (2, "refused", None)]
    assert told.heard[0].tick == 250 and told.heard[0].reason is None
    assert told.heard[1].tick is None and told.heard[1].reason == "the robot is to walk"


def test_a_target_that_comes_too_late_is_told_so_and_only_then(told: Told) -> None:
    target = let_go(5)
    assert not told.answers.expired(target, target.take_up_s) and not told.heard
    assert told.answers.expired(target, target.take_up_s + 0.01)
    assert told.states == [(5, "expired", None)] and len(told.notes) == 1


def test_what_cannot_be_told_is_not_told_again() -> None:
    """An answer was published before it was marked as given: each row of the loop would have given it once more."""

    def fails(heard: Heard) -> None:
        told.append(heard.id)
        raise BrokenPipeError

    told: list[int] = []
    answers = Answers(RATE, fails, lambda _note: None)
    answers.relaxed(let_go(7))
    for _ in range(3):
        with suppress(BrokenPipeError):
            answers.nothing_holds()
    assert told == [7]
