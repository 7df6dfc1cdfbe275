"""Messages become targets and requests, and each gets one answer."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway import desk as desk_module
from flexmotion.streamer.gateway.messages import Ended
from flexmotion.streamer.gateway.send_rates import MOST_WAITING
from flexmotion.streamer.gateway.status import status_of
from flexmotion.streamer.motion.heard import Heard, HeardStep
from flexmotion.streamer.motion.intents import Heading, Stop, Text, Velocity, Waypoint
from flexmotion.streamer.run.requests import Request

WAVE = '{"type":"text","text":"wave","id":"w"}'
WALK = '{"type":"velocity","velocity":[0.3,0,0]}'

Make = Callable[..., Any]


class Clock:
    """Time that passes only when the test says so."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        patch.setattr(desk_module.time, "perf_counter", lambda: self.now)
        patch.setattr(desk_module.time, "time", lambda: 1.7e9 + self.now)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def test_a_target_reaches_the_planner_at_once_and_its_answer_the_sender(make_office: Make) -> None:
    office = make_office()
    office.ask(WAVE)
    (target,) = office.run.arrived()
    assert target.intent == Text("wave") and office.told == []
    office.run.answer(target.id, heard="wave-right-hand")
    office.desk.pump()
    (answer,) = office.told
    assert (answer.id, answer.state, answer.heard_as, answer.target) == ("w", "accepted", "wave-right-hand", target.id)
    assert office.desk.following is not None and office.desk.following.asked == {"text": "wave"}


def test_an_answer_names_the_manner_that_was_heard(make_office: Make) -> None:
    """The answer to "walk like an old man" was "heard as walk"; only standard error said "old"."""
    office = make_office()
    office.ask(WAVE)
    office.run.answer(office.run.arrived()[-1].id, heard="walk", manner="old")
    office.desk.pump()
    assert (office.told[-1].heard_as, office.told[-1].manner) == ("walk", "old")


def told_ends(office: Any, text: str) -> tuple[int, list[Ended]]:
    """Ask for a target that is accepted; its number, and the list into which its end comes."""
    ends: list[Ended] = []
    office.desk.receive(text.encode(), office.told.append, "a", ends.append)
    number = office.run.arrived()[-1].id
    office.run.answer(number, heard="walk")
    office.desk.pump()
    return number, ends


def stand(office: Any, clock: Clock, seconds: float) -> None:
    """The robot stands in HOLD for so long."""
    office.run.state = State.HOLD
    for _ in range(round(seconds / 0.5)):
        clock.now += 0.5
        office.run.step()
        office.desk.pump()


@pytest.mark.parametrize("how", ["done", "time limit", "expired"])
def test_the_end_of_a_target_is_told_once_to_who_asked_for_it(make_office: Make, how: Any) -> None:
    """A program learnt from the status alone that a target had ended, and not whether it was its own."""
    office = make_office()
    number, ends = told_ends(office, WAVE)
    step = HeardStep(text="walk", amount=2.0, unit="length")
    for last in (step, step.model_copy(update={"end": how, "measured": 1.98}), step):
        office.run.heard.publish(Heard(id=number, asked="?", state="accepted", steps=(last,)))
        office.desk.pump()
        assert bool(ends) == (last is not step) or len(ends) == 1
    (ended,) = ends
    assert (ended.id, ended.target, ended.end, ended.done) == ("w", number, how, "1.98 m of 2 m")
    assert told_ends(office, WALK)[1] == [] and ends == [ended], "a newer target does not end it again"


def test_a_target_ends_by_the_next_one_by_its_time_and_by_a_stop(make_office: Make, clock: Clock) -> None:
    office = make_office()
    _, first = told_ends(office, WAVE)
    _, second = told_ends(office, WALK)
    assert [ended.end for ended in first] == ["superseded"]
    clock.now += 0.6
    office.desk.pump()
    assert [ended.end for ended in second] == ["expired"]
    _, third = told_ends(office, WAVE)
    assert third == []
    office.run.stopped = True
    office.run.step()
    office.desk.pump()
    office.desk.pump()
    assert [ended.end for ended in third] == ["stopped"] and len(second) == 1


@pytest.mark.parametrize(
    ("message", "end"),
    [(WAVE, "stopped"), ('{"type":"clip","clip":"bow"}', "done"), ('{"type":"hold"}', "done")],
)
def test_a_robot_that_stands_follows_nothing_any_more(make_office: Make, message: str, end: str) -> None:
    """Who waited for a clip, or for a target that a restarted planner had lost, waited for ever."""
    office = make_office()
    _, ends = told_ends(office, message)
    office.run.state = State.HOLD
    office.desk.pump()
    assert ends == [], "the row of the moment in which it was accepted may be of before"
    for _ in range(3):
        office.run.step()
        office.desk.pump()
    assert [ended.end for ended in ends] == [end]


def test_a_clip_that_is_cut_off_is_stopped_and_not_done(make_office: Make, clock: Clock) -> None:
    """Went wrong: of a clip whose robot came to rest a second after its begin, "done" was told."""
    office = make_office()
    number, ends = told_ends(office, '{"type":"clip","clip":"bow"}')
    step = HeardStep(text="bow", amount=4.5, unit="time", limit_s=6.5)
    office.run.heard.publish(Heard(id=number, asked="bow", state="accepted", heard_as="clip", steps=(step,)))
    office.desk.pump()
    stand(office, clock, 30.0)
    assert [ended.end for ended in ends] == ["stopped"]


