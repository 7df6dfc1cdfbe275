"""A program that asks for something waits until the robot has done it."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from flexmotion.configs.errors import GatewayError
from flexmotion.streamer.cli import execute
from flexmotion.streamer.gateway.async_client import AsyncClient
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.messages import Answer
from flexmotion.streamer.gateway.outcome import Outcome, outcome_of
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.motion.heard import Heard, HeardStep

from ...waiting import wait_until
from .conftest import Answering, Begin

FOLLOWED = Answer(state="accepted", asked="text", target=7)


def status(target: int = 7, **known: Any) -> dict[str, Any]:
    return {"following": {"target": target, "end": None, "place": None} | known}


@pytest.mark.parametrize(
    ("told", "end", "finished"),
    [
        (status(), None, None),
        (status(end="done", place=(1.0, 0.0, 0.0)), "done", True),
        (status(end="expired"), "expired", True),
        (status(end="time limit"), "time limit", False),
        (status(8), "superseded", False),
        ({"following": None}, "stopped", False),
    ],
)
def test_the_status_tells_how_a_target_ends(told: dict[str, Any], end: str | None, finished: bool | None) -> None:
    found = outcome_of(FOLLOWED, told)
    assert (None if found is None else found.end) == end
    assert (None if found is None else found.finished) is finished


def test_what_never_began_has_ended_whatever_the_robot_does() -> None:
    assert outcome_of(Answer(state="refused", reason="?"), status()) == Outcome(end="refused")


def test_no_end_is_told_of_a_hand_or_of_an_arming() -> None:
    """The robot's whole body follows something else meanwhile: the hand would have been told as superseded at once."""
    with pytest.raises(GatewayError, match=r"hand \(right hand\): no end is told"):
        outcome_of(Answer(state="accepted", asked="hand", part="right hand", target=9), status())
    with pytest.raises(GatewayError, match="arm: no end is told"):
        outcome_of(Answer(state="accepted", asked="arm"), status())


def end_later(planner: Answering, end: str, place: tuple[float, float, float] | None = None) -> None:
    """The step of the newest target ends so, once there is one that has been answered."""
    before = len(planner.seen)

    def publish() -> None:
        wait_until(lambda: len(planner.seen) > before, "a target")
        time.sleep(0.3)
        step = HeardStep(text="?", heard_as="?", end=end, place=place)  # type: ignore[arg-type]
        planner.run.heard.publish(Heard(id=planner.seen[-1].id, asked="?", state="accepted", steps=(step,)))

    threading.Thread(target=publish, daemon=True).start()


@pytest.fixture
def gateway(begin: Begin) -> GatewayService:
    return begin()


@pytest.fixture
def planner(gateway: GatewayService, answering: Callable[..., Answering]) -> Answering:
    return answering(gateway.requests)


def test_a_client_waits_for_the_end(gateway: GatewayService, planner: Answering) -> None:
    with Client(port=gateway.port) as client:
        end_later(planner, "done", (0.97, 0.02, 0.1))
        answer = client.waypoint(1.0, 0.0)
        assert client.wait(answer, most_s=0.05) is None
        assert client.wait(answer) == Outcome(end="done", place=(0.97, 0.02, 0.1))
        client.text("wave")
        assert client.wait(answer) == Outcome(end="superseded")


def test_an_asynchronous_client_does_other_things_meanwhile(gateway: GatewayService, planner: Answering) -> None:
    async def both() -> Outcome | None:
        async with AsyncClient(port=gateway.port) as client:
            waiting = asyncio.create_task(client.wait(await client.text("wave")))
            await asyncio.sleep(0.15)
            assert not waiting.done()
            await client.text("wave again")
            return await waiting

    assert asyncio.run(both()) == Outcome(end="superseded")


def test_the_command_line_exits_by_the_end(
    gateway: GatewayService, planner: Answering, capsys: pytest.CaptureFixture[str]
) -> None:
    port = ["--port", str(gateway.port)]
    end_later(planner, "done")
    assert execute(["send", "two steps back", "--wait", *port]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "done"
    end_later(planner, "time limit")
    assert execute(["send", "two steps back", "--wait", "--json", *port]) == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["state"], told["outcome"]) == ("accepted", {"end": "time limit"})
    planner.run.stopped = True
    assert execute(["send", "wave", "--wait", *port]) == 1
    assert capsys.readouterr().out == "refused: a stop is in force\n"
