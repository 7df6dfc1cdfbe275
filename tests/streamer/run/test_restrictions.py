"""Feet that stay down and torque caps in a whole run in lockstep: what the robot does, and what is answered."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer import api
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import Offer
from flexmotion.streamer.control.plan_intake import PlanIntake
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import Heard, heard_since
from flexmotion.streamer.motion.intents import Clip, Stop, Text, Velocity
from flexmotion.streamer.motion.part_intents import Hand, Look, Relax
from flexmotion.streamer.motion.restriction_intents import Contact, Tension, TorqueCap
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.planning import part_targets
from flexmotion.streamer.planning.foot_targets import FootTargets
from flexmotion.streamer.planning.part_targets import PartTargets
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.planning.restriction_targets import RestrictionTargets
from flexmotion.streamer.run.parts import RunParts
from flexmotion.streamer.run.requests import Request

from .test_live_targets import Live
from .test_part_targets import asked, go_on, live

__all__ = ["live"]

WALK = Velocity(0.3, 0.0, 0.0)
LEFT, RIGHT = 0, 1
FOREVER = np.inf


def lifts(live: Live, foot: int, since: int) -> bool:
    """Whether the simulated robot's plans have lifted a foot since a tick."""
    return bool((~live.session.record.ticks.contact_ref[since:, foot]).any())


def implied(live: Live, joint: str, since: int) -> float:
    """Greatest torque that the goals of a joint have asked of its servo since a tick [N·m]."""
    robot, ticks = live.session.robot, live.session.record.ticks
    j = robot.index(joint)
    torque = robot.kp[j] * (ticks.q_cmd[since:, j] - ticks.q[since:, j]) - robot.back_emf[j] * ticks.qd[since:, j]
    return float(np.abs(torque).max())


def test_a_robot_that_walks_puts_the_foot_down_and_stands_until_it_may_lift_it_again(live: Live) -> None:
    asked(live, WALK, FOREVER)
    go_on(live, 2.0)
    answer = asked(live, Contact("left"), FOREVER)
    assert answer.state in ("accepted", "slowed") and answer.heard_as == "left foot" and answer.tick is not None
    live.until(lambda: live.session.state.tick > answer.tick, "the foot is down")
    live.until_state(State.HOLD)
    assert not lifts(live, LEFT, answer.tick)
    place = live.session.record.ticks.true_base[-1, :2].copy()
    refused = asked(live, WALK, FOREVER)
    assert refused.state == "refused" and "needs steps: left foot kept down: let it go first" in str(refused.reason)
    go_on(live, 1.0)
    assert np.linalg.norm(live.session.record.ticks.true_base[-1, :2] - place) < 0.005
    assert asked(live, Relax("left foot")).state == "accepted"
    assert asked(live, WALK, FOREVER).state in ("accepted", "slowed")
    go_on(live, 2.0)
    assert live.session.record.ticks.true_base[-1, 0] - place[0] > 0.05
    assert np.abs(live.session.record.ticks.tilt).max() < 0.5


def test_a_walk_that_a_kept_foot_ended_was_followed_until_it_stood(live: Live) -> None:
    """It was told as stopped 2 s later, or as expired; meanwhile the status named the walk as what is followed."""
    walk = live.session.send(WALK, holds_s=3.0)
    live.until_answered(walk.id)
    go_on(live, 1.0)
    again = live.session.send(WALK, holds_s=3.0)  # a stick that is held
    live.until_answered(again.id)
    live.session.send(Contact("both"), holds_s=1.0)
    ticks = live.until(lambda: live.newest[again.id].over is not None, "the end of the walk")
    assert ticks <= 10 and live.session.state.ladder is State.STREAMING
    over = live.newest[again.id]
    assert over.over == "stopped" and str(over.reason).startswith("both feet kept down")
    live.until_state(State.HOLD)
    go_on(live, 3.0)
    assert live.session.state.ladder is State.HOLD and live.newest[walk.id].over is None