def test_what_is_measured_a_moment_after_the_stand_is_done_and_not_stopped(make_office: Make, clock: Clock) -> None:
    """One "bow once" ended as "stopped": the robot stood, and its bow was counted a sixth of a second later."""
    office = make_office()
    ends: list[Ended] = []
    steps = (
        HeardStep(text="wait two seconds", amount=2.0, unit="time", limit_s=4.0),
        HeardStep(text="bow", amount=1.0, unit="times", limit_s=20.0),
    )
    office.desk.receive(WAVE.encode(), office.told.append, "a", ends.append)
    number = office.run.arrived()[-1].id
    office.run.answer(number, heard="bow", steps=steps)
    office.desk.pump()
    office.run.state = State.HOLD
    for _ in range(6):
        clock.now += 0.5
        office.run.step()
        office.desk.pump()
    assert ends == [], "it waits for two seconds, as asked"
    done = [step.model_copy(update={"end": "done", "measured": step.amount}) for step in steps]
    office.run.answer(number, heard="bow", steps=(done[0], steps[1]))
    office.desk.pump()
    office.run.answer(number, heard="bow", steps=tuple(done))
    office.desk.pump()
    told = [(ended.end, ended.done) for ended in ends]
    assert told == [("done", "wait two seconds: 2 s of 2 s; bow: 1 time of 1 time")]


@pytest.mark.parametrize("late", ["step back", "bow"])
def test_the_end_of_a_sequence_names_the_step_that_was_not_done_and_its_limit(make_office: Make, late: str) -> None:
    """The end said "not done within its time limit", of two steps that both had a count, and not which limit.

    Where only an earlier step was not done, the end was "done".
    """
    office, ends = make_office(), list[Ended]()
    steps = [
        HeardStep(text="step back", amount=1.0, unit="steps", limit_s=10.0, end="done", measured=1.0),
        HeardStep(text="bow", amount=1.0, unit="times", limit_s=11.5, end="done", measured=1.0),
    ]
    missed = {"end": "time limit", "measured": 0.0}
    steps = [step.model_copy(update=missed) if step.text == late else step for step in steps]
    office.desk.receive(WAVE.encode(), office.told.append, "a", ends.append)
    number = office.run.arrived()[-1].id
    for _ in range(2):
        office.run.answer(number, heard="bow", steps=tuple(steps))
        office.desk.pump()
    told = {
        "step back": "step back: 0 steps of 1 step (time limit of 10 s); bow: 1 time of 1 time",
        "bow": "step back: 1 step of 1 step, then feet together; bow: 0 times of 1 time (time limit of 11.5 s)",
    }
    assert [(one.end, one.done) for one in ends] == [("time limit", told[late])]


@pytest.mark.parametrize("kind", ["heading", "waypoint"])
def test_a_goal_ends_as_it_was_measured_and_not_in_the_first_stand_on_its_way(
    make_office: Make, clock: Clock, kind: str
) -> None:
    """Two of five headings ended as "stopped", and the log said "done".

    Each move to a goal ends in a stand, which is measured up to four seconds later; the first stand counted as the end.
    """
    office, ends = make_office(), list[Ended]()
    step = HeardStep(text=kind, heard_as=kind)
    field = '"heading_rad":1.57' if kind == "heading" else '"position_m":[1,0]'
    office.desk.receive(f'{{"type":"{kind}",{field}}}'.encode(), office.told.append, "a", ends.append)
    number = office.run.arrived()[-1].id
    office.run.answer(number, heard=kind, steps=(step,))
    office.desk.pump()
    for state in (State.STREAMING, State.HOLD, State.STREAMING, State.HOLD):  # a turn, a stand, what is missing
        office.run.state = state
        for _ in range(8):
            clock.now += 0.5
            office.run.step()
            office.desk.pump()
    assert ends == [] and office.desk.following is not None and office.desk.following.end is None
    there = step.model_copy(update={"end": "done", "place": (0.0, 0.0, 1.57)})
    office.run.answer(number, heard=kind, steps=(there,))
    office.desk.pump()
    assert [(one.end, one.done) for one in ends] == [("done", "stands at 0.00 m ahead, 0.00 m left, heading 90°")]
    followed = status_of(office.desk, "op3", "sim", 125.0, None).following
    assert followed is not None and followed.end == "done"


def test_a_measured_target_whose_planner_has_died_has_ended_too(make_office: Make, clock: Clock) -> None:
    office = make_office()
    ends: list[Ended] = []
    office.desk.receive(WAVE.encode(), office.told.append, "a", ends.append)
    number = office.run.arrived()[-1].id
    office.run.answer(number, heard="bow", steps=(HeardStep(text="bow", amount=1.0, unit="times", limit_s=20.0),))
    office.desk.pump()
    stand(office, clock, 6.0)
    assert [ended.end for ended in ends] == ["stopped"]


def test_words_that_are_heard_as_standing_end_in_a_stand(make_office: Make) -> None:
    """`send "hold"` ended as "stopped", as if the robot had not been asked for its stand."""
    office = make_office()
    ends: list[Ended] = []
    office.desk.receive(WAVE.encode(), office.told.append, "a", ends.append)
    office.run.answer(office.run.arrived()[-1].id, heard="stand")
    office.desk.pump()
    office.run.state = State.HOLD
    for _ in range(3):
        office.run.step()
        office.desk.pump()
    assert [ended.end for ended in ends] == ["done"]


def test_the_end_of_a_heading_that_was_given_up_says_why(make_office: Make) -> None:
    """Its step had ended too, with nothing measured, and the end said "stopped" alone."""
    office = make_office()
    number, ends = told_ends(office, '{"type":"heading","heading_rad":1.5}')
    step = HeardStep(text="heading", heard_as="heading", end="stopped")
    reason = "l_knee needs 2.05 N·m, its cap is 1.5 N·m"
    office.run.heard.publish(Heard(id=number, asked="heading", state="refused", reason=reason, steps=(step,)))
    office.desk.pump()
    assert [(ended.end, ended.done) for ended in ends] == [("stopped", reason)]


def test_a_clip_whose_steps_were_left_out_later_ended_as_done_whole(make_office: Make) -> None:
    """A foot was kept down while it walked, and its end was "done: 6.47 s of 6.47 s"."""
    office = make_office()
    number, ends = told_ends(office, '{"type":"clip","clip":"walk"}')
    step = HeardStep(text="walk", amount=6.47, unit="time", end="done", measured=6.47)
    for steps in ((step.model_copy(update={"end": None}),), (step,)):
        partly = Heard(id=number, asked="walk", state="partly", dropped=("steps",), steps=steps)
        office.run.heard.publish(partly)
    office.desk.pump()
    assert [(one.end, one.done) for one in ends] == [("done", "6.47 s of 6.47 s, without steps")]


