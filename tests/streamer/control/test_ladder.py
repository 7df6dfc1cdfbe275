"""Every state with every input, then sequences of states."""

from __future__ import annotations

from dataclasses import fields
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.configs.robot_file import EmergencyStop, SafetyLimits
from flexmotion.streamer.control.ladder import POWERED, Inputs, Ladder, Playback, State

RATE = 100.0
FREEZES = SafetyLimits(emergency_stop="freeze")
FREEZE, DAMP = 50, 100
"""Ticks for which a robot is frozen and damped."""
REQUESTS = (
    "start",
    "stop",
    "park",
    "clear",
    "get_up",
    "estop",
    "kill",
    "plan_ready",
    "plan_over",
    "move_done",
    "fallen",
    "unseen",
    "stands",
)
REASONS = ("fault", "bus_lost", "cut_off", "blocked", "get_up_failed")


def one(name: str) -> Inputs:
    """Inputs with this one alone."""
    inputs = Inputs()
    setattr(inputs, name, True if name in REQUESTS else f"{name} of servo 7")
    return inputs


def at(state: State) -> Ladder:
    """A ladder that has come to this state the usual way."""
    ways = {
        State.OFF: [],
        State.READY: [Inputs(start=True)],
        State.STREAMING: [Inputs(start=True), Inputs(move_done=True, plan_ready=True)],
        State.HOLD: [Inputs(start=True), Inputs(move_done=True, plan_ready=True), Inputs(plan_over=True)],
        State.PARK: [Inputs(start=True), Inputs(park=True)],
        State.DAMPED: [Inputs(start=True), Inputs(fallen=True)],
        State.FAULT: [Inputs(start=True), Inputs(kill=True)],
        State.GET_UP: [Inputs(get_up=True)],
    }
    ladder = Ladder(FREEZES, RATE)
    for inputs in ways[state]:
        ladder.step(inputs)
    assert ladder.state is state
    return ladder


MOVES = {
    State.OFF: {"kill": State.FAULT, "estop": State.FAULT, "start": State.READY, "get_up": State.GET_UP},
    State.READY: {"park": State.PARK, "fault": State.PARK},
    State.STREAMING: {"plan_over": State.HOLD},
    State.HOLD: {"park": State.PARK, "fault": State.PARK, "plan_ready": State.STREAMING},
    State.PARK: {"move_done": State.OFF},
    State.DAMPED: {},
    State.FAULT: {"clear": State.OFF, "get_up": State.GET_UP},
    State.GET_UP: {
        **dict.fromkeys(("stop", "park", "fault", "get_up_failed"), State.DAMPED),
        "move_done": State.READY,
    },
}
"""Inputs that change a state; all others do not."""
EMERGENCIES = {
    "kill": State.FAULT,
    "cut_off": State.FAULT,
    "bus_lost": State.HOLD,
    "fallen": State.DAMPED,
    "unseen": State.DAMPED,
    "estop": State.HOLD,
    "blocked": State.HOLD,
}
"""The same for every state with torque; a damped robot has fallen and follows only inputs that cut its torque."""


def test_all_inputs_are_covered_here() -> None:
    assert {field.name for field in fields(Inputs)} == {*REQUESTS, *REASONS}


@pytest.mark.parametrize("name", [*REQUESTS, *REASONS])
@pytest.mark.parametrize("state", State)
def test_one_input_in_one_state(state: State, name: str) -> None:
    ladder = at(state)
    expected = MOVES[state].get(name, state)
    if state in POWERED and name in EMERGENCIES:
        expected = EMERGENCIES[name]
        if state is State.DAMPED and name in ("fallen", "unseen", "estop", "bus_lost", "blocked"):
            expected = State.DAMPED
        if state is State.PARK and name in ("bus_lost", "blocked"):
            expected = State.PARK
        if state is State.GET_UP and name in ("fallen", "unseen", "blocked"):
            expected = State.GET_UP  # it lies, and the ground is in the way of its joints
        if state is State.GET_UP and name in ("estop", "bus_lost"):
            expected = State.DAMPED
    ladder.step(one(name))
    assert ladder.state is expected