def test_a_clip_whose_steps_a_foot_withheld_later_ended_as_made_whole() -> None:
    """The last version of its answer was "accepted" again, and named no steps as left out."""
    one = Live(clips={"walk": default_clip()[195:]})
    with one.session:
        one.until_state(State.STREAMING)
        clip = one.session.send(Clip("walk"))
        assert one.until_answered(clip.id).state == "accepted"
        go_on(one, 1.5)
        one.session.send(Contact("right"), holds_s=2.0)
        one.until(lambda: one.newest[clip.id].steps[-1].end is not None, "the end of the clip")
    last = one.newest[clip.id]
    assert last.steps[-1].end == "done" and (last.state, last.dropped) == ("partly", ("steps",))
    assert last.notes == ("without steps: right foot kept down: let it go first (relax 'right foot')",)


def test_feet_that_both_stay_down_stay_in_their_stride_and_one_that_may_move_comes_beside_the_other(live: Live) -> None:
    asked(live, WALK, FOREVER)
    go_on(live, 2.2)
    answer = asked(live, Contact("both"), FOREVER)
    live.until_state(State.HOLD)
    go_on(live, 1.0)
    ticks = live.session.record.ticks
    feet = ticks.foot_ref[-1]
    assert not lifts(live, LEFT, answer.tick) and not lifts(live, RIGHT, answer.tick)
    assert abs(feet[LEFT, 0] - feet[RIGHT, 0]) > 0.02  # as they landed
    # The right foot may step again; the left one, which a stop moves else, stays where it is.
    assert asked(live, Relax("right foot")).state == "accepted"
    go_on(live, 2.0)
    after = live.session.record.ticks.foot_ref[-1]
    assert np.allclose(after[LEFT], feet[LEFT], atol=1e-6) and abs(after[LEFT, 0] - after[RIGHT, 0]) < 0.02
    assert not lifts(live, LEFT, answer.tick)


def test_gestures_go_on_and_a_motion_that_steps_is_made_on_the_spot(live: Live) -> None:
    assert asked(live, Contact("both"), FOREVER).state == "accepted"
    begin = live.session.state.tick
    assert asked(live, Text("wave with the right hand"), FOREVER).state == "accepted"
    assert asked(live, Hand("left", (0.12, 0.12, 0.05), in_s=1.0)).state == "accepted"
    # The listener of the stub does not know it as a walk: only the motion shows its steps.
    on_the_spot = asked(live, Text("walk forward"), FOREVER)
    assert (on_the_spot.state, on_the_spot.dropped) == ("partly", ("steps",))
    assert on_the_spot.notes == ("without steps: both feet kept down: let them go first (relax 'both feet')",)
    go_on(live, 3.0)
    assert live.session.state.ladder is State.STREAMING
    assert not lifts(live, LEFT, begin) and not lifts(live, RIGHT, begin)
    # What the human has gone meanwhile is not made up for.
    assert asked(live, Relax("both feet")).state == "accepted"
    place = live.session.record.ticks.true_base[-1, 0]
    go_on(live, 1.5)
    assert live.session.record.ticks.true_base[-1, 0] - place < 0.2


def test_a_foot_is_let_go_when_its_time_is_over_and_by_words(live: Live) -> None:
    assert asked(live, Contact("both"), 1.0).state == "accepted"
    assert asked(live, WALK).state == "refused"
    go_on(live, 1.2)
    assert asked(live, WALK).state in ("accepted", "slowed")
    kept = asked(live, Text("keep your left foot down"), FOREVER)
    assert (kept.heard_as, kept.asked) == ("left foot", "keep your left foot down")
    assert asked(live, WALK).state == "refused"
    assert asked(live, Text("you may lift your feet again"), FOREVER).heard_as == "relax"
    assert asked(live, WALK).state in ("accepted", "slowed")
    assert "asked for nothing; nothing holds" in str(asked(live, Relax("left foot")).reason)
    assert asked(live, Look((1.0, 0.5, 0.0)), FOREVER).state == "accepted"
    for part in ("left foot", "head place", "left hand", "torque l_knee"):
        assert "is asked for nothing; expected all, or one of: head" in str(asked(live, Relax(part)).reason)


