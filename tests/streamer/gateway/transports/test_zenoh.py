"""Messages, status and stops over zenoh: real sessions on 127.0.0.1."""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from flexmotion.configs.errors import ConfigError, GatewayError
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.cli import execute
from flexmotion.streamer.gateway.messages import KINDS
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.proofs import Prover
from flexmotion.streamer.gateway.status import Status
from flexmotion.streamer.gateway.transports.zenoh_client import ZenohClient
from flexmotion.streamer.gateway.transports.zenoh_link import zenoh_links
from flexmotion.streamer.gateway.transports.zenoh_stops import ZenohStops
from flexmotion.streamer.gateway.transports.zenoh_targets import ZenohTargets
from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.run.requests import Request

from ....waiting import HANGING_S, wait_until
from .conftest import Serve, Served, open_session

zenoh = pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra 'zenoh')")

TOKEN = "correct horse battery"


class Network:
    """Two processes of a run in one, reached over zenoh."""

    def __init__(self, serve: Serve, token: str | None = None, router: str | None = None, **fields: Any) -> None:
        settings = Gateway.model_validate({"zenoh_port": any_free(), "zenoh_stop_port": any_free(), **fields})
        targets, stops = zenoh_links("op3", "127.0.0.1", token, settings, router)
        self.gate, self.stop_gate = targets.listen, stops.listen
        self.served: Served = serve((ZenohTargets(targets),), (ZenohStops(stops),), **fields)

    def client(self, sessions: ExitStack, *, router: str | None = None, token: str | None = None) -> Client:
        session = sessions.enter_context(open_session([router or self.gate]))
        client = Client(session, token)
        wait_until(lambda: client.alive() == {"gateway", "stops"}, "both processes to be seen over zenoh")
        return client


class Client:
    """An operator."""

    def __init__(self, session: Any, token: str | None) -> None:
        self.session = session
        self.prover = None if token is None else Prover(token)

    def alive(self) -> set[str]:
        found = self.session.liveliness().get("flexmotion/op3/alive/*", timeout=1.0)
        return {str(reply.ok.key_expr).rpartition("/")[2] for reply in found if reply.ok is not None}

    def ask(self, key: str, content: Any = None) -> Any:
        key, data = f"flexmotion/op3/{key}", content if isinstance(content, bytes) else json.dumps(content).encode()
        replies = list(self.session.get(key, payload=data, attachment=self.proof(key, data), timeout=HANGING_S))
        assert len(replies) == 1, "expected one reply"
        return json.loads(replies[0].ok.payload.to_bytes())

    def put(self, key: str, content: Any) -> None:
        key, data = f"flexmotion/op3/{key}", content if isinstance(content, bytes) else json.dumps(content).encode()
        self.session.put(key, data, attachment=self.proof(key, data), congestion_control=zenoh.CongestionControl.BLOCK)

    def proof(self, key: str, data: bytes) -> str | None:
        return None if self.prover is None else self.prover.prove(key, data)

    def answers(self, operator: str) -> list[Any]:
        found: list[Any] = []
        self.session.declare_subscriber(
            f"flexmotion/op3/answers/{operator}", lambda sample: found.append(json.loads(sample.payload.to_bytes()))
        )
        return found

    def wait_for_answers(self, operator: str, answers: list[Any]) -> None:
        """Wait until answers on the operator's key are heard here; then none of those to its own messages are left.

        A subscriber is known to the gateway some time after it was declared, and an answer before that is lost.
        """
        probes: list[str] = []

        def probe() -> bool:
            probes.append(f"probe {len(probes)}")
            self.put(f"targets/{operator}", {"type": "take", "id": probes[-1]})
            return bool(answers)

        wait_until(probe, "the subscriber to be known", every_s=0.2)
        wait_until(lambda: any(answer.get("id") == probes[-1] for answer in answers), "the answer to the last probe")
        answers[:] = [answer for answer in answers if answer.get("id") not in probes]