def test_what_the_answer_named_as_left_out_is_not_told_again_at_the_end(make_office: Make) -> None:
    office = make_office()
    ends: list[Ended] = []
    office.desk.receive(WAVE.encode(), office.told.append, "a", ends.append)
    partly = Heard(id=office.run.arrived()[-1].id, asked="wave", state="partly", tick=5, dropped=("right hand",))
    step = HeardStep(text="wave", amount=2.0, unit="times", end="time limit", measured=0.0)
    for steps in ((), (step,)):
        office.run.heard.publish(partly.model_copy(update={"steps": steps}))
        office.desk.pump()
    assert [(one.end, one.done) for one in ends] == [("time limit", "0 times of 2 times")]


@pytest.mark.parametrize("message", ["clear", "arm"])
def test_a_target_right_behind_a_clear_was_refused_for_the_stop_before_it(make_office: Make, message: str) -> None:
    """It overtook the `clear` of its own connection: "release the stop first", then `clear` was accepted."""
    office = make_office()
    office.run.stopped = True
    office.run.step()
    office.ask(json.dumps({"type": message}), "a")
    office.ask(WAVE, "a")
    office.desk.pump()
    assert office.run.arrived() == [] and office.told == [] and office.desk.busy
    office.ask(WALK, "b")
    assert len(office.run.arrived()) == 1, "another connection does not wait"
    office.run.stopped = False
    office.run.take(Request[message.upper()])
    office.desk.pump()
    assert office.states == ["accepted"]
    assert [target.intent for target in office.run.arrived()] == [Text("wave")]


def test_a_target_behind_a_clear_waits_for_a_second_and_its_time_goes_on(make_office: Make, clock: Clock) -> None:
    office = make_office()
    for message in ('{"type":"clear"}', WALK, WAVE, '{"type":"velocity","velocity":[0.3,0,0],"ttl_s":1.5}'):
        office.ask(message, "a")
    clock.now += 1.1
    office.desk.pump()
    assert [(one.asked, one.state) for one in office.told[:2]] == [("clear", "refused"), ("velocity", "expired")]
    wave, walk = office.run.arrived()
    assert (wave.intent, walk.holds_s) == (Text("wave"), pytest.approx(0.4))


def test_no_more_targets_wait_for_a_clear_than_for_the_planner(make_office: Make) -> None:
    """A flood behind a `clear` was kept without a bound."""
    office = make_office()
    office.ask('{"type":"clear"}', "a")
    for _ in range(MOST_WAITING + 3):
        office.ask(WAVE, "a")
    assert [one.state for one in office.told] == ["refused"] * 3
    assert office.told[0].reason == f"{MOST_WAITING} targets wait for the request before them already"


@pytest.mark.parametrize("stop", ["stop", "estop", "disarm"])
def test_no_target_that_waits_for_a_clear_is_done_after_a_stop(make_office: Make, stop: str) -> None:
    office = make_office()
    office.ask('{"type":"clear"}', "a")
    office.ask(WAVE, "a")
    office.ask(json.dumps({"type": stop, "source": "phone"}), "b")
    (refused,) = office.told
    assert (refused.state, refused.reason) == ("refused", f"{stop} from phone came before it was sent")
    office.run.take(Request.CLEAR)
    office.desk.pump()
    assert office.run.arrived() == []


def test_a_walk_that_a_kept_foot_ends_was_followed_until_the_robot_stood(make_office: Make) -> None:
    office = make_office()
    number, ends = told_ends(office, WALK)
    kept = Heard(id=number, asked="walk", state="accepted", over="stopped", reason="left foot kept down")
    office.run.heard.publish(kept)
    office.desk.pump()
    assert [(one.end, one.done) for one in ends] == [("stopped", "left foot kept down")]
    assert office.desk.following is not None and office.desk.following.end == "stopped"


def test_a_target_that_is_given_up_later_has_ended(make_office: Make) -> None:
    """A walk beyond the servos' envelope was answered "refused" by a later version, and its sender was told nothing."""
    office = make_office()
    number, ends = told_ends(office, WAVE)
    office.run.heard.publish(Heard(id=number, asked="?", state="refused", reason="beyond the envelope"))
    office.desk.pump()
    # Why was in the log alone: a heading under a torque cap ended as a bare "stopped".
    assert [(ended.end, ended.done) for ended in ends] == [("stopped", "beyond the envelope")]


def test_a_target_that_is_not_followed_and_one_that_lets_something_go_have_no_end(
    make_office: Make, clock: Clock
) -> None:
    office, ends = make_office(), []
    for message in (WAVE, '{"type":"relax","part":"head"}'):
        clock.now += 0.1
        office.desk.receive(message.encode(), office.told.append, "a", ends.append)
    words, look = office.run.arrived()
    office.run.answer(words.id, "refused", "not understood")
    office.run.answer(look.id)
    office.desk.pump()
    clock.now += 60.0
    office.desk.pump()
    assert ends == [] and [answer.part for answer in office.told] == [None, "relax head"]


def held(office: Any, message: str, heard: str, kind: str = "part") -> tuple[int, list[Ended]]:
    """Ask for something that holds beside the whole body, and is accepted; see `told_ends`."""
    ends: list[Ended] = []
    office.desk.receive(message.encode(), office.told.append, "a", ends.append)
    number = office.run.arrived()[-1].id
    later(office, number, heard, kind)
    return number, ends


def later(office: Any, number: int, heard: str, kind: str = "part", **known: Any) -> None:
    """The planner answers, or tells a later version."""
    office.run.answer(number, heard=heard, holds=kind, **known)
    office.desk.pump()


def holding(office: Any) -> list[tuple[str, bool, str | None]]:
    """What holds by the status: part, whether it is a restriction, how far a part is from there."""
    told = status_of(office.desk, "op3", "sim", 125.0, None).holding
    return [(", ".join(one.parts), one.restricts, one.there) for one in told]