@pytest.mark.parametrize("state", State)
def test_without_inputs_no_state_changes(state: State) -> None:
    ladder = at(state)
    playback = ladder.step(Inputs())
    assert ladder.state is state
    assert (
        playback
        is {
            State.OFF: Playback.NOTHING,
            State.READY: Playback.TO_STAND,
            State.STREAMING: Playback.PLAN,
            State.HOLD: Playback.PLAN,
            State.PARK: Playback.TO_REST,
            State.DAMPED: Playback.DAMP,
            State.FAULT: Playback.NOTHING,
            State.GET_UP: Playback.GET_UP,
        }[state]
    )


def test_it_streams_only_once_it_stands_and_has_a_plan() -> None:
    ladder = at(State.READY)
    for inputs in (Inputs(move_done=True), Inputs(plan_ready=True)):
        ladder.step(inputs)
        assert ladder.state is State.READY
    assert ladder.step(Inputs(move_done=True, plan_ready=True)) is Playback.PLAN


@pytest.mark.parametrize("stop", ["stop", "park"])
def test_a_stop_in_the_tick_of_a_start_wins(stop: str) -> None:
    """A STOP of one person and a CLEAR or ARM of another within one tick: the stop was answered, and lost."""
    off = at(State.OFF)
    off.step(Inputs(start=True, **{stop: True}))
    assert off.state is State.OFF
    for state in (State.READY, State.HOLD):
        ladder = at(state)
        ladder.step(Inputs(start=True, stop=True, plan_ready=True, move_done=True))
        assert ladder.state is state and ladder.stopping


@pytest.mark.parametrize("state", [s for s in POWERED if s not in (State.DAMPED, State.GET_UP)])
def test_estop_freezes_then_parks_then_ends_in_fault(state: State) -> None:
    ladder = at(state)
    assert ladder.step(Inputs(estop=True)) is Playback.FREEZE
    for _ in range(FREEZE - 1):
        assert ladder.step(Inputs(plan_ready=True, move_done=True)) is Playback.FREEZE
    assert ladder.step(Inputs()) is Playback.TO_REST
    assert ladder.step(Inputs()) is Playback.TO_REST
    assert ladder.step(Inputs(move_done=True)) is Playback.NOTHING
    assert ladder.state is State.FAULT and ladder.fault is not None and "e-stop" in ladder.fault


def of(stop: EmergencyStop, *inputs: Inputs) -> Ladder:
    """A ladder of a robot with this emergency stop, after these inputs."""
    ladder = Ladder(SafetyLimits(emergency_stop=stop), RATE)
    for one_input in inputs:
        ladder.step(one_input)
    return ladder


STREAMING = (Inputs(start=True), Inputs(move_done=True, plan_ready=True))


def test_a_robot_without_a_proof_stops_by_its_own_plan_then_parks() -> None:
    """Every robot froze in mid-stride, also those of which nobody knew whether that keeps them up."""
    assert SafetyLimits().emergency_stop == "captured_stop"
    ladder = of("captured_stop", *STREAMING)
    assert ladder.step(Inputs(estop=True, plan_ready=True)) is Playback.PLAN
    assert ladder.stopping and ladder.fault is not None and ladder.fault.startswith("e-stop")
    ladder.step(Inputs(plan_ready=True, start=True, clear=True))
    assert ladder.stopping and ladder.state is State.STREAMING, "nothing undoes it"
    ladder.step(Inputs(plan_over=True))
    assert ladder.step(Inputs(plan_over=True)) is Playback.TO_REST
    ladder.step(Inputs(move_done=True))
    assert ladder.state is State.FAULT


@pytest.mark.parametrize("before", [STREAMING, (*STREAMING, Inputs(plan_over=True)), STREAMING[:1]])
def test_a_robot_that_crouches_is_on_its_way_at_the_next_tick(before: tuple[Inputs, ...]) -> None:
    ladder = of("crouch", *before)
    assert ladder.step(Inputs(estop=True, plan_ready=True)) is Playback.TO_REST
    assert ladder.step(Inputs(plan_ready=True)) is Playback.TO_REST
    ladder.step(Inputs(move_done=True))
    assert ladder.state is State.FAULT and ladder.fault is not None and "e-stop" in ladder.fault