def test_goals_of_an_arm_ask_for_no_more_than_its_cap_and_its_path_is_laid_out_for_it(live: Live) -> None:
    there = Hand("left", (0.12, 0.12, 0.05), in_s=0.3)
    begin = live.session.state.tick
    free = asked(live, there, 2.0)
    go_on(live, 4.0)
    assert implied(live, "l_el", begin) > 0.6
    for part in ("left elbow", "left shoulder"):
        assert asked(live, TorqueCap(part, 0.4), FOREVER).state == "accepted"
    begin = live.session.state.tick
    capped = asked(live, there, 3.0)
    assert capped.state == "slowed" and "s until it is there" in str(capped.slowed) and capped.slowed != free.slowed
    go_on(live, 5.0)
    for joint in ("l_el", "l_sho_pitch", "l_sho_roll"):
        assert implied(live, joint, begin) <= 0.4 + 1e-6
    robot, ticks = live.session.robot, live.session.record.ticks
    assert np.abs(ticks.torque_ref[begin:, robot.index("l_el")]).max() <= 0.45


def test_a_hand_that_needs_more_than_a_cap_to_stay_there_is_refused(live: Live) -> None:
    assert asked(live, TorqueCap("right shoulder", 0.05), FOREVER).state == "accepted"
    refused = asked(live, Hand("right", (0.0, -0.3, 0.1), in_s=1.0, tolerance=0.2))
    assert refused.state == "refused" and "N·m to stay there, its cap is 0.05 N·m" in str(refused.reason)
    assert asked(live, Relax("torque right shoulder")).state == "accepted"
    assert asked(live, Hand("right", (0.0, -0.3, 0.1), in_s=1.0, tolerance=0.2)).state == "moved"
    held = asked(live, TorqueCap("right shoulder", 0.05), FOREVER)
    assert held.state == "refused" and "where the robot stands" in str(held.reason)


def test_a_cap_below_what_standing_needs_is_refused_and_a_walk_beyond_one_is_not_begun(live: Live) -> None:
    refused = asked(live, TorqueCap("knee", 0.4), FOREVER)
    assert refused.state == "refused" and "l_knee needs 0.57 N·m where the robot stands" in str(refused.reason)
    assert "'nose' is not known; expected hip, knee, ankle," in str(asked(live, TorqueCap("nose", 1.0)).reason)
    assert asked(live, Text("no more than 1 newton metre at the knee"), FOREVER).heard_as == "torque knee"
    begin = live.session.state.tick
    answers = live.session.heard_channel.reader()
    walk = live.session.send(WALK)
    live.session.advance(4.0)
    # It was slowed until its first step, and refused where that came into sight: the later version counts.
    refused = [heard for heard in heard_since(answers) if heard.id == walk.id][-1]
    assert refused.state == "refused" and "knee needs" in str(refused.reason)
    assert "its cap is 1 N·m" in str(refused.reason)
    assert live.session.state.ladder is State.HOLD
    assert not lifts(live, LEFT, begin) and not lifts(live, RIGHT, begin)
    robot, ticks = live.session.robot, live.session.record.ticks
    assert np.abs(ticks.torque_ref[begin:, robot.index("l_knee")]).max() <= 1.0


