"""Targets for the place of the head in a whole run in lockstep: where it is, and what becomes of each."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from benchmarks.robot.head_places import Measured
from flexmotion.configs.errors import ConfigError
from flexmotion.retarget.head_places import HeadPlaces
from flexmotion.retarget.part_paths import PartGoal, PartGoals
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.intents import Text, Velocity
from flexmotion.streamer.motion.part_intents import FootPlace, Hand, HeadPlace, Look, Relax
from flexmotion.streamer.motion.restriction_intents import Contact, TorqueCap
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.planning.head_targets import HeadTargets
from flexmotion.streamer.run.requests import Request

from .test_live_targets import Live
from .test_part_targets import RATE, asked, go_on, live
from .test_restrictions import Restarted, capped

__all__ = ["capped", "live"]

DOWN = HeadPlace((0.06, 0.02, 0.37), in_s=1.2)
"""Low, ahead and aside: near the edge of what is in reach."""
WALK = Velocity(0.3, 0.0, 0.0)
FOREVER = np.inf


def head(live: Live) -> np.ndarray:
    """Place of the head of the simulated robot from the middle between its soles now, (3,) [m]."""
    ticks = live.session.record.ticks
    return Measured(live.session.robot).head(ticks.true_base[-1], ticks.true_q[-1])


def assert_at(live: Live, place: tuple[float, float, float] | np.ndarray, within_m: float = 0.006) -> None:
    assert np.linalg.norm(head(live) - place) < within_m


def greatest_tilt(live: Live) -> float:
    return float(np.linalg.norm(live.session.record.ticks.tilt, axis=1).max())


def notes(live: Live) -> list[str]:
    return [event.message for event in live.session.record.events if event.kind == "note"]


def test_a_head_is_there_in_time_stays_and_the_robot_rises_when_its_time_is_over(live: Live) -> None:
    begin, home = live.session.state.tick, head(live)
    answer = asked(live, DOWN, holds_s=4.0)
    assert (answer.state, answer.heard_as) == ("accepted", "head place") and answer.tick is not None
    go_on(live, 1.2 - (live.session.state.tick - begin) / RATE)
    assert_at(live, DOWN.place)
    live.until_state(State.HOLD)  # nothing is left to be planned while it is held
    assert_at(live, DOWN.place)
    off, words = str(live.newest[answer.id].there).split(" ", 1)
    assert float(off) < 0.6 and words == "cm from there" and live.newest[answer.id].over is None
    live.until(lambda: live.newest[answer.id].over, "its time to be over")
    assert live.newest[answer.id].over == "expired"
    live.until_state(State.STREAMING)
    live.until_state(State.HOLD)
    assert_at(live, home)
    ticks = live.session.record.ticks
    assert live.session.record.violations_sent == 0
    assert not ticks.true_self_contact.any()
    assert ticks.contact_ref[begin - int(ticks.tick[0]) :].all()  # no foot was lifted


def test_from_place_to_place_with_only_a_height_as_well(live: Live) -> None:
    """A robot that was asked for a height alone leaned aside: every tilt made it as low."""
    for place in ((0.0, -0.03, 0.4), (0.09, 0.0, 0.4), (-0.03, 0.02, 0.43)):
        assert asked(live, HeadPlace(place), FOREVER).state in ("accepted", "slowed")
        go_on(live, 1.7)
        assert_at(live, place)
    assert asked(live, HeadPlace((None, None, 0.4)), FOREVER).state in ("accepted", "slowed")
    go_on(live, 1.7)
    assert abs(head(live)[2] - 0.4) < 0.006
    assert np.linalg.norm(live.session.record.ticks.tilt[-1]) < 0.05


def test_places_that_are_moved_slowed_or_refused_say_so(live: Live) -> None:
    late = asked(live, HeadPlace((0.02, 0.0, 0.38), in_s=0.1), FOREVER)
    assert late.state == "slowed" and "s until it is there" in str(late.slowed)
    go_on(live, float(str(late.slowed).split()[0]))
    assert_at(live, (0.02, 0.0, 0.38), 0.015)
    go_on(live, 0.5)
    moved = asked(live, HeadPlace((0.02, 0.06, 0.4)), FOREVER)
    assert moved.state == "moved" and "cm from there" in str(moved.moved)
    for place in ((0.3, 0.0, 0.4), (0.02, 0.0, 0.6), (0.02, 0.0, 0.1)):
        refused = asked(live, HeadPlace(place))
        assert refused.state == "refused" and "the nearest place is" in str(refused.reason)
    short = asked(live, HeadPlace((0.02, 0.0, 0.4), in_s=1.0), 0.5)
    assert short.state == "refused" and "it holds 0.5 s only" in str(short.reason)
    go_on(live, 1.5)
    told = np.array([float(value) for value in str(moved.moved)[1:].split("]")[0].split(",")])
    assert_at(live, told)  # what was refused has ended nothing


def test_hands_looks_and_gestures_go_on_and_the_weight_of_the_arms_is_made_up_for(live: Live) -> None:
    """Hands that were brought ahead of the body moved the head back by a centimetre."""
    assert asked(live, DOWN, FOREVER).state == "accepted"
    assert asked(live, Look((1.0, 0.6, -0.4)), FOREVER).state in ("accepted", "slowed")
    go_on(live, 2.0)
    assert_at(live, DOWN.place)
    assert asked(live, Hand("left", (0.15, 0.1, 0.1), in_s=1.0), FOREVER).state == "accepted"
    assert asked(live, Hand("right", (0.15, -0.1, 0.1), in_s=1.0), FOREVER).state == "accepted"
    go_on(live, 3.0)
    assert_at(live, DOWN.place)
    assert asked(live, Text("wave with the right hand"), FOREVER).state in ("accepted", "slowed")
    go_on(live, 2.0)
    assert_at(live, DOWN.place, 0.015)
    assert greatest_tilt(live) < 0.6


def test_a_correction_for_the_arms_took_as_long_as_the_whole_way_did(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A few millimetres took the 1.1 s that the servos need for all of the way down."""
    goals, with_goal = list[PartGoal](), HeadTargets.with_goal

    def seen(self: HeadTargets, parts: PartGoals) -> PartGoals:
        found = with_goal(self, parts)
        goals.append(found.goals[-1])
        return found

    low = HeadPlace((0.09, 0.0, 0.35), in_s=0.1)
    assert asked(live, low, FOREVER).state == "slowed"
    go_on(live, 2.0)
    monkeypatch.setattr(HeadTargets, "with_goal", seen)
    assert asked(live, Hand("left", (0.15, 0.1, 0.1), in_s=0.5), FOREVER).state in ("accepted", "slowed")
    assert asked(live, Hand("right", (0.15, -0.1, 0.1), in_s=0.5), FOREVER).state in ("accepted", "slowed")
    go_on(live, 1.0)
    before, after = goals[0], goals[-1]
    assert before.number == after.number and (after.angles != before.angles).any()
    assert before.least_s > 0.9 and after.least_s < 0.5
    assert after.back_s == pytest.approx(before.back_s, abs=0.3)


