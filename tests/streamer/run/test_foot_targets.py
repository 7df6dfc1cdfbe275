"""Targets for the place of a foot in a whole run in lockstep: where it is, and what becomes of each."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.robot.foot_targets import Soles
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.intents import Text, Velocity
from flexmotion.streamer.motion.part_intents import FootPlace, Hand, Look, Relax
from flexmotion.streamer.motion.restriction_intents import Contact, TorqueCap
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.run.requests import Request

from .test_live_targets import Live
from .test_part_targets import RATE, asked, go_on, live
from .test_restrictions import Restarted, capped

__all__ = ["capped", "live"]

AHEAD = FootPlace("left", (0.06, 0.1), in_s=1.2)
WALK = Velocity(0.3, 0.0, 0.0)
FOREVER = np.inf
BESIDE = 0.0956
"""Distance between OP3's soles side by side [m]."""


def sole(live: Live, side: str = "left") -> np.ndarray:
    """A sole of the simulated robot seen from the other one now: ahead, left [m], heading [rad], (3,)."""
    ticks = live.session.record.ticks
    return Soles(live.session.robot).seen(side, ticks.true_base[-1], ticks.true_q[-1])


def assert_there(live: Live, foot: FootPlace) -> None:
    found = sole(live, foot.side)
    assert math.hypot(*(found[:2] - foot.place)) < 0.012 and abs(found[2] - foot.heading) < 0.06


def assert_beside(live: Live) -> None:
    assert math.hypot(*(sole(live)[:2] - (0.0, BESIDE))) < 0.012


def test_a_foot_is_there_in_time_stays_and_comes_beside_the_other_one(live: Live) -> None:
    begin = live.session.state.tick
    answer = asked(live, AHEAD, holds_s=4.0)
    assert (answer.state, answer.heard_as) == ("accepted", "left foot") and answer.tick is not None
    go_on(live, 1.2 - (live.session.state.tick - begin) / RATE)
    assert_there(live, AHEAD)
    live.until_state(State.HOLD)  # nothing is left to be planned while it stands there
    assert_there(live, AHEAD)
    off, words = str(live.newest[answer.id].there).split(" ", 1)
    assert float(off) < 1.2 and words == "cm from there" and live.newest[answer.id].over is None
    live.until_state(State.STREAMING)
    assert live.newest[answer.id].over == "expired"
    live.until_state(State.HOLD)
    assert_beside(live)
    assert live.session.record.violations_sent == 0
    assert np.abs(live.session.record.ticks.tilt).max() < 0.2


def test_a_foot_waits_until_it_is_due_turns_and_is_let_go(live: Live) -> None:
    foot = FootPlace("right", (-0.04, -0.12), -0.3, in_s=2.5)
    assert asked(live, foot, FOREVER).state == "accepted"
    go_on(live, 1.3)
    assert_beside(live)
    go_on(live, 1.3)
    assert_there(live, foot)
    assert asked(live, Relax("left foot")).state == "refused"
    assert asked(live, Relax("right foot")).state == "accepted"
    go_on(live, 1.5)
    assert_beside(live)
    refused = asked(live, Relax("right foot"))
    assert refused.state == "refused" and "is asked for nothing" in str(refused.reason)


def test_places_that_are_moved_slowed_or_refused_say_so(live: Live) -> None:
    late = asked(live, FootPlace("left", (0.05, 0.1), in_s=0.2), FOREVER)
    assert late.state == "slowed" and "s until it is there" in str(late.slowed)
    go_on(live, 1.2)
    moved = asked(live, FootPlace("left", (0.06, 0.08)), FOREVER)
    assert (moved.state, moved.moved) == ("moved", "[0.060, 0.094] m, 1.4 cm from there")
    for foot, reason in (
        (FootPlace("left", (0.3, 0.1)), "out of reach of a step of the left foot; the nearest place is"),
        (FootPlace("right", (0.0, 0.1)), "19.4 cm from there"),
        (FootPlace("left", (0.0, 0.13), 1.2), "heading 1.2 rad (68.75°), expected -0.4 to 0.5 rad (-22.92° to 28.65°)"),
    ):
        refused = asked(live, foot)
        assert refused.state == "refused" and reason in str(refused.reason)
    short = asked(live, FootPlace("left", (0.0, 0.12), in_s=1.0), 0.5)
    assert short.state == "refused" and "it holds 0.5 s only" in str(short.reason)
    go_on(live, 1.2)
    assert_there(live, FootPlace("left", (0.06, 0.094)))  # what was refused has ended nothing