def test_a_walk_that_a_cap_refused_is_not_walked_once_the_cap_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was, where the loop had refused the first plan that said so: it came too late, as on a busy machine."""
    robot, acceptable = load_robot("op3"), PlanIntake._acceptable
    walks, refused = list[int](), list[int]()

    def late(intake: PlanIntake, offer: Offer, *arguments: Any, **known: Any) -> bool:
        if offer.ticket.target in walks and not refused:
            refused.append(offer.ticket.target)
            return False
        return acceptable(intake, offer, *arguments, **known)

    monkeypatch.setattr(PlanIntake, "_acceptable", late)
    with api.open_session(robot, "sim", api.open_source(robot, Text("stand still"), seed=1), seed=1) as session:
        session.advance(5.0)
        session.send(TorqueCap("knee", 1.5), holds_s=FOREVER)
        session.advance(1.0)
        walks.append(session.send(Text("walk half a metre")).id)
        begin = session.record.ticks.odometry[-1, :2].copy()
        session.advance(1.0)
        session.send(Relax("torque knee"))
        session.advance(3.0)
        assert refused == walks
        assert np.linalg.norm(session.record.ticks.odometry[-1, :2] - begin) < 0.02
        assert session.state.ladder is State.HOLD
        (answer,) = (heard for heard in session.heard if heard.id in walks)
        assert answer.state == "refused" and "however it is eased" in str(answer.reason)


def test_restrictions_hold_through_a_stop_and_end_without_torque_or_with_all(live: Live) -> None:
    asked(live, Contact("left"), FOREVER)
    live.session.ask(Request.STOP)
    assert "release the stop first" in str(asked(live, Contact("right"), FOREVER).reason)
    live.session.ask(Request.CLEAR)
    go_on(live, 0.5)
    assert asked(live, WALK).state == "refused"
    assert asked(live, Relax()).state == "accepted"
    assert asked(live, WALK).state in ("accepted", "slowed")


def test_the_newest_cap_of_a_joint_counts(live: Live) -> None:
    first = live.session.send(TorqueCap("elbow", 0.5))
    second = live.session.send(TorqueCap("elbow", 0.4))
    assert live.until_answered(first.id).state == "superseded"
    assert live.until_answered(second.id).state == "accepted"
    asked(live, TorqueCap("l_el", 2.0), FOREVER)
    begin = live.session.state.tick
    asked(live, Hand("left", (0.12, 0.12, 0.05), in_s=0.3))
    asked(live, Hand("right", (0.12, -0.12, 0.05), in_s=0.3))
    go_on(live, 2.0)
    assert implied(live, "l_el", begin) > 0.5
    assert implied(live, "r_el", begin) == pytest.approx(0.4, abs=0.1)


def test_an_arm_is_as_soft_as_asked_until_it_is_let_go_and_the_newest_tension_counts(live: Live) -> None:
    robot = live.session.robot
    left, head = list(robot.chain("left_arm").values()), list(robot.chain("head").values())
    least = robot.config.least_stiffness

    def shares(joints: list[int]) -> Any:
        return live.session.record.ticks.stiffness[-1, joints]

    answer = asked(live, Tension("both arms", 0.0), FOREVER)
    assert (answer.state, answer.heard_as) == ("accepted", "tension both arms")
    assert asked(live, Text("stiffen your head"), FOREVER).heard_as == "tension head"
    go_on(live, 1.5)
    np.testing.assert_allclose(shares(left), least, atol=0.02)
    np.testing.assert_allclose(shares(head), 1.0, atol=0.02)
    assert asked(live, Tension("left arm", 1.0), FOREVER).state == "accepted"
    go_on(live, 1.5)
    np.testing.assert_allclose(shares(left), 1.0, atol=0.02)
    assert asked(live, Hand("right", (0.12, -0.12, 0.05), in_s=0.5)).state in ("accepted", "moved", "slowed")
    go_on(live, 1.5)
    right = list(robot.chain("right_arm").values())
    np.testing.assert_allclose(shares(right), least, atol=0.02, err_msg="also on the way to a target of its own")
    refused = asked(live, Relax("tension nose"))
    assert "expected one of: left arm, right arm, both arms, head; found 'nose'" in str(refused.reason)
    assert asked(live, Relax("tension both arms")).state == "accepted"
    assert "one of: tension head" in str(asked(live, Relax("tension left arm")).reason)


def test_a_stop_right_after_a_newer_tension_leaves_the_arms_as_soft_as_they_were(live: Live) -> None:
    """The newer one was not answered yet, and the older one had been dropped for it: the arms became stiff."""
    robot = live.session.robot
    arms = [joint for side in ("left", "right") for joint in robot.chain(f"{side}_arm").values()]
    assert asked(live, Tension("both arms", 0.2), FOREVER).state == "accepted"
    assert asked(live, TorqueCap("elbow", 0.5), FOREVER).state == "accepted"
    go_on(live, 1.5)
    before = live.session.record.ticks.stiffness[-1, arms]
    assert asked(live, Tension("head", 0.0), FOREVER).state == "accepted"  # the next plan waits for a tenth of a second
    newer = [
        live.session.send(intent).id
        for intent in (Tension("left arm", 0.0), Tension("both arms", 0.0), TorqueCap("elbow", 3.0))
    ]
    live.session.advance(2 / robot.rate_hz)
    live.session.ask(Request.STOP)
    go_on(live, 1.5)
    assert [live.told[number].state for number in newer] == ["superseded", "refused", "refused"]
    np.testing.assert_allclose(live.session.record.ticks.stiffness[-1, arms], before, atol=0.02)
    live.session.ask(Request.CLEAR)
    go_on(live, 0.5)
    assert np.isfinite(live.session.record.ticks.q_cmd[-1]).all()
    assert "one of: tension head, tension both arms, torque elbow" in str(asked(live, Relax("torque knee")).reason)


def test_a_soft_arm_is_stiff_again_after_its_time_and_in_the_park(live: Live) -> None:
    robot = live.session.robot
    left = list(robot.chain("left_arm").values())
    assert asked(live, Tension("left arm", 0.0), 1.0).state == "accepted"
    live.session.ask(Request.STOP)
    go_on(live, 0.8)
    assert (live.session.record.ticks.stiffness[-1, left] < 0.5).all(), "a stop does not end it"
    live.session.ask(Request.CLEAR)
    go_on(live, 1.5)
    np.testing.assert_allclose(live.session.record.ticks.stiffness[-1, left], 1.0, atol=0.02)
    assert asked(live, Tension("left arm", 0.0), FOREVER).state == "accepted"
    go_on(live, 1.0)
    live.session.ask(Request.DISARM)
    live.until_state(State.PARK)
    go_on(live, 0.5)
    np.testing.assert_array_equal(live.session.record.ticks.stiffness[-1, left], 1.0)


def test_a_soft_arm_gives_way_to_a_hand_and_comes_back(live: Live) -> None:
    """Held by 4 N, which a stiff arm bears, it was called blocked: the robot froze, and parked."""
    robot, driver = live.session.robot, live.session.driver
    assert isinstance(driver, SimDriver)
    shoulder = robot.index("l_sho_pitch")
    assert asked(live, Tension("both arms", 0.0), FOREVER).state == "accepted"
    live.until_answered(live.session.send(Stop()).id)
    live.until_state(State.HOLD)
    go_on(live, 1.0)
    before = live.session.record.ticks.q[-1, shoulder]
    forearm = driver.model.jnt_bodyid[driver.model.joint("l_el").id]
    driver.data.xfrc_applied[forearm, 0] = 4.0
    go_on(live, 2.0)
    assert np.degrees(abs(live.session.record.ticks.q[-1, shoulder] - before)) > 5.0
    driver.data.xfrc_applied[forearm, 0] = 0.0
    go_on(live, 1.0)
    assert live.session.state.ladder is State.HOLD
    assert np.degrees(abs(live.session.record.ticks.q[-1, shoulder] - before)) < 1.0


def test_a_hand_that_is_held_away_has_missed_its_place(live: Live, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was told as done once its time had come, wherever the arm was.

    What moves it by more than the least tolerance is called blocked, and parks the robot: here that is none.
    """
    monkeypatch.setattr(part_targets, "LEAST_M", 0.0)
    driver = live.session.driver
    assert isinstance(driver, SimDriver)
    assert asked(live, Tension("both arms", 0.0), FOREVER).state == "accepted"
    driver.data.xfrc_applied[driver.model.jnt_bodyid[driver.model.joint("l_el").id], 0] = 4.0
    answer = asked(live, Hand("left", (0.12, 0.12, 0.05), in_s=1.0, tolerance=0.001), FOREVER)
    live.until(lambda: live.newest[answer.id].missed, "its time to be over")
    newest = live.newest[answer.id]
    assert newest.there is None and newest.over is None and newest.held
    assert float(str(newest.missed).split(" cm")[0]) > 0.3
    assert live.session.state.ladder is not State.PARK