@pytest.mark.parametrize("asks", ["a motion", "a hand", "a head"])
def test_whoever_asked_for_something_new_waited_for_a_correction(
    live: Live, monkeypatch: pytest.MonkeyPatch, asks: str
) -> None:
    """A search for a posture took 50 ms before the plan that was waited for."""
    assert asked(live, DOWN, FOREVER).state == "accepted"
    go_on(live, 2.0)
    done, update, correct = list[str](), HeadTargets.update, HeadTargets._correct

    def updated(self: HeadTargets, *args: Any, urgent: bool) -> None:
        done.append("urgent" if urgent or self._waiting else "update")
        update(self, *args, urgent=urgent)

    def corrected(self: HeadTargets, *args: Any) -> None:
        done.append("correction")
        correct(self, *args)

    monkeypatch.setattr(HeadTargets, "update", updated)
    monkeypatch.setattr(HeadTargets, "_correct", corrected)
    intents = {"a motion": Text("wave"), "a hand": Hand("left", (0.15, 0.1, 0.1)), "a head": HeadPlace((0.0, 0.0, 0.4))}
    assert asked(live, intents[asks], FOREVER).state in ("accepted", "slowed")
    go_on(live, 0.2)
    assert "urgent" in done and "correction" in done
    assert all(after != "correction" for before, after in pairwise(done) if before == "urgent")