@pytest.fixture
def sessions() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def test_a_query_is_answered_by_its_reply_and_a_put_on_the_operators_key(serve: Serve, sessions: ExitStack) -> None:
    network = Network(serve)
    client = network.client(sessions)
    answer = client.ask("targets/alice", {"type": "text", "text": "wave", "id": "1"})
    assert (answer["id"], answer["state"], answer["heard_as"]) == ("1", "accepted", "wave")
    answers = client.answers("alice")
    client.wait_for_answers("alice", answers)
    client.put("targets/alice", {"type": "hold", "id": "2"})
    wait_until(lambda: answers, "the answer to a put")
    assert (answers[0]["id"], answers[0]["source"], answers[0]["state"]) == ("2", "alice", "accepted")
    assert network.served.loop.seen[0].intent == Text("wave")


def test_the_key_says_who_sends(serve: Serve, sessions: ExitStack) -> None:
    """A source that is only named in the message could take any other's priority."""
    client = Network(serve, priorities={"rescue": 1}).client(sessions)
    assert client.ask("targets/rescue", {"type": "take"})["state"] == "accepted"
    answer = client.ask("targets/mallory", {"type": "text", "text": "wave", "source": "rescue"})
    assert (answer["source"], answer["state"]) == ("mallory", "refused") and "'rescue' is the operator" in answer[
        "reason"
    ]


def test_every_type_of_message_is_answered_and_so_is_what_is_none(serve: Serve, sessions: ExitStack) -> None:
    client = Network(serve).client(sessions)
    for kind in KINDS:
        answer = client.ask("targets/alice", {"type": kind, "id": kind})
        assert answer["id"] == kind and answer["state"] in ("accepted", "refused")
    for data in (b"", b"no message", b"[]", b"\xff\x00", b"[" * 3000, json.dumps("x" * 10_000).encode()):
        assert client.ask("targets/alice", data)["state"] == "refused"
    assert client.ask("status")["counts"]["rejected: too large"] == 1


def test_two_hundred_targets_are_all_answered(serve: Serve, sessions: ExitStack) -> None:
    network = Network(serve)
    client = network.client(sessions)
    answers = client.answers("alice")
    client.wait_for_answers("alice", answers)
    ids = [str(number) for number in range(200)]
    for number in ids:
        client.put("targets/alice", {"type": "velocity", "velocity": [0.1 + int(number) % 9 / 10, 0, 0], "id": number})
    wait_until(lambda: len(answers) >= 200, "all answers")
    assert sorted(answer["id"] for answer in answers) == sorted(ids)
    assert {answer["state"] for answer in answers} == {"accepted", "superseded"}


def test_the_status_is_told_to_who_asks_and_who_reads(serve: Serve, sessions: ExitStack) -> None:
    client = Network(serve).client(sessions)
    assert client.ask("status")["robot"] == "op3"
    read: list[Any] = []
    client.session.declare_subscriber("flexmotion/*/status", lambda sample: read.append(sample.payload.to_bytes()))
    wait_until(lambda: len(read) >= 3, "the status to be published")
    assert json.loads(read[0])["loop"] == "ticks"
    assert set(json.loads(read[0])) == set(client.ask("status")) == set(Status.model_fields)