def test_what_a_stop_refuses_right_after_its_plan_was_made_holds_nothing(live: Live) -> None:
    """A hand and a STOP in one moment: the refusal named the tick of a plan that was never played."""
    sent = live.session.send(Hand("left", (0.12, 0.12, 0.05), in_s=1.0))
    live.session.ask(Request.STOP)
    answer = live.until_answered(sent.id)
    assert answer.state == "refused" and answer.tick is None and not answer.held
    assert live.session.heard_channel.held == []


def test_servos_that_are_read_in_turns_are_not_softened(live: Live) -> None:
    """It was accepted, and had no effect: who touches such an arm believes it to be soft."""
    retargeter, told = Retargeter(live.session.robot, load_stream()), list[Heard]()
    targets = RestrictionTargets(retargeter, told.append, lambda _: None, lambda _: None, turns=3)
    target = live.session.send(Tension("both arms", 0.0))
    targets.take(target, 0.0)
    row = TickRow(live.session.telemetry.ticks.latest())
    targets.update(row, 0.0, 0.0, np.zeros(retargeter.body.upper.joints.size))
    assert told[0].state == "refused" and "read in turns, each every 3 ticks" in str(told[0].reason)


def test_a_robot_of_one_stiffness_refuses_a_tension(live: Live) -> None:
    robot = live.session.robot
    robot.config = robot.config.model_copy(update={"least_stiffness": 1.0})
    refused = asked(live, Tension("left arm", 0.5))
    assert refused.state == "refused" and "op3 has one stiffness" in str(refused.reason)


