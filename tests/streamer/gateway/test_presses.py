"""Stops on their way from the stop process to the loop."""

from __future__ import annotations

from typing import Any

import pytest

from flexmotion.streamer.gateway import presses as presses_module
from flexmotion.streamer.gateway.presses import Presses
from flexmotion.streamer.run.requests import Request, RequestChannel

from ...waiting import wait_until
from .conftest import Run


def test_a_flood_of_stops_pushes_no_emergency_stop_out_of_the_channel(run: Run) -> None:
    """A channel holds 32 requests: of more than that in one period the oldest were lost."""
    channel = RequestChannel()
    loop, presses = channel.reader(), Presses(run.telemetry, channel)
    presses.press(Request.ESTOP, "test")
    pressed = [presses.press(Request.STOP, "test") for _ in range(100)]
    assert [request for request, _ in loop.read()] == [Request.ESTOP, Request.STOP]
    run.take(Request.STOP)
    presses.look()
    assert all(press.told is not None and press.told["state"] == "accepted" for press in pressed)
    presses.press(Request.STOP, "test")
    assert [request for request, _ in loop.read()] == [Request.STOP]


def test_a_reply_that_cannot_be_delivered_keeps_no_other_from_its_answer(run: Run) -> None:
    """The error of a closed connection ended the thread that answers."""
    presses = Presses(run.telemetry, RequestChannel())
    answers: list[Any] = []

    def broken(_content: Any) -> None:
        raise OSError("closed")

    presses.press(Request.STOP, "test", broken)
    presses.press(Request.STOP, "test", answers.append)
    run.take(Request.STOP)
    wait_until(lambda: answers, "the second answer")
    presses.press(Request.ESTOP, "test", answers.append)
    run.take(Request.ESTOP)
    wait_until(lambda: len(answers) == 2, "an answer to a later request")


def test_a_loop_that_takes_nothing_is_told(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(presses_module.time, "monotonic", lambda: now)
    channel = RequestChannel()
    loop, presses = channel.reader(), Presses(run.telemetry, channel)
    press = presses.press(Request.ESTOP, "test")
    now = 0.9
    presses.look()
    assert press.told is None
    now = 1.1
    presses.look()
    assert press.told is not None and press.told["state"] == "refused" and press.told["arrived_tick"] == -1
    presses.press(Request.ESTOP, "test")
    assert [request for request, _ in loop.read()] == [Request.ESTOP, Request.ESTOP]