@pytest.mark.parametrize("stop", get_args(EmergencyStop))
def test_after_an_emergency_stop_clear_leads_to_off_and_only_a_start_from_there(stop: EmergencyStop) -> None:
    ladder = of(stop, *STREAMING, Inputs(estop=True))
    for _ in range(FREEZE + 5):
        ladder.step(Inputs(plan_over=True, move_done=True))
    assert ladder.state is State.FAULT
    ladder.step(Inputs(clear=True))
    for _ in range(3):
        ladder.step(Inputs(plan_ready=True, move_done=True))
    assert ladder.state is State.OFF and ladder.fault is None
    ladder.step(Inputs(start=True))
    assert ladder.state is State.READY


def test_an_estop_button_held_down_counts_once() -> None:
    """Each tick of a latching button froze the robot again: it never parked."""
    ladder = at(State.STREAMING)
    for _ in range(FREEZE + 1):
        ladder.step(Inputs(estop=True))
    assert ladder.state is State.PARK
    ladder.step(Inputs(estop=True))
    assert ladder.state is State.PARK
    ladder.step(Inputs())
    assert ladder.step(Inputs(estop=True)) is Playback.FREEZE  # pressed again


@pytest.mark.parametrize("name", ["estop", "kill"])
def test_no_start_under_a_pressed_button(name: str) -> None:
    ladder = Ladder(FREEZES, RATE)
    ladder.step(Inputs(start=True, **{name: True}))
    assert ladder.state is State.FAULT


@pytest.mark.parametrize("state", POWERED)
def test_kill_cuts_torque_within_the_tick_whatever_the_other_inputs(state: State) -> None:
    ladder = at(state)
    everything = Inputs(**dict.fromkeys(REQUESTS, True), fault="hot", blocked="knee", bus_lost="gone", cut_off="gone")
    assert ladder.step(everything) is Playback.NOTHING
    assert ladder.state is State.FAULT and ladder.fault is not None  # not even by a clear in the same tick


def test_a_fault_while_streaming_lets_the_plan_end_then_parks() -> None:
    ladder = at(State.STREAMING)
    assert ladder.step(Inputs(fault="servo hot")) is Playback.PLAN
    assert ladder.stopping
    assert ladder.step(Inputs(plan_ready=True)) is Playback.PLAN
    ladder.step(Inputs(plan_over=True))
    assert ladder.state is State.HOLD
    ladder.step(Inputs(plan_ready=True))
    assert ladder.state is State.HOLD  # a plan in mid-step is not cut short
    ladder.step(Inputs(plan_over=True))
    assert ladder.state is State.PARK
    ladder.step(Inputs(move_done=True))
    assert (ladder.state, ladder.fault) == (State.FAULT, "servo hot")


def test_the_first_fault_is_the_one_that_is_kept() -> None:
    ladder = at(State.STREAMING)
    ladder.step(Inputs(fault="voltage low"))
    ladder.step(Inputs(fault="servo hot"))
    ladder.step(Inputs(estop=True))
    ladder.step(Inputs(kill=True))
    assert ladder.fault == "voltage low"


def test_a_fall_is_damped_then_off_and_latched() -> None:
    ladder = at(State.STREAMING)
    assert ladder.step(Inputs(fallen=True)) is Playback.DAMP
    for _ in range(DAMP - 1):
        assert ladder.step(Inputs(fallen=True, fault="later")) is Playback.DAMP
    assert ladder.step(Inputs()) is Playback.NOTHING
    assert ladder.fault is not None and ladder.fault.startswith("fall")


@pytest.mark.parametrize("state", [s for s in POWERED if s not in (State.DAMPED, State.PARK, State.GET_UP)])
def test_a_robot_whose_servos_do_not_answer_is_held_for_a_bounded_time_then_lowered(state: State) -> None:
    """All torque was cut at once: answers were 20 ms late, every goal was heard, and the robot fell."""
    ladder = at(state)
    lost = int(FREEZES.lost_bus_hold_s * RATE)
    for _ in range(lost):
        assert ladder.step(Inputs(bus_lost="gone")) is Playback.FREEZE
    assert ladder.step(Inputs(bus_lost="gone")) is Playback.TO_REST
    assert ladder.step(Inputs(bus_lost="gone")) is Playback.TO_REST
    assert ladder.step(Inputs(bus_lost="gone", move_done=True)) is Playback.NOTHING
    assert (ladder.state, ladder.fault) == (State.FAULT, "gone")