def test_what_is_let_go_right_after_it_was_asked_does_not_hold(live: Live) -> None:
    """Both read for one plan, the foot was kept down without end after "relax all" was accepted."""
    target = live.session.send(Contact("left"))
    assert asked(live, Relax()).state == "accepted"
    assert live.told[target.id].state == "superseded"
    assert asked(live, WALK, FOREVER).state in ("accepted", "slowed")


def test_all_that_is_let_go_too_late_holds(capped: Restarted) -> None:
    """The answer was "expired", and the cap was lifted all the same."""
    ledger = capped.replanner.ledger
    late = Target(1000, 0, Relax(), take_up_s=0.5)
    ledger.on_part(late, ledger.now_s() - 1.0)
    go_on(capped, 0.5)
    assert capped.told[late.id].state == "expired" and capped.cap == pytest.approx(0.4)


RESTARTED = "until the next target: left foot, torque l_el: the planner was started again"


class Restarted(Live):
    """A run whose control loop the test sees."""

    loop: ControlLoop
    replanner: Replanner

    def restart(self) -> None:
        """Go on as a planner in a new process: its records are empty."""
        new = self.replanner
        retargeter = new.planner.retargeter
        new.restrictions = RestrictionTargets(retargeter, new._publish, new.on_note, new._stand_still)
        new.parts = PartTargets(retargeter, new._publish, new.on_note)
        new.feet = FootTargets(retargeter, new._publish, new.on_note)
        new.succeed()

    @property
    def cap(self) -> float:
        """Of the left elbow, in the loop [N·m]."""
        return float(self.loop.servo.cap[self.loop.robot.index("l_el")])

    @property
    def notes(self) -> list[str]:
        return [event.message for event in self.session.record.events if event.kind == "note"]


