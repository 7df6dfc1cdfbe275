"""Requests for single joints get their answer once it is known what became of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flexmotion.streamer.gateway.status import status_of
from flexmotion.streamer.run.requests import Request

Make = Callable[..., Any]
LIMP = '{"type":"limp","joints":["l_el","r_el"],"id":"a"}'
REBOOT = '{"type":"reboot","joints":["l_el"],"id":"b"}'


def test_the_loop_is_told_the_joints_and_its_refusal_is_the_answer(make_office: Make) -> None:
    office = make_office()
    reader = office.requests.reader()
    office.ask(LIMP)
    assert reader.read() == [(Request.LIMP, "l_el,r_el")]
    run = office.run
    run.telemetry.emit(run.tick, "request", "LIMP l_el,r_el")
    office.desk.pump()
    assert office.told == [], "the tick that decides is not over"
    run.telemetry.emit(run.tick, "refused", "LIMP l_el,r_el: in OFF no joint has torque; arm the robot")
    run.step()
    office.desk.pump()
    (answer,) = office.told
    assert (answer.id, answer.state, answer.reason) == ("a", "refused", "in OFF no joint has torque; arm the robot")


def test_it_is_accepted_with_the_tick_that_did_it(make_office: Make) -> None:
    office = make_office()
    office.ask(LIMP)
    office.run.telemetry.emit(office.run.tick, "request", "LIMP l_el,r_el")
    office.run.telemetry.row.limp[...] = [True, False, True]
    office.run.step()
    office.desk.pump()
    (answer,) = office.told
    assert answer.state == "accepted" and answer.tick == 0
    status = status_of(office.desk, "op3", "sim", 125.0, None, joints=("l_el", "l_sho_roll", "r_el"))
    assert status.limp == ("l_el", "r_el")


def test_two_requests_for_different_joints_are_two_requests(make_office: Make) -> None:
    office = make_office()
    reader = office.requests.reader()
    for joint in ("l_el", "r_el", "l_el"):
        office.ask(f'{{"type":"limp","joints":["{joint}"]}}')
    assert [joints for _, joints in reader.read()] == ["l_el", "r_el"]


def test_a_restart_is_answered_when_the_servo_is_ready_and_holds_up_no_other_answer(make_office: Make) -> None:
    office = make_office()
    office.ask(REBOOT)
    run = office.run
    run.telemetry.emit(run.tick, "request", "REBOOT l_el")
    run.step()
    office.ask('{"type":"stop","id":"c"}')
    run.take(Request.STOP)
    office.desk.pump()
    assert [answer.id for answer in office.told] == ["c"]
    run.telemetry.emit(run.tick, "done", "REBOOT l_el")
    run.step()
    office.desk.pump()
    assert [(answer.id, answer.state) for answer in office.told] == [("c", "accepted"), ("b", "accepted")]