def test_the_command_prints_the_status_over_zenoh(
    serve: Serve, sessions: ExitStack, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ended in a traceback, KeyError: 'cause': over zenoh the status had no key for what is not known."""
    monkeypatch.setattr("flexmotion.streamer.gateway.transports.zenoh_client.PATIENCE_S", HANGING_S)
    assert execute(["status", "--zenoh", Network(serve).gate]) == 0
    assert "op3 on sim" in capsys.readouterr().out


def test_stops_reach_the_stop_process_with_the_gateway_dead(serve: Serve, sessions: ExitStack) -> None:
    network = Network(serve)
    session = sessions.enter_context(open_session([network.gate, network.stop_gate], "peer"))
    client = Client(session, None)
    wait_until(lambda: client.alive() == {"gateway", "stops"}, "both processes to be seen over zenoh")
    answer = client.ask("stop")
    assert (answer["asked"], answer["state"]) == ("stop", "accepted") and answer["tick"] > answer["arrived_tick"] >= 0
    network.served.ends.pop()(True)
    wait_until(lambda: client.alive() == {"stops"}, "the gateway to be gone")
    answers = client.answers("estop")
    # Again and again: an answer before the subscriber is known to the stop process is lost.
    wait_until(lambda: client.put("estop", b"") or answers, "the answer to the emergency stop", every_s=0.2)
    assert answers[0]["state"] == "accepted"
    first, *others = network.served.loop.requested
    assert first is Request.STOP and set(others) == {Request.ESTOP}


def test_a_client_that_knows_the_gateway_alone_reaches_the_stop_process(serve: Serve, sessions: ExitStack) -> None:
    network = Network(serve)
    client = network.client(sessions)
    assert client.ask("estop")["state"] == "accepted"
    assert network.served.loop.requested == [Request.ESTOP]


def test_without_the_token_a_stop_is_taken_and_nothing_else(serve: Serve, sessions: ExitStack) -> None:
    network = Network(serve, TOKEN)
    client, stranger = network.client(sessions, token=TOKEN), network.client(sessions, token="wrong wrong wrong")
    assert stranger.ask("stop")["state"] == "accepted"
    for key, content in (("estop", None), ("targets/alice", {"type": "text", "text": "wave"}), ("status", None)):
        assert "token" in stranger.ask(key, content)["reason"]
    stranger.put("estop", b"")
    assert network.served.loop.requested == [Request.STOP] and network.served.loop.seen == []
    assert client.ask("status")["counts"]["rejected: token"] == 2
    assert client.ask("estop")["state"] == "accepted"


def test_who_reads_a_message_on_the_router_cannot_send_it_again(
    serve: Serve, sessions: ExitStack, start_router: Callable[[str], subprocess.Popen[str]]
) -> None:
    """The token was the attachment of each message: every subscriber of the router read it, and could steer."""
    endpoint = f"tcp/127.0.0.1:{any_free()}"
    start_router(endpoint)
    network = Network(serve, TOKEN, endpoint)
    client, listener = network.client(sessions, router=endpoint, token=TOKEN), open_session([endpoint])
    sessions.enter_context(listener)
    read: list[Any] = []
    listener.declare_subscriber("flexmotion/**", read.append)
    answers = client.answers("*")
    # A message that the router gave to the listener alone is not one that is sent again: the words are put after both
    # were seen to read.
    wait_until(lambda: client.put("targets/alice", {"type": "take"}) or read, "the listener to read along", every_s=0.2)
    client.wait_for_answers("alice", answers)
    answers.clear()
    client.put("targets/alice", {"type": "text", "text": "wave"})
    wait_until(lambda: answers, "the words to be answered")
    assert answers[0]["state"] == "accepted"
    client.put("estop", b"")
    wait_until(lambda: any(str(one.key_expr).endswith("/estop") for one in read), "the emergency stop to be read")
    wait_until(lambda: network.served.loop.requested == [Request.ESTOP], "the emergency stop")
    sent = [one for one in read if one.attachment is not None and b'"take"' not in one.payload.to_bytes()]
    assert len(sent) == 2 and not any(TOKEN.encode() in one.attachment.to_bytes() for one in sent)
    before = len(network.served.loop.seen)
    for one in sent:
        key, data, proof = str(one.key_expr), one.payload.to_bytes(), one.attachment.to_bytes()
        listener.put(key, data, attachment=proof)
        if "targets" in key:
            listener.put(key, json.dumps({"type": "clear"}), attachment=proof)
            listener.put(key.replace("alice", "mallory"), data, attachment=proof)
    # The answer to the emergency stop itself, from another process, may come among them.
    wait_until(lambda: sum(answer["state"] == "refused" for answer in answers) >= 3 + 1, "all to be refused")
    assert len(network.served.loop.seen) == before and network.served.loop.requested == [Request.ESTOP]


def test_a_process_is_seen_once_it_can_be_asked(
    serve: Serve, sessions: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stop process declared its token first: who saw it sent an emergency stop, and nobody was there to take it."""
    declared: list[list[str]] = []
    opens = zenoh.open

    class Recording:
        def __init__(self, session: Any) -> None:
            self.session, self.calls = session, []
            declared.append(self.calls)

        def __getattr__(self, name: str) -> Any:
            if name.startswith("declare_") or name == "liveliness":
                self.calls.append(name)
            return getattr(self.session, name)

    monkeypatch.setattr(zenoh, "open", lambda config: Recording(opens(config)))
    network = Network(serve)
    wait_until(lambda: sum("liveliness" in calls for calls in declared) == 2, "both processes")
    monkeypatch.setattr(zenoh, "open", opens)
    assert network.client(sessions).ask("stop")["state"] == "accepted"
    for calls in declared:
        assert calls[-1] == "liveliness" and calls.count("declare_queryable") == 2


def test_a_session_that_is_lost_or_cannot_be_served_is_opened_again(
    serve: Serve, sessions: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error while the session was set up ended its thread: no stop came over zenoh, and nobody was told."""
    opened, opens = [], zenoh.open
    errors = [RuntimeError("no room"), RuntimeError("no room")]

    class Failing:
        def __init__(self, session: Any) -> None:
            self.session = session

        def __getattr__(self, name: str) -> Any:
            if name == "liveliness" and errors:
                raise errors.pop()
            return getattr(self.session, name)

    def open_failing(config: Any) -> Any:
        opened.append(opens(config))
        return Failing(opened[-1]) if errors else opened[-1]

    monkeypatch.setattr(zenoh, "open", open_failing)
    network = Network(serve)
    wait_until(lambda: not errors, "both failures")
    client = network.client(sessions)
    assert client.ask("estop")["state"] == "accepted"
    loop = network.served.loop
    assert Request.WARNING in loop.requested and Request.ESTOP in loop.requested
    stops = network.served.stops.health
    wait_until(lambda: stops.problems()["stops over zenoh"] == "works", "the way to work again")
    told: list[tuple[str, str]] = []
    fails = Way.fails
    monkeypatch.setattr(Way, "fails", lambda way, reason: (told.append((way.name, reason)), fails(way, reason)))
    for session in opened:
        if session is not client.session:
            session.close()
    # Every reason that was told, not the present one: it works again before a slow machine looks.
    lost = ("stops over zenoh", "session was closed")
    wait_until(lambda: any(name == lost[0] and lost[1] in why for name, why in told), "the loss to be noticed")
    wait_until(lambda: client.alive() == {"gateway", "stops"}, "both to be back")
    assert client.ask("stop")["state"] == "accepted"


def test_the_client_and_the_command_line_speak_zenoh(
    serve: Serve, sessions: ExitStack, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    network = Network(serve, TOKEN)
    monkeypatch.setattr("flexmotion.streamer.gateway.transports.zenoh_client.PATIENCE_S", HANGING_S)
    with ZenohClient(network.gate, source="alice", token=TOKEN) as robot:
        answer = robot.text("wave")
        assert (answer.source, answer.state, answer.heard_as) == ("alice", "accepted", "wave")
        assert robot.status()["operator"] == "alice" and robot.stop().state == "accepted"
        assert robot.clear().state == "accepted"
    with ZenohClient(network.gate, network.stop_gate, token="wrong horse battery") as stranger:
        assert stranger.text("wave").state == stranger.estop().state == "refused"
        assert stranger.stop().state == "accepted"
        with pytest.raises(GatewayError, match="the proof is not one of this run's token"):
            stranger.status()
    with ZenohClient(network.gate) as stranger, pytest.raises(GatewayError, match="set FLEXMOTION_TOKEN"):
        stranger.status()
    monkeypatch.setenv("FLEXMOTION_TOKEN", TOKEN)
    over = ["--zenoh", network.gate]
    assert execute(["clear", *over, "--source", "alice"]) == 0
    assert execute(["send", "wave", *over, "--take"]) == 0 and execute(["estop", *over, "--json"]) == 0
    assert network.served.loop.requested[-1] is Request.ESTOP and "heard as wave" in capsys.readouterr().out
    assert execute(["send", "wave", *over, "--source", "a/b"]) == 2
    assert "a part of a key" in capsys.readouterr().err
    capsys.readouterr()
    assert execute(["stop", "--zenoh", f"tcp/127.0.0.1:{any_free()}"]) == 3
    assert execute(["stop", "--zenoh", "nonsense"]) == 3
    told = capsys.readouterr().err
    assert "of the form <protocol>/<address>" in told and ".rs" not in told


def test_a_reader_that_takes_nothing_stalls_nobody(serve: Serve, sessions: ExitStack) -> None:
    """Its buffers ran full after 18,000 answers, and those to all others waited behind: 5 s and more."""
    network = Network(serve)
    client = network.client(sessions)
    awake = threading.Event()
    slow = open_session([network.gate])
    try:
        slow.declare_subscriber(
            "flexmotion/op3/answers/slow", zenoh.handlers.Callback(lambda _sample: awake.wait(), indirect=False)
        )
        answered = 0
        publisher = client.session.declare_publisher("flexmotion/op3/answers/slow")
        wait_until(lambda: publisher.matching_status.matching, "the slow reader to be known")
        while publisher.matching_status.matching:  # until the gateway has closed its connection
            for _ in range(100):
                client.put("targets/slow", {"type": "hold", "id": "x" * 64})
            answered += client.ask("targets/slow", {"type": "hold"})["state"] in ("accepted", "superseded")
        assert answered and client.ask("targets/slow", {"type": "text", "text": "wave"})["state"] == "accepted"
        assert client.ask("stop")["state"] == "accepted"
    finally:
        awake.set()
        slow.close()


def test_a_program_that_is_started_again_numbers_its_messages_anew(serve: Serve, sessions: ExitStack) -> None:
    """Its messages were refused as old: the numbers of the program before it were remembered by the operator's name."""
    network = Network(serve, TOKEN)
    for _ in range(2):
        client = network.client(sessions, token=TOKEN)
        for number in (1, 2):
            message = {"type": "text", "text": "wave", "sequence": number}
            assert client.ask("targets/alice", message)["state"] == "accepted"


def test_a_router_that_is_killed_and_comes_back_is_used_again(
    serve: Serve, sessions: ExitStack, start_router: Callable[[str], subprocess.Popen[str]]
) -> None:
    endpoint = f"tcp/127.0.0.1:{any_free()}"
    network = Network(serve, router=endpoint, zenoh_open_router=True)  # it waits for its router
    router = start_router(endpoint)
    client = network.client(sessions, router=endpoint)
    assert client.ask("targets/alice", {"type": "text", "text": "wave"})["state"] == "accepted"
    router.kill()
    router.communicate()
    wait_until(lambda: not client.alive(), "the router's end to be noticed")
    assert list(client.session.get("flexmotion/op3/targets/alice", payload=b"{}", timeout=1.0)) == []
    # Meanwhile a direct connection goes on.
    assert network.client(sessions).ask("status")["robot"] == "op3"
    start_router(endpoint)
    wait_until(lambda: client.alive() == {"gateway", "stops"}, "both processes to be back")
    assert client.ask("targets/alice", {"type": "text", "text": "wave"})["state"] == "accepted"
    assert client.ask("estop")["state"] == "accepted"


def test_nobody_is_listened_to_and_no_router_is_used_without_a_token() -> None:
    """A router on this machine asked for no token, and listened to a whole network."""
    settings = Gateway(zenoh_port=any_free(), zenoh_stop_port=any_free())
    with pytest.raises(ConfigError, match="needs a token"):
        zenoh_links("op3", "0.0.0.0", None, settings)
    for router in ("tcp/192.168.0.10:7447", "tcp/127.0.0.1:7447"):
        with pytest.raises(
            ConfigError, match="whoever reaches this router could steer the robot: set FLEXMOTION_TOKEN"
        ):
            zenoh_links("op3", "127.0.0.1", None, settings, router)
        chosen = settings.model_copy(update={"zenoh_open_router": True})
        assert zenoh_links("op3", "127.0.0.1", None, chosen, router)[0].connect[0] == router
    with pytest.raises(ConfigError, match="expected PROTOCOL/HOST:PORT"):
        zenoh_links("op3", "127.0.0.1", None, settings, "192.168.0.10")
    zenoh_links("op3", "127.0.0.1", TOKEN, settings, "tcp/[fe80::1]:7447")
