"""A run that mirrors a person says whom it mirrors, and after a stop how it goes on."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.mirror_state import MirrorState
from flexmotion.streamer.gateway.status import status_of
from flexmotion.streamer.motion.mirror_source import GOES_ON, SILENT_S
from flexmotion.streamer.motion.person_channel import PersonChannel, PersonPose
from flexmotion.streamer.run.requests import Request

Make = Callable[..., Any]


class Mirroring:
    """A desk of a run that mirrors; the test shows a person, and acts as loop and planner."""

    def __init__(self, make_office: Make) -> None:
        self.office, self.channel = make_office(), PersonChannel()
        self.office.desk.mirror = MirrorState(self.channel)
        self.requests = self.office.requests.reader()

    def show(self, arrived_s: float | None = None) -> None:
        now = time.perf_counter() if arrived_s is None else arrived_s
        self.channel.publish(PersonPose(1, now, now, default_clip()[:1]))

    def goes(self, *states: State, stopped: bool = False) -> None:
        for state in states:
            self.office.run.state, self.office.run.stopped = state, stopped
            self.office.run.step()
            self.office.desk.pump()

    def ask(self, kind: str, request: Request, state: State) -> Any:
        """A request that the loop takes, after which it is in `state`; its answer."""
        self.office.ask(f'{{"type":"{kind}"}}')
        self.office.run.state = state
        self.office.run.take(request)
        self.office.run.step()
        self.office.desk.pump()
        return self.office.told[-1]

    @property
    def notes(self) -> list[str]:
        return [text for request, text in self.requests.read() if request is Request.NOTE]

    @property
    def told(self) -> str | None:
        self.office.desk.pump()
        return status_of(self.office.desk, "op3", "sim", 125.0, None).mirrors


@pytest.fixture
def mirroring(make_office: Make) -> Mirroring:
    return Mirroring(make_office)


def test_the_status_says_that_a_person_is_mirrored_or_that_nobody_is_seen(mirroring: Mirroring) -> None:
    """It had nothing to say of a run that mirrored: `following` was null until somebody had sent "mirror"."""
    mirroring.goes(State.OFF, State.READY)
    assert mirroring.told == "nobody"
    mirroring.show()
    assert mirroring.told == "not yet"
    mirroring.goes(State.STREAMING)
    assert mirroring.told == "a person"
    mirroring.show(time.perf_counter() - SILENT_S - 0.1)
    assert mirroring.told == "nobody"


def test_who_clears_a_stop_is_told_how_mirroring_goes_on(mirroring: Mirroring) -> None:
    """Frames kept coming and the robot stood; neither the answer, nor the run's output, nor the status said why."""
    mirroring.goes(State.STREAMING)
    mirroring.goes(State.STREAMING, State.HOLD, stopped=True)
    mirroring.show()
    assert mirroring.told == "waits"
    answer = mirroring.ask("clear", Request.CLEAR, State.HOLD)
    assert answer.state == "accepted" and answer.notes == (GOES_ON,) and "flexmotion send mirror" in GOES_ON
    assert mirroring.notes == [GOES_ON] and mirroring.told == "waits"
    mirroring.office.ask('{"type":"text","text":"mirror"}')
    mirroring.office.run.answer(mirroring.office.run.arrived()[-1].id, heard="mirror")
    mirroring.goes(State.STREAMING)
    mirroring.show()
    assert mirroring.told == "a person"


def test_a_robot_that_was_told_to_stand_waits_until_it_is_told_to_mirror(mirroring: Mirroring) -> None:
    """The status went on with "a person": a hold counted as a target that asks to mirror."""
    mirroring.goes(State.STREAMING)
    for kind, heard, told in (("hold", "stand", "waits"), ('text","text":"mirror', "mirror", "a person")):
        mirroring.office.ask(f'{{"type":"{kind}"}}')
        mirroring.office.run.answer(mirroring.office.run.arrived()[-1].id, heard=heard)
        mirroring.goes(State.STREAMING)
        mirroring.show()
        assert mirroring.told == told


def test_who_clears_a_fault_and_arms_is_told_too(mirroring: Mirroring) -> None:
    mirroring.goes(State.STREAMING, State.PARK, State.FAULT)
    assert mirroring.ask("clear", Request.CLEAR, State.OFF).notes == (GOES_ON,)
    assert mirroring.ask("arm", Request.ARM, State.READY).notes == (GOES_ON,)
    assert mirroring.notes == [GOES_ON] * 2 and mirroring.told == "waits"


def test_a_robot_that_is_armed_for_the_first_time_mirrors_by_itself(mirroring: Mirroring) -> None:
    mirroring.goes(State.OFF)
    answer = mirroring.ask("arm", Request.ARM, State.READY)
    assert answer.state == "accepted" and answer.notes is None and mirroring.notes == []
    assert mirroring.told == "nobody"


def test_one_that_was_stopped_before_it_was_armed_waits_until_it_is_told(mirroring: Mirroring) -> None:
    """A stop without torque ended nothing: the robot was armed, and mirrored whoever stood there."""
    mirroring.goes(State.OFF, stopped=True)
    mirroring.goes(State.OFF)
    assert mirroring.ask("arm", Request.ARM, State.READY).notes == (GOES_ON,)
    assert mirroring.told == "waits"


def test_a_run_that_mirrors_nobody_says_nothing_of_it(make_office: Make) -> None:
    office = make_office()
    office.run.state, office.run.stopped = State.HOLD, True
    office.run.step()
    office.desk.pump()
    office.ask('{"type":"clear"}')
    office.run.take(Request.CLEAR)
    office.run.step()
    office.desk.pump()
    assert office.told[-1].state == "accepted" and office.told[-1].notes is None
    assert status_of(office.desk, "op3", "sim", 125.0, None).mirrors is None