def test_one_foot_after_the_other_gets_the_robot_ahead(live: Live) -> None:
    begin = live.session.record.ticks.true_base[-1, 0]
    left, right = FootPlace("left", (0.06, 0.1)), FootPlace("right", (0.06, -0.1))
    for foot in (left, right, left, FootPlace("right", (0.0, -0.1))):
        assert asked(live, foot, FOREVER).state in ("accepted", "slowed")
        go_on(live, 1.3)
        assert_there(live, foot)
    assert live.session.record.ticks.true_base[-1, 0] - begin > 0.12
    first, second = (live.session.send(foot, holds_s=FOREVER) for foot in (left, right))
    assert live.until_answered(first.id).state == "superseded"
    assert live.until_answered(second.id).state in ("accepted", "slowed")


def test_a_robot_that_walks_is_asked_for_no_foot_and_a_walk_ends_one(live: Live) -> None:
    """After a walk that its time to live had ended, the robot stood, and was said to walk."""
    assert asked(live, AHEAD, FOREVER).state == "accepted"
    go_on(live, 1.5)
    assert asked(live, WALK, 2.0).state in ("accepted", "slowed")
    go_on(live, 1.0)
    refused = asked(live, AHEAD, FOREVER)
    assert refused.state == "refused" and "the robot walks, or makes steps" in str(refused.reason)
    notes = [event.message for event in live.session.record.events if event.kind == "note"]
    assert any(note.startswith("over: left foot to [0.06, 0.1] m") and "needs the feet" in note for note in notes)
    live.until_state(State.HOLD)
    assert_beside(live)
    assert asked(live, AHEAD, FOREVER).state == "accepted"
    walk = live.session.send(WALK)
    pending = live.session.send(FootPlace("right", (0.05, -0.1)))
    assert live.until_answered(walk.id).state in ("accepted", "slowed")
    assert live.until_answered(pending.id).state in ("refused", "superseded")


def test_a_walk_of_a_script_ends_a_foot() -> None:
    """No target had come that needs the feet, and the robot stood through the walk that its script had next."""
    live = Live(Item(6.0, WALK))
    with live.session:
        live.until_state(State.STREAMING)
        go_on(live, 1.0)
        assert asked(live, AHEAD, FOREVER).state == "accepted"
        live.until(lambda: live.session.state.tick >= 6.0 * RATE, "the walk")
        assert_there(live, AHEAD)
        begin = live.session.record.ticks.true_base[-1, 0]
        go_on(live, 3.0)
        assert live.session.record.ticks.true_base[-1, 0] - begin > 0.05


def test_gestures_leave_a_foot_where_it_is_and_a_newer_motion_that_steps_ends_it(live: Live) -> None:
    assert asked(live, AHEAD, FOREVER).state == "accepted"
    go_on(live, 1.5)
    assert asked(live, Hand("left", (0.12, 0.12, 0.05), in_s=1.0)).state == "accepted"
    assert asked(live, Text("wave with the right hand"), FOREVER).state == "accepted"
    go_on(live, 1.5)
    assert_there(live, AHEAD)
    begin = live.session.record.ticks.true_base[-1, 0]
    # The listener of the stub does not know it as a walk: only the motion shows its steps.
    assert asked(live, Text("walk forward"), FOREVER).state in ("accepted", "slowed")
    go_on(live, 3.0)
    assert live.session.record.ticks.true_base[-1, 0] - begin > 0.05
    assert np.abs(live.session.record.ticks.tilt).max() < 0.5


def test_a_foot_that_is_kept_down_is_placed_nowhere_and_the_other_one_may_be(live: Live) -> None:
    assert asked(live, Contact("left"), FOREVER).state == "accepted"
    refused = asked(live, AHEAD, FOREVER)
    assert refused.state == "refused" and "left foot: it is kept down: let it go first (relax" in str(refused.reason)
    right = FootPlace("right", (0.05, -0.11))
    assert asked(live, right, FOREVER).state in ("accepted", "slowed")
    go_on(live, 1.5)
    assert_there(live, right)
    # Kept down where it is, it is at no place of its own any more; both names let it go.
    assert asked(live, Contact("both"), FOREVER).state == "accepted"
    go_on(live, 1.0)
    assert_there(live, right)
    assert asked(live, Relax("both feet")).state == "accepted"
    go_on(live, 1.5)
    assert_beside(live)
    assert asked(live, right, FOREVER).state in ("accepted", "slowed")
    soon = asked(live, Contact("right"), FOREVER)
    assert soon.state in ("accepted", "slowed")
    assert asked(live, Relax("all")).state == "accepted"
    go_on(live, 1.5)
    assert_beside(live)