UPRIGHT = [state for state in POWERED if state not in (State.DAMPED, State.PARK, State.GET_UP)]


@pytest.mark.parametrize("state", UPRIGHT)
def test_a_robot_with_a_blocked_arm_is_frozen_then_lowered(state: State) -> None:
    ladder = at(state)
    for _ in range(FREEZE):
        assert ladder.step(Inputs(blocked="elbow")) is Playback.FREEZE and not ladder.waits
    assert ladder.step(Inputs(blocked="elbow")) is Playback.TO_REST
    assert ladder.step(Inputs(move_done=True)) is Playback.NOTHING
    assert (ladder.state, ladder.fault) == (State.FAULT, "elbow")


@pytest.mark.parametrize("ends", ["time", "park", "fault"])
@pytest.mark.parametrize("state", UPRIGHT)
def test_a_robot_with_a_blocked_leg_stands_until_somebody_holds_it(state: State, ends: str) -> None:
    """The plan was played on to its stop, and the robot lowered to its rest pose: in both it fell."""
    ladder = at(state)
    ladder.step(Inputs(blocked="knee", stands=True))
    ticks = int(FREEZES.blocked_hold_s * RATE)
    for tick in range(1, ticks + 1):
        # Neither a press of the e-stop, whose tick does not count, nor plans change it.
        pressed = Inputs(blocked="knee", stands=True, estop=tick == 30, plan_ready=True, plan_over=tick % 2 == 0)
        assert ladder.step(pressed) is Playback.FREEZE and ladder.waits
        if ends != "time" and tick == 200:
            break
    last = Inputs(blocked="knee", stands=True, park=ends == "park", fault="servo hot" if ends == "fault" else None)
    assert ladder.step(last) is Playback.TO_REST and not ladder.waits
    ladder.step(Inputs(move_done=True))
    assert (ladder.state, ladder.fault) == (State.FAULT, "knee")
    ladder.step(Inputs(clear=True))
    ladder.step(Inputs(start=True))
    ladder.step(Inputs(estop=True))
    assert not ladder.waits


def test_a_robot_with_a_blocked_leg_whose_bus_is_lost_stands_no_longer_than_without_it() -> None:
    ladder = at(State.STREAMING)
    ladder.step(Inputs(blocked="knee", stands=True))
    for _ in range(int(FREEZES.lost_bus_hold_s * RATE)):
        assert ladder.step(Inputs(bus_lost="gone")) is Playback.FREEZE
    assert ladder.step(Inputs(bus_lost="gone")) is Playback.TO_REST


def test_a_robot_that_must_not_freeze_plays_its_stop_when_a_joint_is_blocked() -> None:
    ladder = of("captured_stop", *STREAMING)
    assert ladder.step(Inputs(blocked="knee", stands=True)) is Playback.PLAN
    assert ladder.stopping and not ladder.waits


def test_a_robot_that_must_not_freeze_plays_its_stop_when_its_servos_do_not_answer() -> None:
    ladder = of("captured_stop", *STREAMING)
    assert ladder.step(Inputs(bus_lost="gone")) is Playback.PLAN
    assert ladder.stopping
    ladder.step(Inputs(bus_lost="gone", plan_over=True))
    ladder.step(Inputs(bus_lost="gone", plan_over=True))
    assert (ladder.state, ladder.fault) == (State.PARK, "gone")


def test_a_frozen_robot_that_falls_is_damped_and_starts_unfrozen_after_a_clear() -> None:
    ladder = at(State.STREAMING)
    ladder.step(Inputs(estop=True))
    assert ladder.step(Inputs(fallen=True)) is Playback.DAMP
    for _ in range(DAMP):
        ladder.step(Inputs())
    ladder.step(Inputs(clear=True))
    ladder.step(Inputs(start=True))
    assert ladder.step(Inputs()) is Playback.TO_STAND