@pytest.fixture
def capped(monkeypatch: pytest.MonkeyPatch) -> Iterator[Restarted]:
    """A robot that stands, its left elbow capped."""
    make, make_loop, one = RunParts.replanner, RunParts.control_loop, Restarted()

    def kept(*arguments: Any) -> Replanner:
        one.replanner = make(*arguments)
        return one.replanner

    def seen(*arguments: Any) -> ControlLoop:
        one.loop = make_loop(*arguments)
        return one.loop

    monkeypatch.setattr(RunParts, "replanner", kept)
    monkeypatch.setattr(RunParts, "control_loop", seen)
    with one.session:
        one.until_state(State.STREAMING)
        one.until_answered(one.session.send(Stop()).id)
        one.until_state(State.HOLD)
        assert asked(one, TorqueCap("l_el", 0.4), FOREVER).state == "accepted"
        one.until_state(State.HOLD)
        yield one


@pytest.fixture
def restarted(capped: Restarted) -> Restarted:
    """A robot that stands, its left foot kept down and its left elbow capped, with a planner that was started again."""
    assert asked(capped, Contact("left"), FOREVER).state == "accepted"
    capped.until_state(State.HOLD)
    capped.restart()
    go_on(capped, 0.5)
    return capped


def test_what_a_restriction_still_binds_is_told_and_how_it_ended(capped: Restarted) -> None:
    """One foot of two was let go, and the status went on to name both."""
    both = asked(capped, Contact("both"), FOREVER)
    assert both.holds == "restriction" and both.heard_as == "both feet"
    asked(capped, Relax("left foot"))
    assert (capped.newest[both.id].heard_as, capped.newest[both.id].over) == ("right foot", None)
    newer = asked(capped, Contact("right"), 1.0)
    assert capped.newest[both.id].over == "superseded"
    capped.until(lambda: capped.newest[newer.id].over, "its time to be over")
    assert capped.newest[newer.id].over == "expired"
    arms = asked(capped, Tension("both arms", 0.2), FOREVER)
    capped.session.ask(Request.STOP)
    go_on(capped, 0.5)
    assert capped.newest[arms.id].over is None, "a stop ends no restriction"
    capped.session.ask(Request.DISARM)
    capped.until_state(State.PARK)
    go_on(capped, 0.1)
    assert capped.newest[arms.id].over == "stopped"


def test_a_new_planner_tells_how_what_held_ended(capped: Restarted) -> None:
    cap = max(capped.told.values(), key=lambda one: one.id)
    look = asked(capped, Look((1.0, 0.5, 0.0)), FOREVER)
    capped.until_state(State.HOLD)
    capped.restart()
    go_on(capped, 0.5)
    assert capped.newest[look.id].over == "stopped"
    assert capped.newest[cap.id].over is None, "the loop caps on until the next plan"
    asked(capped, Look((1.0, 0.0, 0.0)))
    go_on(capped, 0.3)
    assert capped.newest[cap.id].over == "stopped"


def test_a_new_planner_tells_that_caps_are_over_when_the_loop_has_lifted_them(restarted: Restarted) -> None:
    """They were over for the planner, whose note said so, while the loop capped on until the next plan."""
    assert restarted.notes[-1] == RESTARTED
    assert restarted.cap == pytest.approx(0.4), "nothing gets stronger by itself"
    go_on(restarted, 1.0)
    assert restarted.notes[-1] == RESTARTED and restarted.session.state.ladder is State.HOLD
    assert asked(restarted, Look((1.0, 0.5, 0.0), in_s=0.5)).state == "accepted"
    go_on(restarted, 0.3)
    assert restarted.notes[-1] == "over: left foot, torque l_el"
    assert restarted.cap == np.inf