def test_the_status_says_what_holds_and_what_could_be_let_go(make_office: Make, clock: Clock) -> None:
    """A walk was refused for a foot that was kept down, and nothing said so; nor what `relax` would let go."""
    office = make_office()
    hand, hand_ends = held(office, HAND % ("left", "h"), "left hand")
    foot, foot_ends = held(office, '{"type":"contact","foot":"both"}', "both feet", "restriction")
    assert holding(office) == [("left hand", False, None), ("both feet", True, None)]
    later(office, hand, "left hand", there="0.3 cm from there")
    later(office, foot, "right foot", "restriction")
    assert holding(office) == [("left hand", False, "0.3 cm from there"), ("right foot", True, None)]
    assert [(ended.id, ended.end, ended.done) for ended in hand_ends] == [("h", "done", "0.3 cm from there")]
    later(office, hand, "left hand", there="0.3 cm from there", over="let go")
    assert holding(office) == [("right foot", True, None)] and len(hand_ends) == 1
    later(office, foot, "right foot", "restriction", over="expired")
    assert holding(office) == [] and [ended.end for ended in foot_ends] == ["expired"]


def test_a_part_that_is_held_away_has_missed_its_place(make_office: Make) -> None:
    """A blocked arm was told as done, 25 cm from where it should be."""
    office = make_office()
    number, ends = held(office, HAND % ("left", "h"), "left hand")
    later(office, number, "left hand", missed="25.0 cm from there")
    assert [(ended.end, ended.done) for ended in ends] == [("time limit", "25.0 cm from there")]
    assert holding(office) == [("left hand", False, None)], "it goes on trying"


def test_a_target_that_was_refused_after_its_plan_was_made_holds_nothing(make_office: Make) -> None:
    """A hand that a STOP refused stayed in the status as on its way."""
    office = make_office()
    ends: list[Ended] = []
    office.desk.receive((HAND % ("left", "h")).encode(), office.told.append, "a", ends.append)
    number = office.run.arrived()[-1].id
    refused = {"state": "refused", "reason": "stopped", "heard_as": "left hand", "holds": "part"}
    office.run.heard.publish(Heard.model_validate({"id": number, "asked": "?", "tick": 7, **refused}))
    office.desk.pump()
    assert holding(office) == [] and office.states == ["refused"]


@pytest.mark.parametrize(
    ("over", "end"),
    [("expired", "time limit"), ("let go", "superseded"), ("superseded", "superseded"), ("stopped", "stopped")],
)
def test_a_part_that_never_gets_there_has_another_end(make_office: Make, over: str, end: str) -> None:
    office = make_office()
    number, ends = held(office, HAND % ("left", "h"), "left hand")
    later(office, number, "left hand", over=over)
    assert [(ended.end, ended.done) for ended in ends] == [(end, None)] and holding(office) == []


def test_a_stop_ends_the_wait_for_a_part_and_not_that_for_a_restriction(make_office: Make) -> None:
    """A head that was stopped on its way stays there, and was told as done."""
    office = make_office()
    head, head_ends = held(office, '{"type":"head","position_m":[0,0,0.4]}', "head place")
    _, foot_ends = held(office, '{"type":"contact","foot":"left"}', "left foot", "restriction")
    office.run.stopped = True
    office.run.step()
    office.desk.pump()
    later(office, head, "head place", missed="stopped on its way")
    assert [(ended.end, ended.done) for ended in head_ends] == [("stopped", None)] and foot_ends == []
    assert [part for part, _, _ in holding(office)] == ["head place", "left foot"]


def test_nothing_holds_without_torque_whatever_a_planner_tells(make_office: Make) -> None:
    """A planner that has died tells nothing."""
    office = make_office()
    _, ends = held(office, '{"type":"torque","joint":"l_el","limit_nm":1}', "torque l_el", "restriction")
    office.run.state = State.PARK
    office.run.step()
    office.desk.pump()
    assert holding(office) == [] and [ended.end for ended in ends] == ["stopped"]


def test_what_a_script_asked_for_is_shown_and_a_gateway_that_begins_later_knows_it(make_office: Make) -> None:
    """A foot that was kept down was forgotten after 128 other answers, those of half a minute of a stick."""
    office = make_office()
    later(office, 7, "head")
    (one,) = status_of(office.desk, "op3", "sim", 125.0, None).holding
    assert (one.target, one.source, one.parts) == (7, None, ("head",))
    for number in range(8, 200):
        office.run.answer(number, heard="walk")
    anew = make_office()
    anew.desk.pump()
    assert holding(anew) == holding(office) == [("head", False, None)]


def test_a_velocity_holds_for_half_a_second_and_words_until_the_next_target(make_office: Make) -> None:
    office = make_office()
    office.ask(WALK)
    office.ask('{"type":"velocity","velocity":[0.3,0,0],"ttl_s":2.0}')
    office.ask(WAVE)
    assert [target.holds_s for target in office.run.arrived()] == [0.5, 2.0, float("inf")]


def test_a_burst_is_reduced_to_its_newest_and_every_message_is_answered(make_office: Make, clock: Clock) -> None:
    """10,000 targets in one second; the mailbox keeps 64, and a planner looks every few milliseconds."""
    office = make_office(coalesce_s=0.005)
    seen = []
    for number in range(10_000):
        clock.now += 1e-4
        office.ask(f'{{"type":"velocity","velocity":[{number % 30 / 100 + 0.01},0,0],"id":"{number}"}}')
        if number % 20 == 0:
            office.desk.pump()
        if number % 400 == 0:
            seen += office.run.arrived()
            office.run.answer(seen[-1].id)
    clock.now += 0.01
    office.desk.pump()
    seen += office.run.arrived()
    office.run.answer(seen[-1].id)
    office.desk.pump()
    assert Counter(answer.id for answer in office.told) == Counter(str(number) for number in range(10_000))
    assert set(office.states) == {"accepted", "superseded"}
    assert 25 <= office.states.count("accepted") <= 26
    assert len(seen) <= 205 and seen[-1].intent == Velocity(9999 % 30 / 100 + 0.01, 0.0, 0.0)
    assert not office.desk.busy