def test_arms_with_which_no_posture_stands_leave_the_head_as_it_is_and_tell_it_once(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert asked(live, DOWN, FOREVER).state == "accepted"
    go_on(live, 1.5)

    def nowhere(*_: object) -> None:
        raise ConfigError("head: the robot cannot stand otherwise")

    monkeypatch.setattr(HeadPlaces, "nearest", nowhere)
    assert asked(live, Hand("left", (0.15, 0.1, 0.1), in_s=0.5), FOREVER).state in ("accepted", "slowed")
    assert asked(live, Hand("right", (0.15, -0.1, 0.1), in_s=0.5), FOREVER).state in ("accepted", "slowed")
    go_on(live, 2.5)
    assert sum("the weight of the arms is not made up for" in note for note in notes(live)) == 1
    assert live.session.state.ladder in (State.STREAMING, State.HOLD)
    assert_at(live, DOWN.place, 0.02)


def test_a_walk_ends_it_and_no_foot_lifts_before_the_robot_has_risen(live: Live) -> None:
    assert asked(live, DOWN, FOREVER).state == "accepted"
    go_on(live, 1.5)
    begin = live.session.record.ticks.true_base[-1, 0]
    assert asked(live, WALK, FOREVER).state in ("accepted", "slowed")
    assert any(note.startswith("over: head to") and "needs the feet" in note for note in notes(live))
    live.until(lambda: not live.session.record.ticks.contact_ref[-1].all(), "a step")
    assert head(live)[2] > 0.41 and np.linalg.norm(live.session.record.ticks.tilt[-1]) < 0.12
    refused = asked(live, DOWN)
    assert refused.state == "refused" and "the robot walks, or makes a step" in str(refused.reason)
    go_on(live, 3.0)
    assert live.session.record.ticks.true_base[-1, 0] - begin > 0.1
    assert greatest_tilt(live) < 0.5


def test_a_walk_of_a_script_ends_it() -> None:
    live = Live(Item(6.0, WALK))
    with live.session:
        live.until_state(State.STREAMING)
        go_on(live, 1.0)
        assert asked(live, DOWN, FOREVER).state == "accepted"
        live.until(lambda: live.session.state.tick >= 6.0 * RATE, "the walk")
        assert_at(live, DOWN.place)
        begin = live.session.record.ticks.true_base[-1, 0]
        go_on(live, 4.0)
        assert live.session.record.ticks.true_base[-1, 0] - begin > 0.05


def test_feet_and_caps_of_legs_have_to_wait_and_a_kept_foot_does_not(live: Live) -> None:
    assert asked(live, Contact("both"), FOREVER).state == "accepted"
    assert asked(live, DOWN, FOREVER).state == "accepted"
    go_on(live, 1.5)
    assert_at(live, DOWN.place)
    assert asked(live, Relax("both feet")).state == "accepted"
    for intent in (FootPlace("left", (0.06, 0.1)), TorqueCap("left knee", 2.0)):
        refused = asked(live, intent, FOREVER)
        assert refused.state == "refused" and "let it go first (relax 'head place')" in str(refused.reason)
    assert asked(live, TorqueCap("l_el", 1.0), FOREVER).state == "accepted"
    assert asked(live, Relax("head place")).state == "accepted"
    assert "is asked for nothing" in str(asked(live, Relax("head place")).reason)
    go_on(live, 2.0)
    assert asked(live, TorqueCap("left knee", 2.0), FOREVER).state == "accepted"
    refused = asked(live, DOWN)
    assert refused.state == "refused" and "the torque of l_knee is capped" in str(refused.reason)


@pytest.mark.parametrize("ends", ["relax", "its time", "a walk"])
def test_a_cap_of_a_leg_was_accepted_while_the_robot_rose_and_was_exceeded(live: Live, ends: str) -> None:
    """A knee that was capped at .7 N·m just after `relax` made 1.07 N·m on the way up."""
    assert asked(live, HeadPlace((None, None, 0.35)), 2.2 if ends == "its time" else FOREVER).state == "accepted"
    go_on(live, 1.5)
    if ends == "its time":
        live.until(lambda: "over: head to" in " ".join(notes(live)), "its time to be over")
    else:
        live.session.send(Relax("head place") if ends == "relax" else WALK, holds_s=FOREVER)
    for _ in range(4):  # at once, and on the way up
        assert head(live)[2] < 0.44
        refused = asked(live, TorqueCap("left knee", 0.7), FOREVER)
        assert refused.state == "refused" and str(refused.reason).startswith("torque: the")
        assert asked(live, TorqueCap("l_el", 1.0), FOREVER).state == "accepted"
        go_on(live, 0.1)
    if ends != "a walk":
        go_on(live, 2.0)
        assert asked(live, TorqueCap("left knee", 0.7), FOREVER).state == "accepted"


def test_over_feet_in_a_stride_it_is_there_as_well(live: Live) -> None:
    assert asked(live, FootPlace("left", (0.06, 0.115), 0.2), FOREVER).state in ("accepted", "slowed")
    refused = asked(live, DOWN)
    assert refused.state == "refused" and "the robot walks, or makes a step" in str(refused.reason)
    go_on(live, 1.8)
    place = (0.04, 0.01, 0.39)
    assert asked(live, HeadPlace(place), FOREVER).state in ("accepted", "slowed")
    go_on(live, 1.8)
    assert_at(live, place)


@pytest.mark.parametrize("after_s", [0.1, 0.5, 1.5])
def test_a_stop_leaves_the_robot_as_it_is_until_something_new_is_asked_for(live: Live, after_s: float) -> None:
    """A stop raised the robot to its stand within half a second."""
    home = head(live)
    number = live.session.send(DOWN, holds_s=3.0).id
    go_on(live, after_s)
    before = head(live)
    live.session.ask(Request.STOP)
    go_on(live, 0.6)
    stopped = head(live)
    assert np.linalg.norm(stopped - before) < 0.05
    go_on(live, 3.0)
    assert_at(live, stopped)
    assert live.told[number].state == "accepted"
    assert "release the stop first" in str(asked(live, DOWN).reason)
    live.session.ask(Request.CLEAR)
    go_on(live, 2.0)
    assert_at(live, stopped)
    assert asked(live, Hand("left", (0.12, 0.12, 0.05), in_s=1.0), 1.5).state == "accepted"
    go_on(live, 1.0)
    assert_at(live, stopped, 0.02)
    relaxed = asked(live, Relax("all"))
    assert relaxed.state == "accepted"
    go_on(live, 2.5)
    assert_at(live, home, 0.01)


@pytest.mark.parametrize("ticks", [0, 1, 4])
def test_a_stop_right_after_a_target_left_an_upright_robot_that_took_none_for_its_feet(live: Live, ticks: int) -> None:
    """It counted as bent, and refused feet and caps of legs until `relax`, though the head had never moved."""
    home = head(live)
    number = live.session.send(DOWN, holds_s=FOREVER).id
    for _ in range(ticks):
        live.session.step()
    live.session.ask(Request.STOP)
    go_on(live, 1.5)
    assert_at(live, home)
    answer = live.newest[number]
    assert answer.state == "refused" or answer.over == "stopped"
    live.session.ask(Request.CLEAR)
    go_on(live, 0.3)
    assert asked(live, TorqueCap("left knee", 2.0), FOREVER).state == "accepted"
    assert asked(live, Relax("torque left knee")).state == "accepted"
    assert asked(live, FootPlace("left", (0.04, 0.09))).state in ("accepted", "slowed", "moved")


@pytest.mark.parametrize("ends", ["relax", "a walk", "a newer place", "a second stop and parking"])
def test_a_trunk_that_a_stop_had_halted_was_in_no_status_until_it_rose(live: Live, ends: str) -> None:
    """Its target was told as over, though feet, caps and steps were refused for it."""
    number = asked(live, DOWN, FOREVER).id
    go_on(live, 0.4)
    live.session.ask(Request.STOP)
    go_on(live, 1.5)
    live.session.ask(Request.CLEAR)
    go_on(live, 0.3)
    left = live.newest[number]
    assert (left.holds, left.over, left.missed) == ("part", None, "stopped on its way")
    assert "hips and trunk stay as they are until relax 'head place'" in " ".join(left.notes)
    assert sum("hips and trunk stay" in note for note in notes(live)) == 1
    match ends:
        case "relax":
            assert asked(live, Relax("head place")).state == "accepted"
        case "a walk":
            assert asked(live, WALK).state in ("accepted", "slowed")
        case "a newer place":
            assert asked(live, HeadPlace((0.0, 0.0, 0.4))).state in ("accepted", "slowed")
        case _:
            live.session.ask(Request.STOP)
            go_on(live, 0.3)
            assert live.newest[number].over is None
            live.session.ask(Request.DISARM)
            live.until_state(State.PARK)
            go_on(live, 0.1)
    known = {"relax": "let go", "a walk": "superseded", "a newer place": "superseded"}
    assert live.newest[number].over == known.get(ends, "stopped")


def test_a_stop_on_the_way_back_leaves_it_there_and_a_walk_goes_on_from_it(live: Live) -> None:
    asked(live, DOWN, FOREVER)
    go_on(live, 1.5)
    assert asked(live, Relax("head place")).state == "accepted"
    go_on(live, 0.3)
    live.session.ask(Request.STOP)
    go_on(live, 0.5)
    stopped = head(live)
    assert stopped[2] < 0.44
    go_on(live, 1.0)
    assert_at(live, stopped)
    live.session.ask(Request.CLEAR)
    go_on(live, 0.5)
    begin = live.session.record.ticks.true_base[-1, 0]
    assert asked(live, WALK, FOREVER).state in ("accepted", "slowed")
    go_on(live, 4.0)
    assert live.session.record.ticks.true_base[-1, 0] - begin > 0.1
    assert greatest_tilt(live) < 0.5


@pytest.mark.parametrize("request_", [Request.DISARM, Request.ESTOP])
@pytest.mark.parametrize("place", [(0.09, 0.0, 0.35), (0.0, 0.035, 0.38), (-0.035, 0.0, 0.4)])
def test_it_is_parked_from_every_place(live: Live, place: tuple[float, float, float], request_: Request) -> None:
    assert asked(live, HeadPlace(place), FOREVER).state in ("accepted", "slowed", "moved")
    go_on(live, 1.7)
    live.session.ask(request_)
    live.until_state(State.PARK)
    while live.session.state.ladder is State.PARK and live.session.step():
        pass
    assert live.session.state.ladder in (State.OFF, State.FAULT)
    assert greatest_tilt(live) < 0.75  # what counts as a fall is .785


def test_a_new_planner_leaves_the_robot_as_it_is(capped: Restarted) -> None:
    assert asked(capped, Relax("torque l_el")).state == "accepted"
    number = asked(capped, DOWN, FOREVER).id
    go_on(capped, 1.5)
    capped.until_state(State.HOLD)
    capped.restart()
    go_on(capped, 0.5)
    left = capped.newest[number]  # it was told as over, though the trunk stayed and steps were refused for it
    assert left.over is None and "cm from there" in str(left.there) and "hips and trunk stay" in left.notes[-1]
    assert asked(capped, Look((1.0, 0.5, 0.0), in_s=0.5)).state == "accepted"
    go_on(capped, 1.5)
    assert_at(capped, DOWN.place)
    assert asked(capped, Relax("head place")).state == "accepted"
    assert capped.newest[number].over == "let go"
    go_on(capped, 2.0)
    assert head(capped)[2] > 0.45
