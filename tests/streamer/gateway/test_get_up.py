"""A robot that lies gets up on request alone; the request is answered with what became of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexmotion.configs.robot import Robot
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.start_check import gets_up_from
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.run.requests import Request

from .conftest import Office

Make = Callable[..., Office]
GET_UP = '{"type":"clear","get_up":true,"id":"g"}'


def test_the_answer_comes_when_it_stands(make_office: Make) -> None:
    office = make_office()
    run, reader = office.run, office.requests.reader()
    run.state, run.stopped = State.FAULT, True
    run.step()
    office.ask(GET_UP)
    assert [request for request, _ in reader.read()] == [Request.GET_UP]
    run.take(Request.GET_UP)
    run.state, run.stopped = State.GET_UP, False
    run.step()
    office.desk.pump()
    assert office.told == []
    run.telemetry.emit(run.tick, "done", "GET_UP")
    run.step()
    office.desk.pump()
    (answer,) = office.told
    assert (answer.id, answer.asked, answer.state, answer.tick) == ("g", "clear", "accepted", 3)


def test_the_answer_says_why_it_gave_up_and_a_plain_clear_is_another_request(make_office: Make) -> None:
    office = make_office()
    run, reader = office.run, office.requests.reader()
    office.ask(GET_UP)
    office.ask('{"type":"clear","id":"c"}')
    assert [request for request, _ in reader.read()] == [Request.GET_UP, Request.CLEAR]
    run.take(Request.GET_UP)
    run.take(Request.CLEAR)
    run.telemetry.emit(run.tick, "refused", "GET_UP: get up: after step 3 of 7 (push up) it leans")
    run.step()
    office.desk.pump()
    told = {answer.id: answer for answer in office.told}
    assert told["g"].state == "refused" and told["g"].reason == "get up: after step 3 of 7 (push up) it leans"
    assert told["c"].state == "accepted"


def test_one_that_is_overridden_in_its_own_tick_is_answered_at_once(make_office: Make) -> None:
    """The loop had taken it, nothing came of it, and the answer came after 60 s."""
    office = make_office()
    run = office.run
    run.state = State.OFF
    run.step()
    office.ask(GET_UP)
    run.telemetry.emit(run.tick, "request", "GET_UP")
    run.telemetry.emit(run.tick, "request", "STOP")
    run.telemetry.emit(run.tick, "refused", "GET_UP: overridden in its own tick by STOP from phone")
    run.step()
    office.desk.pump()
    (answer,) = office.told
    assert (answer.state, answer.reason) == ("refused", "overridden in its own tick by STOP from phone")


def test_one_that_is_refused_because_another_is_under_way_leaves_that_open(make_office: Make) -> None:
    """Both were told that it is refused, while the robot got up for the first."""
    office = make_office()
    run = office.run
    run.state = State.FAULT
    run.step()
    office.ask(GET_UP)
    run.take(Request.GET_UP)
    run.state = State.GET_UP
    run.step()
    office.desk.pump()
    office.ask(GET_UP.replace('"g"', '"h"'))
    run.telemetry.emit(run.tick, "request", "GET_UP")
    run.telemetry.emit(run.tick, "refused", "GET_UP: torque is on, the robot is in GET_UP")
    run.step()
    office.desk.pump()
    assert [(answer.id, answer.state) for answer in office.told] == [("h", "refused")]
    run.telemetry.emit(run.tick, "done", "GET_UP")
    run.step()
    office.desk.pump()
    assert (office.told[-1].id, office.told[-1].state) == ("g", "accepted")


def test_the_status_offers_it_to_a_robot_that_lies_without_torque_alone(op3: Robot) -> None:
    def offered(state: State, pitch: float, roll: float = 0.0, imu_stale: int = 0) -> str | None:
        row = blank(TickRow.dtype(joints=op3.n))
        row["state"], row["tilt"], row["imu_stale"] = state, (roll, pitch), imu_stale
        return gets_up_from(op3, TickRow(row))

    assert offered(State.FAULT, 1.5) == "front" and offered(State.OFF, -1.5) == "back"
    for state in (State.READY, State.GET_UP, State.DAMPED):
        assert offered(state, 1.5) is None
    assert offered(State.FAULT, 0.2) is None and offered(State.FAULT, 0.0, roll=np.pi / 2) is None
    assert offered(State.FAULT, 1.5, imu_stale=-1) is None