def test_two_targets_at_once_are_sent_at_once(make_office: Make, clock: Clock) -> None:
    """The second waited for 5 ms, in which the planner, of a higher priority, had begun a plan for the first."""
    office = make_office(coalesce_s=0.005)
    for message in (WAVE, WALK, WAVE):
        office.ask(message)
    assert len(office.run.arrived()) == 2
    clock.now += 0.009
    office.desk.pump()
    assert not office.run.arrived(), "one in 5 ms all the same"
    clock.now += 0.002
    office.desk.pump()
    assert len(office.run.arrived()) == 1


def test_targets_that_the_planner_never_saw_are_superseded(make_office: Make) -> None:
    office = make_office()
    for _ in range(100):  # the ring keeps 64
        office.ask(WALK)
    newest = office.run.arrived()[-1]
    office.run.answer(newest.id)
    office.desk.pump()
    assert office.states == ["superseded"] * 99 + ["accepted"]


def test_a_planner_that_does_not_answer_is_answered_for(make_office: Make, clock: Clock) -> None:
    office = make_office(take_up_s=5.0)
    office.ask(WAVE)
    office.ask(WALK)
    clock.now += 1.6
    office.desk.pump()
    assert office.states == ["expired"] and office.told[0].asked == "velocity"
    clock.now += 4.5
    office.desk.pump()
    assert office.states == ["expired", "expired"] and office.told[1].reason == "the planner has not answered"


def test_a_message_that_was_sent_too_long_ago_has_expired(make_office: Make, clock: Clock) -> None:
    office = make_office()
    now = 1.7e9 + clock.now
    office.ask(f'{{"type":"velocity","velocity":[0.3,0,0],"stamp_s":{now - 0.6}}}')
    office.ask(f'{{"type":"velocity","velocity":[0.3,0,0],"stamp_s":{now + 5.0}}}')
    assert office.states == ["expired", "refused"]
    assert office.told[0].reason == "sent 0.6 s ago, it holds 0.5 s"
    assert office.told[1].reason == "stamp_s: 5.0 s in the future by this machine's clock"
    assert office.run.arrived() == []


@pytest.mark.parametrize("message", ['"type":"text","text":"wave"', '"type":"arm"', '"type":"clear"'])
def test_what_holds_without_end_expires_all_the_same_where_it_comes_long_after_it_was_sent(
    make_office: Make, clock: Clock, message: str
) -> None:
    """Words with a stamp of 1970 were accepted and done, while a stamp in the future was refused."""
    office, now = make_office(take_up_s=2.0), 1.7e9 + clock.now
    reader = office.requests.reader()
    for stamp_s in (1.0, now - 2.1):
        office.ask(f'{{{message},"stamp_s":{stamp_s}}}')
    assert office.states == ["expired"] * 2 and office.run.arrived() == [] and not list(reader.read())
    assert office.told[1].reason == "sent 2.1 s ago, without ttl_s it is taken up within 2 s"
    office.ask(f'{{{message},"stamp_s":{now - 1.9}}}')
    assert len(office.run.arrived()) + len(list(reader.read())) == 1


def test_a_robot_is_disarmed_however_late_that_comes(make_office: Make, clock: Clock) -> None:
    office = make_office()
    reader = office.requests.reader()
    office.ask('{"type":"disarm","stamp_s":1.0}')
    assert [request for request, _ in reader.read()] == [Request.DISARM]


def test_words_may_come_as_late_as_their_own_time_to_live_says(make_office: Make, clock: Clock) -> None:
    office = make_office(take_up_s=2.0)
    office.ask(f'{{"type":"text","text":"wave","ttl_s":60,"stamp_s":{1.7e9 + clock.now - 30.0}}}')
    assert len(office.run.arrived()) == 1


def test_a_stop_is_taken_whatever_the_clocks_say(make_office: Make, clock: Clock) -> None:
    """A clock that was set by an hour must not refuse a stop."""
    office = make_office()
    reader = office.requests.reader()
    office.ask(f'{{"type":"estop","ttl_s":0.1,"stamp_s":{1.7e9 + clock.now - 3600.0}}}')
    assert [request for request, _ in reader.read()] == [Request.ESTOP]


def test_sequence_numbers_ascend_within_a_connection(make_office: Make) -> None:
    office = make_office()
    office.ask('{"type":"hold","sequence":5}')
    office.ask('{"type":"hold","sequence":5}')
    office.ask('{"type":"hold","sequence":4}')
    assert office.states == ["refused", "refused"] and "sequence 5 does not come after" in office.told[0].reason
    office.ask('{"type":"hold","sequence":0}', sender="another connection")
    office.desk.forget("a")
    office.ask('{"type":"hold","sequence":0}')
    assert len(office.told) == 2


def test_numbers_begin_anew_after_a_silence(make_office: Make) -> None:
    """A program that sends by POST was refused for ever once it had been started again."""
    office = make_office(lease_s=0.05)
    office.ask('{"type":"hold","sequence":5}')
    office.ask('{"type":"hold","sequence":4}')
    assert office.states[:1] == ["refused"]
    before = len(office.told)
    time.sleep(0.1)
    office.ask('{"type":"hold","sequence":1}')
    assert "refused" not in office.states[before:]
    assert len(office.run.arrived()) == 2


def test_a_released_stick_is_a_stop(make_office: Make) -> None:
    office = make_office()
    office.ask('{"type":"velocity","velocity":[0,0,0]}')
    assert office.run.arrived()[0].intent == Stop()


def test_goals_in_the_odometry_reach_the_planner_and_hold_until_the_next_target(make_office: Make) -> None:
    """They were refused: the loop could not follow them."""
    office = make_office()
    office.ask('{"type":"waypoint","position_m":[1,0],"heading_rad":0.5}')
    office.ask('{"type":"heading","heading_rad":1.5,"turning_rad_s":0.4}')
    arrived = office.run.arrived()
    assert [target.intent for target in arrived] == [Waypoint(1.0, 0.0, 0.5), Heading(1.5, 0.4)]
    assert [target.holds_s for target in arrived] == [float("inf")] * 2