def test_no_start_before_the_fault_is_cleared() -> None:
    ladder = at(State.FAULT)
    ladder.step(Inputs(start=True))
    assert ladder.state is State.FAULT
    ladder.step(Inputs(clear=True, start=True))
    assert (ladder.state, ladder.fault) == (State.OFF, None)
    ladder.step(Inputs(start=True))
    assert ladder.state is State.READY


def test_a_stop_holds_until_the_next_start_request() -> None:
    """A stop in HOLD was undone a tick later by the next plan."""
    ladder = at(State.STREAMING)
    ladder.step(Inputs(stop=True))
    ladder.step(Inputs(plan_ready=True))
    assert ladder.stopping and ladder.state is State.STREAMING
    ladder.step(Inputs(plan_over=True))
    for _ in range(3):
        ladder.step(Inputs(plan_ready=True))
        assert ladder.state is State.HOLD and ladder.stopping
    ladder.step(Inputs(plan_ready=True, start=True))
    assert ladder.state is State.STREAMING and not ladder.stopping


def test_no_start_after_an_emergency_stop_without_torque_before_a_clear() -> None:
    """An emergency stop that was pressed in OFF was answered as accepted, and the next ARM stood the robot up."""
    ladder = at(State.OFF)
    assert ladder.step(Inputs(estop=True)) is Playback.NOTHING
    assert ladder.state is State.FAULT and str(ladder.fault).startswith("e-stop")
    ladder.step(Inputs(start=True))
    assert ladder.state is State.FAULT
    ladder.step(Inputs(clear=True, estop=True))
    assert ladder.state is State.FAULT, "it is still pressed"
    ladder.step(Inputs(clear=True))
    ladder.step(Inputs(start=True))
    assert ladder.state is State.READY and not ladder.stopping


@pytest.mark.parametrize("state", [State.OFF, State.PARK, State.READY, State.HOLD, State.STREAMING])
def test_a_stop_outlives_the_torque_and_is_released_by_a_clear_alone(state: State) -> None:
    """A STOP that was pressed in OFF or PARK was lost, and one from before was released by the next ARM."""
    ladder = at(state)
    ladder.step(Inputs(stop=True))
    ladder.step(Inputs(park=True, plan_over=True))
    for _ in range(3):
        ladder.step(Inputs(plan_over=True))
    ladder.step(Inputs(move_done=True))
    assert ladder.state is State.OFF and ladder.stopping
    ladder.step(Inputs(start=True))
    ladder.step(Inputs(clear=True, stop=True))
    ladder.step(Inputs(start=True))
    assert ladder.state is State.OFF and ladder.stopping, "a stop in the tick of a clear wins"
    ladder.step(Inputs(clear=True, start=True))
    assert ladder.state is State.OFF and not ladder.stopping, "a clear switches no torque on"
    ladder.step(Inputs(start=True))
    assert ladder.state is State.READY and not ladder.stopping


def test_parking_alone_leaves_no_stop_behind() -> None:
    """With the torque off the status told of a stop that nobody had pressed, after a DISARM in mid-walk."""
    ladder = at(State.STREAMING)
    ladder.step(Inputs(park=True))
    assert ladder.stopping
    for inputs in (Inputs(plan_over=True), Inputs(plan_over=True), Inputs(move_done=True)):
        ladder.step(inputs)
    assert ladder.state is State.OFF and not ladder.stopping


def test_a_clear_does_not_undo_a_park() -> None:
    """Went wrong: a CLEAR after a DISARM that had met a plan in its own tick let that plan play: the robot walked."""
    ladder = at(State.HOLD)
    ladder.step(Inputs(park=True, plan_ready=True))
    ladder.step(Inputs(start=True, plan_ready=True))
    assert ladder.state is State.HOLD and ladder.stopping


def test_a_stop_in_the_tick_of_a_clear_keeps_the_fault() -> None:
    """The CLEAR of one person undid the STOP of another of the same tick."""
    ladder = at(State.FAULT)
    ladder.step(Inputs(stop=True, clear=True))
    assert ladder.state is State.FAULT