@pytest.mark.parametrize("part", ["torque l_el", "left foot", "all"])
def test_what_a_new_planner_has_inherited_can_be_let_go(restarted: Restarted, part: str) -> None:
    """It was refused as asked for nothing, while the elbow was capped."""
    refused = asked(restarted, Relax("torque r_el"))
    assert refused.state == "refused" and "one of: left foot, torque l_el" in str(refused.reason)
    assert asked(restarted, Relax(part)).state == "accepted"
    go_on(restarted, 0.4)
    assert restarted.notes[-1] == "over: left foot, torque l_el" and restarted.cap == np.inf


def test_a_new_planner_leaves_an_arm_as_soft_as_it_is_until_the_next_target(capped: Restarted) -> None:
    assert asked(capped, Tension("right arm", 0.0), FOREVER).state == "accepted"
    go_on(capped, 1.0)
    capped.until_state(State.HOLD)
    capped.restart()
    go_on(capped, 1.0)
    words = "torque l_el, tension right arm"
    assert capped.notes[-1] == f"until the next target: {words}: the planner was started again"
    robot = capped.session.robot
    right = list(robot.chain("right_arm").values())
    soft = capped.session.record.ticks.stiffness[-1, right]
    np.testing.assert_allclose(soft, robot.config.least_stiffness, atol=0.02)
    assert asked(capped, Relax("tension right arm")).state == "accepted"
    go_on(capped, 1.0)
    assert capped.notes[-1] == f"over: {words}"
    np.testing.assert_allclose(capped.session.record.ticks.stiffness[-1, right], 1.0, atol=0.02)


def test_parking_ends_what_a_new_planner_has_inherited(restarted: Restarted) -> None:
    restarted.session.ask(Request.DISARM)
    restarted.until_state(State.PARK)
    go_on(restarted, 0.3)
    assert restarted.notes[-1] == "over: left foot, torque l_el" and restarted.cap == np.inf


def test_a_relax_that_a_new_planner_refuses_lifts_no_cap(capped: Restarted) -> None:
    """It was refused while the robot came to a stand, and the elbow got stronger once it stood."""
    assert asked(capped, WALK, FOREVER).state in ("accepted", "slowed")
    go_on(capped, 1.0)
    capped.restart()
    refused = asked(capped, Relax())
    assert refused.state == "refused" and "does not stand yet" in str(refused.reason)
    capped.until_state(State.HOLD)
    go_on(capped, 1.0)
    assert capped.notes[-1] == "until the next target: torque l_el: the planner was started again"
    assert capped.cap == pytest.approx(0.4) and capped.session.state.ladder is State.HOLD


def test_a_hand_whose_time_is_over_ends_no_cap_that_a_new_planner_has_inherited(capped: Restarted) -> None:
    """The planner made a plan for the way back of a hand that it knew nothing of: nobody asked, and the cap ended."""
    there = Hand("right", (0.12, -0.12, 0.05), in_s=1.0)
    assert asked(capped, there, 3.0).state == "accepted"
    go_on(capped, 1.2)
    capped.until_state(State.HOLD)
    capped.restart()
    go_on(capped, 4.0)
    assert capped.notes[-1] == "until the next target: torque l_el: the planner was started again"
    assert capped.cap == pytest.approx(0.4) and capped.session.state.ladder is State.HOLD
    assert asked(capped, Look((1.0, 0.5, 0.0), in_s=0.5)).state == "accepted"
    go_on(capped, 0.3)
    assert capped.notes[-1] == "over: torque l_el" and capped.cap == np.inf


def test_a_new_planner_tells_when_caps_of_legs_are_over(capped: Restarted) -> None:
    """They ended over the restart of the planner without a note: the plan carried those of arms and head alone."""
    assert asked(capped, TorqueCap("l_knee", 1.0), FOREVER).state == "accepted"
    capped.until_state(State.HOLD)
    capped.restart()
    go_on(capped, 0.5)
    assert capped.notes[-1] == "until the next target: torque l_el, torque l_knee: the planner was started again"
    assert asked(capped, Relax("torque l_knee")).state == "accepted"
    go_on(capped, 0.4)
    assert capped.notes[-1] == "over: torque l_el, torque l_knee"