def test_a_later_version_of_an_answer_says_where_the_robot_arrived_and_is_no_second_answer(make_office: Make) -> None:
    """The sender of a waypoint could not know when the robot was there."""
    office = make_office()
    office.ask('{"type":"waypoint","position_m":[1,0]}')
    (target,) = office.run.arrived()
    office.run.answer(target.id)
    office.desk.pump()
    step = HeardStep(text="waypoint", heard_as="waypoint", end="done", place=(0.97, 0.02, 0.1))
    office.run.heard.publish(Heard(id=target.id, asked="waypoint", state="accepted", steps=(step,)))
    office.run.step()
    office.desk.pump()
    assert office.states == ["accepted"]
    followed = status_of(office.desk, "op3", "sim", 125.0, None).following
    assert followed is not None and (followed.end, followed.place) == ("done", (0.97, 0.02, 0.1))


def test_what_is_followed_ends_with_a_stop_without_torque_and_for_words_that_are_not_understood(
    make_office: Make,
) -> None:
    """The page named an older sentence while the robot stood for another reason."""
    office = make_office()

    def followed() -> bool:
        office.run.step()
        office.desk.pump()
        return office.desk.following is not None

    def sent(message: str) -> int:
        office.ask(message)
        while not (arrived := office.run.arrived()):
            office.desk.pump()
        return arrived[-1].id

    def accept() -> None:
        office.run.state, office.run.stopped = State.STREAMING, False
        office.run.step()
        office.run.answer(sent(WAVE))
        assert followed()

    accept()
    office.run.stopped = True
    assert not followed()
    for state in (State.PARK, State.OFF, State.FAULT):
        accept()
        office.run.state = state
        assert not followed()
    accept()
    fly = sent('{"type":"text","text":"fly to the moon"}')
    office.run.heard.publish(Heard(id=fly, asked="?", state="refused", tick=7, reason="it stands still"))
    assert not followed()


def test_a_velocity_that_is_not_sent_again_is_told_as_over(make_office: Make) -> None:
    office = make_office()
    office.ask('{"type":"velocity","velocity":[0.3,0,0],"ttl_s":0.001}')
    (target,) = office.run.arrived()
    office.run.answer(target.id)
    office.run.step()
    office.desk.pump()
    time.sleep(0.002)
    office.desk.pump()
    told = status_of(office.desk, "op3", "sim", 125.0, None).following
    assert told is not None and told.end == "expired"


def test_an_arm_is_accepted_once_torque_is_on_and_refused_with_the_loops_reason(make_office: Make) -> None:
    office = make_office()
    office.run.state = State.OFF
    office.ask('{"type":"arm"}')
    office.run.telemetry.emit(office.run.tick, "request", "ARM")
    office.run.step()
    office.desk.pump()
    assert office.states == [], "torque is still off: it may have been refused, and the reason is on its way"
    office.run.telemetry.emit(office.run.tick, "refused", "ARM: the torso is tilted by 80°: the robot lies")
    office.desk.pump()
    assert office.told[0].state == "refused" and office.told[0].reason == "the torso is tilted by 80°: the robot lies"
    office.ask('{"type":"arm"}')
    office.run.telemetry.emit(office.run.tick, "request", "ARM")
    office.run.state = State.READY
    office.run.step()
    office.desk.pump()
    assert office.states == ["refused", "accepted"] and office.told[1].tick == office.run.tick - 1


def test_requests_are_answered_with_the_tick_at_which_the_loop_took_them(make_office: Make) -> None:
    office = make_office()
    reader = office.requests.reader()
    office.run.step()
    office.ask('{"type":"stop"}')
    (sent,) = reader.read()
    assert sent[0] is Request.STOP
    office.desk.pump()
    assert office.told == []
    office.run.take(Request.STOP)
    office.desk.pump()
    assert (office.told[0].state, office.told[0].tick) == ("accepted", 1)


def test_a_burst_of_stops_is_one_request_and_each_is_answered(make_office: Make) -> None:
    """The channel keeps 32 requests between two ticks; further ones were lost and never answered."""
    office = make_office()
    reader = office.requests.reader()
    for _ in range(500):
        office.ask('{"type":"stop"}')
    assert [request for request, _ in reader.read()] == [Request.STOP]
    office.run.take(Request.STOP)
    office.desk.pump()
    assert office.states == ["accepted"] * 500


def test_a_loop_that_does_not_run_is_told_to_the_sender(make_office: Make, clock: Clock) -> None:
    office = make_office()
    office.ask('{"type":"estop"}')
    clock.now += 1.1
    office.desk.pump()
    assert office.states == ["refused"] and "the loop did not take it" in office.told[0].reason


def test_a_clear_is_accepted_only_where_it_releases_the_stop(make_office: Make) -> None:
    office = make_office()
    office.ask('{"type":"clear"}')
    office.run.take(Request.CLEAR)
    office.desk.pump()
    assert office.states == ["accepted"]
    office.ask('{"type":"clear"}')
    office.run.telemetry.emit(office.run.tick, "request", "CLEAR")
    office.run.stopped, office.run.state = True, State.FAULT
    office.desk.pump()
    assert office.states == ["accepted"], "before the loop's next row its effect is not known"
    office.run.step()
    office.run.telemetry.emit(office.run.tick, "refused", "CLEAR: the robot is still in PARK, on its way to FAULT")
    office.desk.pump()
    assert office.states == ["accepted", "refused"] and "in PARK" in office.told[1].reason


def test_only_the_operator_is_followed_but_anyone_stops(make_office: Make) -> None:
    office = make_office()
    reader = office.requests.reader()
    office.ask('{"type":"text","text":"wave","source":"page"}')
    office.ask('{"type":"text","text":"bow","source":"phone"}')
    assert office.states == ["refused"] and "'page' is the operator" in office.told[0].reason
    office.ask('{"type":"clear","source":"phone"}')
    assert office.states == ["refused"] * 2 and reader.read() == []
    office.ask('{"type":"stop","source":"phone"}')
    assert [request for request, _ in reader.read()] == [Request.STOP]
    changes: list[tuple[str | None, str | None]] = []
    office.desk.on_lease = lambda before, now: changes.append((before, now))
    office.ask('{"type":"take","source":"phone"}')
    assert office.told[-1].state == "accepted" and office.told[-1].took_lease_from == "page"
    office.ask('{"type":"release","source":"phone"}')
    assert changes == [("page", "phone"), ("phone", None)]