def test_a_stop_leaves_the_feet_where_they_are_until_something_new_is_asked_for(live: Live) -> None:
    """Once the stop was released the foot stepped back, though nobody had asked for anything."""
    ahead = asked(live, AHEAD, 8.0)
    assert ahead.state == "accepted"
    go_on(live, 1.5)
    live.session.ask(Request.STOP)
    go_on(live, 1.0)
    left = live.newest[ahead.id]
    assert left.held and "the feet stay as they are" in " ".join(left.notes), "the status said that nothing holds"
    assert "release the stop first" in str(asked(live, AHEAD).reason)
    live.session.ask(Request.CLEAR)
    go_on(live, 8.0)
    assert_there(live, AHEAD)
    assert asked(live, Hand("left", (0.12, 0.12, 0.05), in_s=1.0), 1.5).state == "accepted"
    go_on(live, 1.5)
    assert_there(live, AHEAD)
    assert live.newest[ahead.id].held
    assert asked(live, Relax("left foot")).state == "accepted"
    assert live.newest[ahead.id].over == "let go"
    go_on(live, 1.5)
    assert_beside(live)


def test_what_is_let_go_while_a_stop_holds_makes_no_step(live: Live) -> None:
    """A `relax` that was refused for the stop brought the foot back once the stop was released."""
    asked(live, AHEAD, FOREVER)
    go_on(live, 1.5)
    live.session.ask(Request.STOP)
    go_on(live, 1.0)
    assert asked(live, Relax("all")).state == "refused"
    live.session.ask(Request.CLEAR)
    go_on(live, 2.0)
    assert_there(live, AHEAD)


def test_a_foot_does_not_step_back_with_a_leg_whose_torque_is_capped(live: Live) -> None:
    """The end of a foot's target took 2.7 N·m of a knee that had been capped at 1.2 meanwhile."""
    asked(live, AHEAD, 4.0)
    go_on(live, 1.5)
    assert asked(live, TorqueCap("left knee", 1.2), FOREVER).state == "accepted"
    refused = asked(live, Relax("left foot"))
    assert refused.state == "refused" and "l_knee is capped" in str(refused.reason)
    go_on(live, 4.0)  # its time is over
    assert_there(live, AHEAD)
    assert asked(live, Relax("torque left knee")).state == "accepted"
    assert asked(live, Relax("left foot")).state == "accepted"
    go_on(live, 1.5)
    assert_beside(live)


@pytest.mark.parametrize("after_s", [0.1, 0.7])
def test_a_stop_on_the_way_ends_it_with_both_feet_down(live: Live, after_s: float) -> None:
    """A stop left the plan as it was that made the step: the foot lifted half a second after the stop."""
    number = live.session.send(AHEAD, holds_s=FOREVER).id
    go_on(live, after_s)
    live.session.ask(Request.STOP)
    live.until_state(State.HOLD)
    go_on(live, 1.0)
    assert live.told[number].state == "accepted"
    assert live.session.record.ticks.contact_ref[-1].all()
    if after_s > 0.5:
        assert_there(live, AHEAD)
    else:
        assert_beside(live)
    assert np.abs(live.session.record.ticks.tilt).max() < 0.2


def test_a_leg_whose_torque_is_capped_makes_no_step(live: Live) -> None:
    """A step of a robot that follows no human is judged by no cap: it took 3.4 N·m of a knee that was to have 3."""
    assert asked(live, TorqueCap("left knee", 3.0), FOREVER).state == "accepted"
    refused = asked(live, AHEAD, FOREVER)
    assert refused.state == "refused" and "the torque of l_knee is capped: let it go first" in str(refused.reason)
    go_on(live, 1.5)
    assert_beside(live)
    assert asked(live, Relax("torque left knee")).state == "accepted"
    waits = asked(live, FootPlace("left", (0.06, 0.1), in_s=3.0), FOREVER)
    assert waits.state == "accepted"
    assert asked(live, TorqueCap("knee", 3.0), FOREVER).state == "accepted"
    go_on(live, 3.5)
    assert_beside(live)


def test_without_torque_it_is_over(live: Live) -> None:
    assert asked(live, FootPlace("left", (0.11, 0.1)), FOREVER).state == "accepted"
    go_on(live, 1.5)
    live.session.ask(Request.DISARM)
    live.until_state(State.PARK)
    go_on(live, 1.0)
    assert live.session.state.ladder is State.PARK
    assert np.abs(live.session.record.ticks.tilt).max() < 0.5
    notes = [event.message for event in live.session.record.events if event.kind == "note"]
    assert any(note.startswith("over: left foot to [0.11, 0.1] m") for note in notes)


def test_a_new_planner_leaves_the_feet_where_they_are(capped: Restarted) -> None:
    """The first plan of a planner that was started again, for a look of the head, brought the foot back."""
    assert asked(capped, Relax("torque l_el")).state == "accepted"
    ahead = asked(capped, AHEAD, FOREVER)
    assert ahead.state == "accepted"
    go_on(capped, 1.5)
    capped.until_state(State.HOLD)
    capped.restart()
    go_on(capped, 0.5)
    assert asked(capped, Look((1.0, 0.5, 0.0), in_s=0.5)).state == "accepted"
    go_on(capped, 1.5)
    assert_there(capped, AHEAD)
    assert capped.newest[ahead.id].held
