"""Torque goes on by an explicit arm alone, and after a fault only by way of CLEAR and OFF."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.streamer.control.ladder import POWERED, State
from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.motion.intents import Text, Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.planning.made_plans import MadePlans
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run.parts import RunParts
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ..stub_sampler import StubSampler

TURN = Velocity(0.0, 0.0, 0.3)
MOST_S = 20.0
"""Bound against hanging [s of the robot]."""


class Attended:
    """A run that an operator attends: it waits to be armed, and goes on after a fault."""

    def __init__(self, **options: object) -> None:
        robot = load_robot("op3")
        source = ModelSource(StubSampler(), [Item(0.0, Text("stand"))], "model:stub")  # type: ignore[arg-type]
        driver = create("sim", robot, seed=0, **options)
        self.session = Session(robot, driver, source, load_stream(), stay=True, armed=False, attended=True)

    def until(self, happens: Callable[[], object], what: str) -> None:
        for _ in range(int(MOST_S * 125)):
            if happens():
                return
            assert self.session.step(), f"the run ended before {what}"
        raise AssertionError(f"waited {MOST_S:g} s of the robot for {what}")

    def until_state(self, state: State) -> None:
        self.until(lambda: self.session.state.ladder is state, state.name)

    def answer(self, target: int) -> Heard:
        self.until(lambda: any(heard.id == target for heard in self.session.heard), "an answer")
        return next(heard for heard in self.session.heard if heard.id == target)

    def messages(self, kind: str) -> list[str]:
        return [event.message for event in self.session.record.events if event.kind == kind]

    def ask(self, request: Request) -> None:
        self.session.ask(request)
        self.session.advance(0.1)


def test_without_a_planner_the_robot_is_not_stood_up() -> None:
    """The planner was given up after three restarts, and ARM stood the robot up for targets that nobody followed."""
    run = Attended()
    with run.session:
        run.session.requests.send(Request.GIVEN_UP, "the planner died; it was started 3 times again, no more")
        run.ask(Request.ARM)
        assert run.session.state.ladder is State.OFF
        assert run.messages("refused") == [
            "ARM: there is no planner: the planner died; it was started 3 times again, no more; "
            "end the run and start it again"
        ]
        assert run.messages("fault") == ["the planner died; it was started 3 times again, no more"]


def test_nothing_moves_before_the_robot_is_armed_and_targets_are_told_why() -> None:
    """A robot stood up as soon as its program was started."""
    run = Attended()
    with run.session as session:
        session.advance(1.0)
        assert session.state.ladder is State.OFF and np.isnan(session.state.q_cmd).all()
        refused = run.answer(session.send(TURN).id)
        assert refused.state == "refused" and "arm the robot first" in str(refused.reason)
        run.ask(Request.ARM)
        run.until_state(State.HOLD)
        assert run.answer(session.send(TURN).id).state == "accepted"
        run.ask(Request.ARM)
        (told,) = run.messages("refused")
        assert told.startswith("ARM: torque is on, the robot is in")
        session.finish()
    assert session.record.state[-1] == State.OFF and not run.messages("fault")


def test_after_an_emergency_stop_clear_leads_to_off_and_arm_from_there_back_to_a_stand() -> None:
    """The run ended with an emergency stop; the program had to be started again. The parked robot tipped over."""
    run = Attended()
    with run.session as session:
        run.ask(Request.ARM)
        run.until_state(State.HOLD)
        session.send(TURN)
        session.advance(1.5)
        run.ask(Request.ESTOP)
        run.ask(Request.CLEAR)
        assert run.messages("refused")[-1] == "CLEAR: the robot is still in HOLD, on its way to FAULT"
        run.until_state(State.FAULT)
        run.ask(Request.ARM)
        assert "a fault is latched: e-stop" in run.messages("refused")[-1] and session.state.ladder is State.FAULT
        refused = run.answer(session.send(TURN).id)
        assert refused.state == "refused" and "clear the fault, then arm" in str(refused.reason)
        run.ask(Request.CLEAR)
        session.advance(6.0)
        assert session.state.ladder is State.OFF, "CLEAR alone switches no torque on"
        run.ask(Request.ARM)
        run.until(lambda: session.telemetry.ticks.latest()["ready"], "the robot to stand")
        session.advance(1.0)
        assert session.state.ladder is State.READY, "what was asked before does not go on"
        accepted = run.answer(session.send(TURN).id)
        assert accepted.state == "accepted"
        session.advance(1.0)
        assert session.state.ladder is State.STREAMING
        session.finish()
    on = [state in POWERED for state in map(State, session.record.state)]
    assert on[-1] is False and session.record.violations_sent == 0


def test_a_robot_that_lies_is_not_armed() -> None:
    run = Attended()
    with run.session as session:
        run.ask(Request.ARM)
        run.until_state(State.HOLD)
        run.ask(Request.KILL)
        session.advance(4.0)
        assert session.state.ladder is State.FAULT
        run.ask(Request.CLEAR)
        assert session.state.ladder is State.OFF
        run.ask(Request.ARM)
        assert session.state.ladder is State.OFF
        assert run.messages("refused")[-1].startswith("ARM: the torso is tilted by")
        run.session.ask(Request.END)
        assert not session.advance(0.1), "a run whose torque is off ends at once"


def test_a_robot_that_is_disarmed_parks_and_the_run_goes_on() -> None:
    run = Attended()
    with run.session as session:
        run.ask(Request.ARM)
        run.until_state(State.HOLD)
        session.send(TURN)
        session.advance(1.0)
        run.ask(Request.DISARM)
        refused = run.answer(session.send(TURN).id)
        assert refused.state == "refused"
        run.until_state(State.PARK)
        run.until_state(State.OFF)
        assert session.advance(1.0) and not run.messages("fault")


def test_a_run_that_nobody_attends_ends_with_its_fault() -> None:
    run = Attended()
    run.session.armed, run.session.attended = True, False
    with run.session as session:
        run.until_state(State.HOLD)
        session.ask(Request.ESTOP)
        while session.step():
            pass
        assert session.state.ladder is State.FAULT


@pytest.mark.parametrize("asked", [Request.STOP, Request.ESTOP])
def test_a_stop_before_the_start_leaves_torque_off_and_does_not_end_an_attended_run(asked: Request) -> None:
    run = Attended()
    run.session.armed = True
    with run.session as session:
        session.ask(asked)
        assert session.advance(0.5)
        assert session.state.ladder is (State.OFF if asked is Request.STOP else State.FAULT)
        run.ask(Request.CLEAR)
        run.ask(Request.ARM)
        assert session.state.ladder is State.READY and not run.messages("refused")


@pytest.mark.parametrize("asked", [Request.STOP, Request.ESTOP])
@pytest.mark.parametrize("state", [State.OFF, State.PARK])
def test_a_stop_without_torque_holds_until_it_is_cleared(state: State, asked: Request) -> None:
    """It was accepted and latched nothing: the next ARM stood the robot up, which followed targets without a CLEAR."""
    run = Attended()
    with run.session as session:
        if state is State.PARK:
            run.ask(Request.ARM)
            run.until_state(State.HOLD)
            run.ask(Request.DISARM)
            run.until_state(State.PARK)
        run.ask(asked)
        run.until_state(State.OFF if asked is Request.STOP else State.FAULT)
        run.ask(Request.ARM)
        assert session.state.ladder is (State.OFF if asked is Request.STOP else State.FAULT)
        assert run.messages("refused")[-1].endswith("clear it first")
        refused = run.answer(session.send(TURN).id)
        wanted = "release the stop" if asked is Request.STOP else "clear the fault"
        assert refused.state == "refused" and wanted in str(refused.reason) and "arm" in str(refused.reason)
        run.ask(Request.CLEAR)
        assert session.state.ladder is State.OFF and not session.telemetry.ticks.latest()["must_stop"]
        run.ask(Request.ARM)
        run.until(lambda: session.telemetry.ticks.latest()["ready"], "the robot to stand")
        session.advance(1.0)
        assert session.state.ladder is State.READY, "what the run was started with does not begin after a stop"
        assert run.answer(session.send(TURN).id).state == "accepted"
        session.finish()


def test_there_is_nothing_to_clear_without_torque_and_without_a_stop() -> None:
    """A CLEAR in OFF was refused with what it does once the robot stands, which it does not."""
    run = Attended()
    with run.session as session:
        session.advance(0.1)
        run.ask(Request.CLEAR)
        (told,) = run.messages("refused")
        assert told == "CLEAR: the torque is off, and no stop is in force: there is nothing to clear"


def test_a_run_of_which_the_time_is_over_is_cleared_all_the_same() -> None:
    """With `--seconds` over, a CLEAR after a fault was answered as without effect, and the status told of a stop."""
    run = Attended()
    run.session.seconds = 1.0
    with run.session as session:
        run.ask(Request.ARM)
        run.until_state(State.STREAMING)
        session.advance(3.0)
        assert session.telemetry.ticks.latest()["must_stop"]
        run.ask(Request.ESTOP)
        run.until_state(State.FAULT)
        run.ask(Request.CLEAR)
        assert session.state.ladder is State.OFF and not session.telemetry.ticks.latest()["must_stop"]


def test_while_a_joint_is_limp_the_robot_stands_and_says_why() -> None:
    run = Attended()
    with run.session as session:
        requests = session.requests
        run.ask(Request.ARM)
        run.until_state(State.HOLD)
        requests.send(Request.LIMP, "l_el,head_pan")
        session.advance(0.1)
        assert run.messages("request")[-1] == "LIMP l_el,head_pan" and not run.messages("refused")
        refused = run.answer(session.send(TURN).id)
        assert refused.state == "refused" and "without torque on request" in str(refused.reason)
        run.ask(Request.CLEAR)
        told = "CLEAR: without torque on request: head_pan, l_el; make them stiff first"
        assert run.messages("refused") == [told] and session.state.ladder is State.HOLD
        requests.send(Request.STIFF, "l_el,head_pan")
        session.advance(0.1)
        assert run.answer(session.send(TURN).id).state == "accepted"
        session.advance(1.0)
        assert session.state.ladder is State.STREAMING
        requests.send(Request.LIMP, "l_el")
        session.advance(0.1)
        assert run.messages("refused")[-1] == (
            "LIMP l_el: in STREAMING the robot moves: let it come to a stand first (hold)"
        )
        session.finish()
    assert not run.messages("fault") and session.record.violations_sent == 0
    assert session.record.rows["limp"].any(axis=0).sum() == 2


def test_what_a_stop_of_its_own_tick_overrides_is_answered_at_once() -> None:
    """ARM and CLEAR beside a STOP had neither an effect nor an event; the answer was a timeout."""
    run = Attended()
    with run.session as session:
        session.advance(0.1)
        session.requests.send(Request.STOP, "zenoh")
        session.requests.send(Request.ARM, "page: arm")
        session.advance(0.1)
        assert session.state.ladder is State.OFF
        session.requests.send(Request.CLEAR, "page: clear")
        session.requests.send(Request.STOP, "zenoh")
        session.advance(0.1)
        run.ask(Request.CLEAR)
        run.ask(Request.ARM)
        run.until(lambda: session.telemetry.ticks.latest()["ready"], "the robot to stand")
        run.ask(Request.STOP)
        session.requests.send(Request.CLEAR, "page: clear")
        session.requests.send(Request.STOP)
        session.advance(0.1)
        assert session.telemetry.ticks.latest()["must_stop"]
        session.requests.send(Request.ESTOP)
        session.advance(0.1)
        run.until_state(State.FAULT)
        session.requests.send(Request.CLEAR)
        session.requests.send(Request.KILL, "gamepad")
        session.advance(0.1)
        assert session.state.ladder is State.FAULT
    assert run.messages("refused") == [
        "ARM: overridden in its own tick by STOP from zenoh",
        "CLEAR: overridden in its own tick by STOP from zenoh",
        "CLEAR: overridden in its own tick by STOP",
        "CLEAR: overridden in its own tick by KILL from gamepad",
    ]


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Replanner]:
    """The replanners of the runs that follow."""
    made: list[Replanner] = []
    make = RunParts.replanner

    def kept(*arguments: Any) -> Replanner:
        made.append(make(*arguments))
        return made[-1]

    monkeypatch.setattr(RunParts, "replanner", kept)
    return made


def test_a_planner_that_died_before_the_first_plan_leaves_a_run_that_begins_nothing_by_itself(
    made: list[Replanner],
) -> None:
    """No plan was made yet: the planner that was started again did what the run was started with, after a stop too."""
    run = Attended()
    with run.session as session:
        session.advance(0.1)
        (replanner,) = made
        replanner.succeed()
        run.ask(Request.ARM)
        run.until(lambda: session.telemetry.ticks.latest()["ready"], "the robot to stand")
        session.advance(1.0)
        assert session.state.ladder is State.READY
        assert run.answer(session.send(TURN).id).state == "accepted"
        session.finish()


def test_a_planner_that_died_while_its_first_plan_waited_follows_targets_again(made: list[Replanner]) -> None:
    """Its successor knew no plan, and the loop played one: it made none ever after, and every target expired."""
    run = Attended()
    with run.session as session:
        latest = session.telemetry.ticks.latest
        run.ask(Request.ARM)
        run.until(lambda: latest()["pending"] and not latest()["plan"], "the first plan to wait")
        (replanner,) = made
        replanner.made = MadePlans(5)  # as in a new process
        replanner.succeed()
        run.until_state(State.HOLD)
        session.advance(0.1)
        assert run.answer(session.send(TURN).id).state == "accepted"
        run.until_state(State.STREAMING)
        session.finish()


def test_after_a_fault_a_planner_that_was_started_again_begins_nothing_by_itself(made: list[Replanner]) -> None:
    """Started again in FAULT, it planned what the run was started with as soon as the robot was armed and stood."""
    run = Attended()
    with run.session as session:
        run.ask(Request.ARM)
        run.until_state(State.HOLD)
        run.ask(Request.ESTOP)
        run.until_state(State.FAULT)
        (replanner,) = made
        replanner.ledger.halted = None  # as in a new process
        replanner.succeed()
        session.advance(0.5)
        run.ask(Request.CLEAR)
        session.advance(6.0)
        run.ask(Request.ARM)
        run.until(lambda: session.telemetry.ticks.latest()["ready"], "the robot to stand")
        session.advance(1.0)
        assert session.state.ladder is State.READY
        assert run.answer(session.send(TURN).id).state == "accepted"
        session.advance(1.0)
        assert session.state.ladder is State.STREAMING
        session.finish()