def test_anyone_may_disarm_and_nobody_loses_the_lease_by_it(make_office: Make) -> None:
    """Another operator's robot could only be brought down by an emergency stop, which is the rougher way."""
    office = make_office()
    reader = office.requests.reader()
    office.ask('{"type":"text","text":"wave","source":"page"}')
    office.ask('{"type":"disarm","source":"phone","sequence":3}')
    office.ask('{"type":"disarm","source":"phone","sequence":3}')
    assert [request for request, _ in reader.read()] == [Request.DISARM] and office.desk.lease.holder == "page"
    assert office.states == ["refused"] and "sequence 3" in office.told[0].reason


def test_whoever_may_send_may_cut_the_torque_and_nobody_loses_the_lease_by_it(make_office: Make) -> None:
    """A kill was refused because another operator held the lease: the robot went on, on whoever lay under it."""
    office = make_office(priorities={"page": 2})
    reader = office.requests.reader()
    office.ask('{"type":"velocity","velocity":[0.3,0,0],"ttl_s":60,"source":"page"}')
    office.ask('{"type":"kill","source":"phone"}')
    assert office.states == ["refused"] and reader.read() == [], "not without its sentence"
    office.ask('{"type":"kill","confirm":"the robot will fall","source":"phone"}')
    assert [request for request, _ in reader.read()] == [Request.KILL] and office.desk.lease.holder == "page"


def test_an_emergency_depends_on_no_order_of_arrival(make_office: Make) -> None:
    """A client that began to count anew had its STOP refused for its sequence number."""
    office = make_office()
    reader = office.requests.reader()
    office.ask('{"type":"text","text":"wave","sequence":7}')
    office.ask('{"type":"stop","sequence":1}')
    office.ask('{"type":"kill","confirm":"the robot will fall","sequence":2,"stamp_s":9e9}')
    assert [request for request, _ in reader.read()] == [Request.STOP, Request.KILL]


def test_a_message_that_is_too_large_is_refused_and_counted(make_office: Make) -> None:
    office = make_office(most_bytes=512)
    office.ask(b'{"type":"text","text":"' + b"a" * 600 + b'"}')
    office.ask(b"\xff\xfe")
    assert office.states == ["refused", "refused"]
    assert office.told[0].reason == "625 bytes, expected at most 512"
    assert office.desk.counts["rejected: too large"] == 1 and office.desk.counts["rejected: not valid"] == 1
    assert office.desk.counts["received"] == 2 and office.desk.counts["refused"] == 2


def test_the_planners_reason_is_the_answers(make_office: Make) -> None:
    office = make_office()
    office.ask(WAVE)
    office.run.answer(office.run.arrived()[0].id, "refused", "target: a model cannot follow clip")
    office.desk.pump()
    assert office.told[0].state == "refused" and office.told[0].reason == "target: a model cannot follow clip"
    assert office.desk.following is None


def test_answers_come_while_time_passes(make_office: Make) -> None:
    """The clock of the desk is that of the targets' stamps."""
    office = make_office()
    before = time.perf_counter_ns()
    office.ask(WAVE)
    assert before <= office.run.arrived()[0].stamp_ns <= time.perf_counter_ns()


def cause_after(office: Any, kind: str, message: str) -> str | None:
    """The status's cause after an event of the loop."""
    office.run.telemetry.emit(office.run.tick, kind, message)
    office.desk.pump()
    return status_of(office.desk, "op3", "sim", 125.0, None).cause


def test_a_fault_is_told_in_the_status_until_it_is_cleared(make_office: Make) -> None:
    """The status said FAULT and not why; the cause was in the log alone."""
    office = make_office()
    office.run.step()

    told = partial(cause_after, office)
    assert told("state", "STREAMING -> DAMPED: fall: torso tilted past the robot's limit") == (
        "fall: torso tilted past the robot's limit"
    )
    assert told("warning", "servo of l_knee (id 14) is at 53 °C") == "fall: torso tilted past the robot's limit"
    assert told("fault", "DAMPED -> FAULT: fall: torso tilted past the robot's limit") is not None
    assert told("state", "FAULT -> OFF") is None
    assert told("fault", "no start: servo of l_knee (id 14) does not answer") is not None
    assert told("state", "OFF -> READY") is None


def test_the_first_cause_stays_in_the_status(make_office: Make) -> None:
    """A pulled cable read as "torque off is not confirmed by …" alone, a dead servo as a planner that had died."""
    office = make_office()
    office.run.step()

    told = partial(cause_after, office)
    lost, stiff = "bus lost: no joint has answered for 6 reads", "torque off is not confirmed by l_knee (id 14): …"
    died, begun = "the planner's process died (exit code 1); it is started again", "HOLD -> PARK"
    assert told("state", f"STREAMING -> HOLD: {lost}") == lost
    assert told("fault", died) == f"{lost}; {died}"
    assert told("state", f"{begun}: {lost}") == lost
    assert told("fault", f"PARK -> FAULT: {lost}") == lost
    assert told("fault", stiff) == f"{lost}; {stiff}"  # a person beside the robot must know it too
    assert told("state", "FAULT -> OFF") is None
    assert told("fault", "no start: servo of l_knee (id 14) does not answer") is not None
    assert told("fault", "no start: supply at 9.5 V, below 10.2 V") == "no start: supply at 9.5 V, below 10.2 V"