@pytest.mark.parametrize("state", [State.READY, State.HOLD])
def test_a_stop_keeps_a_standing_robot_standing(state: State) -> None:
    ladder = at(state)
    ladder.step(Inputs(move_done=True, plan_ready=True, stop=True))
    ladder.step(Inputs(move_done=True, plan_ready=True))
    assert ladder.state is state


def test_park_wins_over_a_plan_that_begins_in_the_same_tick() -> None:
    """Went wrong: a DISARM in the tick in which a walk began out of HOLD was lost, and the robot walked off."""
    ladder = at(State.HOLD)
    ladder.step(Inputs(park=True, plan_ready=True))
    assert ladder.stopping
    for _ in range(3):
        ladder.step(Inputs())
    assert ladder.state is State.PARK


def test_park_while_streaming_parks_once_the_robot_stands() -> None:
    """The robot came to a stand and stayed in HOLD: the request was lost."""
    ladder = at(State.STREAMING)
    ladder.step(Inputs(park=True))
    ladder.step(Inputs(plan_over=True))
    ladder.step(Inputs(plan_over=True))
    assert ladder.state is State.PARK


anything = st.builds(
    Inputs,
    **{name: st.sampled_from([False] * 4 + [True]) for name in REQUESTS},
    fault=st.sampled_from([None] * 5 + ["hot"]),
    blocked=st.sampled_from([None] * 9 + ["knee"]),
    bus_lost=st.sampled_from([None] * 9 + ["gone"]),
    cut_off=st.sampled_from([None] * 19 + ["gone"]),
    get_up_failed=st.sampled_from([None] * 9 + ["leans"]),
)


@settings(max_examples=150)
@given(sequence=st.lists(anything, max_size=40))
def test_for_any_inputs_a_fault_stays_until_cleared_and_torque_returns_only_on_request(
    sequence: list[Inputs],
) -> None:
    ladder = Ladder(FREEZES, RATE, freeze_s=0.03, damp_s=0.03)
    for inputs in sequence:
        before, fault, stopped = ladder.state, ladder.fault, ladder.stopped
        playback = ladder.step(inputs)
        assert ladder.stopped or not (inputs.stop or (stopped and not (inputs.clear or inputs.start or inputs.get_up)))
        if fault is not None:
            assert ladder.fault == fault or (before is State.FAULT and (inputs.clear or inputs.get_up))
        if before not in POWERED and ladder.state in POWERED:
            assert inputs.get_up or (before is State.OFF and inputs.start and fault is None and not stopped)
            assert not (inputs.stop or inputs.park or inputs.estop or inputs.kill)
        if ladder.state is State.FAULT:
            assert ladder.fault is not None
        if ladder.state in (State.OFF, State.FAULT):
            assert playback is Playback.NOTHING
        if playback is Playback.FREEZE:
            assert ladder.state is State.HOLD and ladder.fault is not None


def test_inputs_are_cleared_after_a_tick() -> None:
    inputs = Inputs(**dict.fromkeys(REQUESTS, True), fault="hot", blocked="knee", bus_lost="gone", cut_off="gone")
    inputs.reset()
    assert inputs == Inputs()


@pytest.mark.parametrize("against", ["stop", "park", "estop", "kill"])
@pytest.mark.parametrize("state", [State.OFF, State.FAULT])
def test_a_stop_in_the_same_tick_keeps_a_robot_that_lies_down(state: State, against: str) -> None:
    ladder = at(state)
    inputs = Inputs(get_up=True)
    setattr(inputs, against, True)
    ladder.step(inputs)
    assert ladder.state in (State.OFF, State.FAULT)


def test_a_robot_that_gets_up_clears_its_fault_and_latches_why_it_gave_up() -> None:
    ladder = at(State.FAULT)
    ladder.step(Inputs(get_up=True))
    assert ladder.fault is None
    ladder.step(Inputs(get_up_failed="get up: after step 3 of 7"))
    assert ladder.state is State.DAMPED
    for _ in range(round(2 * RATE)):
        ladder.step(Inputs(get_up=True))
    assert ladder.state is State.GET_UP, "and may be asked again, once its torque is off"
    ladder.step(Inputs(estop=True, move_done=True))
    assert ladder.state is State.DAMPED and str(ladder.fault).startswith("e-stop:")
