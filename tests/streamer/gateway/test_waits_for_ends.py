"""Programs that wait until a target has ended."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable

import pytest
from websockets.sync.client import connect

from flexmotion.configs.errors import GatewayError
from flexmotion.streamer.cli import execute
from flexmotion.streamer.gateway.async_client import AsyncClient
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.messages import Answer
from flexmotion.streamer.motion.heard import Heard, HeardStep

from .conftest import Answering, Begin, Run

Answers = Callable[..., Answering]


def measured(run: Run, target: int, end: str = "done") -> None:
    """The planner tells that a target's last step has ended."""
    step = HeardStep.model_validate(
        {"text": "walk two metres", "amount": 2.0, "unit": "length", "end": end, "measured": 2.03}
    )
    run.heard.publish(Heard(id=target, asked="?", state="accepted", steps=(step,)))


def test_a_client_waits_for_the_end_of_its_target(run: Run, begin: Begin, answering: Answers) -> None:
    gateway = begin()
    answering(gateway.requests)
    with Client(port=gateway.port) as client:
        answer = client.text("walk two metres")
        assert answer.target is not None
        with pytest.raises(GatewayError, match=r"target \d+ has not ended within 0.05 s"):
            client.wait(answer, patience_s=0.05)
        measured(run, answer.target)
        ended = client.wait(answer)
        assert (ended.end, ended.done, ended.id) == ("done", "2.03 m of 2 m", answer.id)
        assert client.wait(answer) == ended, "it can be asked for again"


def test_an_end_that_comes_while_another_answer_is_awaited_is_kept(begin: Begin, answering: Answers) -> None:
    gateway = begin()
    answering(gateway.requests)
    with Client(port=gateway.port) as client:
        first, second = client.text("walk"), client.velocity(0.3, 0.0, 0.0, ttl_s=0.3)
        assert [client.wait(answer).end for answer in (second, first)] == ["expired", "superseded"]


def test_many_tasks_wait_at_a_time(run: Run, begin: Begin, answering: Answers) -> None:
    gateway = begin()
    answering(gateway.requests)

    async def ask() -> list[str]:
        async with AsyncClient(port=gateway.port) as client:
            first = await client.text("walk")
            waiting = asyncio.create_task(client.wait(first))
            second = await client.text("walk two metres")
            assert second.target is not None
            with pytest.raises(GatewayError, match="has not ended within"):
                await client.wait(second, patience_s=0.05)
            measured(run, second.target, "time limit")
            return [(await waiting).end, (await client.wait(second)).end]

    assert asyncio.run(ask()) == ["superseded", "time limit"]


def test_who_waits_is_told_that_the_run_has_gone(begin: Begin, answering: Answers) -> None:
    gateway = begin()
    answering(gateway.requests)

    async def ask() -> None:
        async with AsyncClient(port=gateway.port) as client:
            answer = await client.text("walk")
            waiting = asyncio.create_task(client.wait(answer))
            await asyncio.sleep(0)
            assert client._socket is not None
            await client._socket.close()
            with pytest.raises(GatewayError, match="the run closed the connection"):
                await waiting

    asyncio.run(ask())


def test_a_client_that_has_connected_anew_does_not_wait_for_a_target_of_before(
    begin: Begin, answering: Answers
) -> None:
    """It waited for ever: the end is told to the old connection; of another run it took that of the same number."""
    gateway = begin()
    answering(gateway.requests)
    with Client(port=gateway.port) as client:
        answer = client.text("walk")
        client.close()
        with pytest.raises(GatewayError, match="none of the newest 256 of this connection|is closed"):
            client.wait(answer)
        assert client.text("wave").state == "accepted"
        with pytest.raises(GatewayError, match="none of the newest 256 of this connection"):
            client.wait(answer)


def test_a_connection_that_did_not_ask_for_ends_gets_answers_alone(begin: Begin, answering: Answers) -> None:
    gateway = begin()
    answering(gateway.requests)
    with connect(f"ws://127.0.0.1:{gateway.port}/targets") as socket:
        for number in range(3):
            socket.send(json.dumps({"type": "text", "text": "wave", "id": f"{number}"}))
            while (told := json.loads(socket.recv()))["type"] == "lease":
                assert number == 0
            assert (told["type"], told["id"]) == ("answer", f"{number}")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"state": "refused", "reason": "a stop is in force"}, "refused: a stop is in force"),
        ({"state": "accepted", "asked": "arm"}, "arm: accepted: it is no target"),
        ({"state": "accepted", "target": 3, "part": "relax head"}, "relax head: its answer is its end"),
    ],
)
def test_what_has_no_end_is_not_waited_for(fields: dict[str, object], message: str) -> None:
    with pytest.raises(GatewayError, match=message):
        Client().wait(Answer.model_validate(fields))


def test_a_program_waits_until_a_hand_is_there(
    begin: Begin, answering: Answers, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was refused: the hand's answer says when it will be there, and nothing said that it is."""
    gateway = begin()
    answering(gateway.requests)
    with Client(port=gateway.port) as client:
        ended = client.wait(client.hand("left", 0.12, 0.12, 0.05))
        assert (ended.end, ended.done) == ("done", "0.3 cm from there")
    assert (
        execute(["send", "--hand", "left", ".12", ".12", ".05", "--wait", "--take", "--port", str(gateway.port)]) == 0
    )
    told = capsys.readouterr().out
    assert "accepted: left hand" in told and "done: 0.3 cm from there" in told


def test_the_command_refuses_to_wait_for_what_has_no_end(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["send", "--contact", "left", "--wait"]) == 2
    assert "--wait is that of TEXT" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(("end", "code", "line"), [("done", 0, "done: 2.03 m of 2 m"), ("time limit", 3, "not done")])
def test_the_command_waits_and_says_how_it_ended(
    run: Run, begin: Begin, answering: Answers, capsys: pytest.CaptureFixture[str], end: str, code: int, line: str
) -> None:
    gateway = begin()
    planner = answering(gateway.requests)
    ended = threading.Event()

    def tell() -> None:
        while not ended.wait(0.02):
            for target in planner.seen:
                measured(run, target.id, end)

    teller = threading.Thread(target=tell)
    teller.start()
    try:
        assert (execute(["send", "walk two metres", "--wait", "--port", str(gateway.port)]) == 0) == (code == 0)
        assert line in capsys.readouterr().out
        execute(["send", "walk two metres", "--wait", "--take", "--json", "--port", str(gateway.port)])
    finally:
        ended.set()
        teller.join()
    _, found = capsys.readouterr().out.split("}\n", 1)
    assert json.loads(found)["end"] == end