def test_a_planner_that_died_is_the_cause_of_the_stand_that_follows(make_office: Make) -> None:
    """The robot stopped for it, and with the change to HOLD the status told no cause any more."""
    office = make_office()
    office.run.step()
    died = "the planner's process died (exit code 1); it is started again"
    for kind, message in (("fault", died), ("state", "STREAMING -> HOLD")):
        office.run.telemetry.emit(office.run.tick, kind, message)
    office.desk.pump()
    assert office.desk.cause.text == died
    office.run.telemetry.emit(office.run.tick, "state", "HOLD -> STREAMING")
    office.desk.pump()
    assert office.desk.cause.text is None


@pytest.mark.parametrize("words", ["emergency stop", "e-stop", "halt", "stop!"])
def test_words_of_alarm_stop_the_robot_whoever_holds_the_lease(make_office: Make, words: str) -> None:
    """Words like "emergency stop" were answered `accepted` as "a prohibition", and nothing stopped."""
    office = make_office()
    office.ask('{"type":"text","text":"wave","source":"another","sequence":9}')
    office.run.arrived()
    requests = office.requests.reader()
    office.ask(f'{{"type":"text","text":"{words}","id":"s","source":"page","sequence":3}}')
    assert requests.read() == [(Request.STOP, "page: stop")] and office.run.arrived() == []
    office.run.take(Request.STOP)
    office.desk.pump()
    answer = office.told[-1]
    assert (answer.id, answer.asked, answer.state, answer.heard_as) == ("s", "text", "accepted", "stop")
    assert answer.notes is not None and "EMERGENCY STOP is its own button" in answer.notes[0]
    # It latches as the button does.
    assert office.desk.following is None and office.run.stopped


def test_stop_by_itself_is_a_target_as_before(make_office: Make) -> None:
    office = make_office()
    office.ask('{"type":"text","text":"stop"}')
    assert [target.intent for target in office.run.arrived()] == [Text("stop")]


HAND = '{"type":"hand","side":"%s","position_m":[0.1,0.1,0],"id":"%s"}'


def test_a_part_replaces_no_target_of_another_part_nor_of_the_body(make_office: Make, clock: Clock) -> None:
    """A hand that is dragged must not drop the velocity that a stick sends beside it."""
    office = make_office(coalesce_s=0.005)
    office.ask(WALK)
    for side, identity in (("left", "l0"), ("left", "l1"), ("right", "r1"), ("left", "l2"), ("left", "l3")):
        office.ask(HAND % (side, identity))
    clock.now += 0.02
    office.desk.pump()
    arrived = office.run.arrived()
    assert [type(target.intent).__name__ for target in arrived] == ["Velocity", "Hand", "Hand", "Hand", "Hand"]
    assert [answer.id for answer in office.told] == ["l2"] and office.states == ["superseded"]
    for target in reversed(arrived):
        office.run.answer(target.id)
        office.desk.pump()
    # The planner answers every hand: a newer one that it refuses leaves the one before it as it is.
    assert Counter(office.states) == {"accepted": 5, "superseded": 1}
    assert office.desk.following is not None and "velocity" in office.desk.following.asked


def test_a_hand_that_is_let_go_does_not_go_back_to_where_it_was_dragged(make_office: Make, clock: Clock) -> None:
    """The last of a burst of hand targets waited, the release did not, and the hand target was sent after it."""
    office = make_office(coalesce_s=0.005)
    for identity in ("h1", "h2", "h3"):
        office.ask(HAND % ("left", identity))
    for part in ("left hand", "head", "right hand"):
        office.ask(json.dumps({"type": "relax", "part": part}))
    clock.now += 0.02
    office.desk.pump()
    arrived = [target.intent for target in office.run.arrived()]
    assert [type(intent).__name__ for intent in arrived] == ["Hand", "Hand", "Relax", "Relax", "Relax"]
    assert [answer.id for answer in office.told] == ["h3"] and office.states == ["superseded"]


def test_a_foot_that_is_kept_down_and_its_place_replace_each_other_at_no_desk(make_office: Make, clock: Clock) -> None:
    """As one part of the body, a foot target that came 2 ms later would have dropped the restriction unread."""
    office = make_office(coalesce_s=0.005)
    place = '{"type":"foot","side":"left","position_m":[0.0,0.12],"id":"%s"}'
    for message in ('{"type":"contact","foot":"left"}', place % "f1", place % "f2", place % "f3"):
        office.ask(message)
    office.ask('{"type":"relax","part":"left foot"}')
    clock.now += 0.02
    office.desk.pump()
    arrived = [type(target.intent).__name__ for target in office.run.arrived()]
    assert arrived == ["Contact", "FootPlace", "FootPlace", "Relax"]
    assert [answer.id for answer in office.told] == ["f3"] and office.states == ["superseded"]


def test_a_part_holds_for_its_time_to_live_or_that_of_the_settings_after_it_is_there(make_office: Make) -> None:
    office = make_office(part_holds_s=4.0)
    office.ask(HAND % ("left", "l1"))
    office.ask('{"type":"look","direction":[1,0,0],"in_s":1,"ttl_s":3}')
    assert [target.holds_s for target in office.run.arrived()] == [4.5, 3.0]


def test_names_of_joints_that_there_are_not_do_not_pass_the_limit_on_rate(make_office: Make, clock: Clock) -> None:
    """Each new name had an interval of its own: memory grew with them, and the planner's mailbox overran."""
    office, arrived = make_office(coalesce_s=0.005), 0
    joint = '{"type":"joint","joint":"j%d","angle_rad":0.5,"id":"%d"}'
    for number in range(4000):
        office.ask(joint % (number, number))
        if number % 20 == 19:
            clock.now += 0.005
            office.desk.pump()
            arrived += len(office.run.arrived())
    assert arrived <= 32 * 11 and Counter(office.states)["refused"] >= 3500
    assert "targets wait for 64 parts already" in str(office.told[0].reason)
    assert len(office.desk._waiting) <= 64 and len(office.desk._rates._sent_s) <= 32
    office.ask(WALK)
    assert [type(target.intent).__name__ for target in office.run.arrived()] == ["Velocity"]
    for _ in range(4):
        clock.now += 0.1
        office.desk.pump()
        arrived += len(office.run.arrived())
    assert not office.desk._waiting and len(office.told) + arrived == 4000
