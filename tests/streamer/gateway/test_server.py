"""HTTP and WebSocket: real connections on 127.0.0.1 to a gateway whose planner and loop are the test's."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from collections.abc import Callable
from http.client import HTTPConnection
from types import SimpleNamespace
from typing import Any, cast

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.sync.server import serve

from flexmotion.configs.errors import ConfigError, DriverError, GatewayError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.cli import execute
from flexmotion.streamer.commands.streaming import stream
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.async_client import AsyncClient
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.messages import KINDS, MessageError
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.server import Connections
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.motion.intents import Text, Velocity
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

from ...waiting import HANGING_S, wait_until
from .conftest import Answering, Begin, Office, Run

TOKEN = "correct horse battery"


def http(port: int, method: str, path: str, body: bytes = b"", **headers: str) -> tuple[int, Any]:
    connection = HTTPConnection("127.0.0.1", port, timeout=HANGING_S)
    connection.request(method, path, body, headers)
    response = connection.getresponse()
    content = response.read()
    connection.close()
    return response.status, json.loads(content) if content.startswith(b"{") else content.decode()


def answered(client: ClientConnection) -> Any:
    """The next answer; what else the gateway tells is passed over."""
    while (told := json.loads(client.recv(HANGING_S)))["type"] != "answer":
        pass
    return told


def counts(port: int, **headers: str) -> dict[str, int]:
    return dict(http(port, "GET", "/status", **headers)[1]["counts"])


class _Socket:
    """A connection that sends one message and closes."""

    open = False

    async def accept(self) -> None: ...

    async def receive(self) -> dict[str, str]:
        self.open = not self.open
        return (
            {"type": "websocket.receive", "text": '{"type":"hold","sequence":1}'}
            if self.open
            else {"type": "websocket.disconnect"}
        )

    async def send_text(self, text: str) -> None: ...


@pytest.mark.parametrize("frame", ["no JSON", "[]", '{"type":"answer","state":"perhaps"}', b"\xff"])
def test_a_frame_that_is_no_answer_is_told(frame: str | bytes) -> None:
    """It ended the asynchronous client's reader, and whoever waited for an answer waited ten seconds for nothing."""

    def answer(connection: Any) -> None:
        connection.recv()
        connection.send(frame)

    with serve(answer, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        port = server.socket.getsockname()[1]

        async def ask() -> None:
            async with AsyncClient(port=port) as client:
                with pytest.raises(GatewayError, match="the run sent what is no answer"):
                    await client.hold()
                with pytest.raises(GatewayError, match="the run sent what is no answer"):
                    await client.hold()

        asyncio.run(ask())
        with Client(port=port) as client, pytest.raises(GatewayError, match=str(port)):
            client.hold()
        server.shutdown()


def test_each_connection_numbers_its_messages_anew(make_office: Callable[..., Office]) -> None:
    """A new connection was refused as old: it was known by its address in memory, which a closed one had had."""
    desk = make_office().desk
    connections = Connections(desk, lambda: None, lambda: None)  # type: ignore[arg-type, return-value]
    socket = _Socket()  # the same one twice: the second has the address of the first
    for _ in range(2):
        asyncio.run(connections.serve(socket, 0.0))  # type: ignore[arg-type]
    assert desk.counts["received"] == 2 and desk.counts["refused"] == 0


def test_a_message_over_each_way_is_answered(begin: Begin, answering: Callable[..., Answering]) -> None:
    gateway = begin()
    planner = answering(gateway.requests)
    with connect(f"ws://127.0.0.1:{gateway.port}/targets") as client:
        client.send('{"type":"text","text":"wave","id":"1"}')
        answer = answered(client)
        assert (answer["id"], answer["state"], answer["heard_as"]) == ("1", "accepted", "wave")
        client.send(b'{"type":"stop","id":"2"}')
        assert answered(client)["state"] == "accepted"
        client.send("no message")
        assert answered(client)["state"] == "refused"
    assert planner.requested == [Request.STOP]
    status, answer = http(gateway.port, "POST", "/clear")
    assert (status, answer["state"]) == (200, "accepted")
    status, answer = http(gateway.port, "POST", "/velocity", b'{"velocity":[0.2,0,0]}')
    assert (status, answer["asked"], answer["state"]) == (200, "velocity", "accepted")
    status, answer = http(gateway.port, "POST", "/targets", b'{"type":"waypoint","position_m":[1e9,0]}')
    assert (status, answer["state"]) == (409, "refused")
    assert http(gateway.port, "POST", "/velocity", b'{"type":"stop"}')[0] == 200  # its own type counts
    assert http(gateway.port, "POST", "/text", b"[]")[0] == 422
    assert [target.intent for target in planner.seen] == [Text("wave"), Velocity(0.2, 0.0, 0.0)]


def test_a_thousand_targets_are_all_answered(begin: Begin, answering: Callable[..., Answering]) -> None:
    gateway = begin(most_unread=2000)
    answering(gateway.requests)
    ids = [str(number) for number in range(1000)]
    with connect(f"ws://127.0.0.1:{gateway.port}/targets") as client:
        for number in ids:
            client.send(f'{{"type":"velocity","velocity":[0.{int(number) % 9 + 1},0,0],"id":"{number}"}}')
        answers = [answered(client) for _ in ids]
    assert sorted(answer["id"] for answer in answers) == sorted(ids)
    assert {answer["state"] for answer in answers} == {"accepted", "superseded"}
    assert next(answer for answer in answers if answer["id"] == ids[-1])["state"] == "accepted"


def test_a_sender_without_a_pause_keeps_no_other_out(begin: Begin, answering: Callable[..., Answering]) -> None:
    """Messages of one socket that is never empty kept the gateway from answering anyone."""
    gateway = begin(most_unread=100_000, priorities={"quick": 1})
    loop = answering(gateway.requests)
    ended = threading.Event()

    def flood() -> None:
        with connect(f"ws://127.0.0.1:{gateway.port}/targets", max_queue=None) as client:
            while not ended.is_set():
                client.send('{"type":"velocity","velocity":[0.3,0,0]}')

    flooding = threading.Thread(target=flood)
    flooding.start()
    try:
        wait_until(lambda: len(loop.seen) > 5, "the first targets")
        with Client(port=gateway.port, source="quick") as client:
            assert client.ask({"type": "stop"}).state == "accepted"
        assert http(gateway.port, "GET", "/status")[1]["loop"] == "ticks"
    finally:
        ended.set()
        flooding.join()
    assert loop.requested == [Request.STOP]


def test_the_status_and_the_documents(begin: Begin, run: Run, answering: Callable[..., Answering]) -> None:
    gateway = begin()
    assert http(gateway.port, "GET", "/status")[1]["loop"] == "silent"
    answering(gateway.requests)
    wait_until(lambda: http(gateway.port, "GET", "/status")[1]["loop"] == "ticks", "the loop's rows")
    _, status = http(gateway.port, "GET", "/status")
    assert (status["robot"], status["driver"], status["state"], status["stop_port"]) == ("op3", "sim", "STREAMING", 1)
    _, described = http(gateway.port, "GET", "/openapi.json")
    assert {f"/{word}" for word in KINDS} | {"/targets", "/status"} <= described["paths"].keys()
    _, page = http(gateway.port, "GET", "/docs")
    assert all(f"POST /{word}" in page for word in KINDS) and "<script" not in page
    # An address that is not known was answered {"detail": "Not Found"}.
    code, unknown = http(gateway.port, "GET", "/nowhere")
    assert code == 404 and "'/nowhere': expected one of: " in unknown["reason"] and "/velocity" in unknown["reason"]
    with connect(f"ws://127.0.0.1:{gateway.port}/targets?status=50") as client:
        told = [json.loads(client.recv(HANGING_S)) for _ in range(3)]
    assert [one["type"] for one in told] == ["status"] * 3 and told[2]["tick"] > told[0]["tick"]


def test_a_run_whose_servo_bus_is_silent_is_not_well(
    begin: Begin, run: Run, answering: Callable[..., Answering], op3: Robot
) -> None:
    """`GET /health` answered 200 beside a FAULT, with the bus gone."""
    gateway = begin()
    silent = op3.safety.max_stale_reads + 1
    run.telemetry.row.stale[...] = silent, 0, silent
    loop = answering(gateway.requests)
    wait_until(lambda: http(gateway.port, "GET", "/status")[1]["loop"] == "ticks", "the loop's rows")
    assert http(gateway.port, "GET", "/health") == (200, {"ok": True, "loop": "ticks", "bus": "works", "ways": {}})
    run.telemetry.row.stale[...] = silent
    tick = run.tick
    wait_until(lambda: run.tick > tick + 1, "a row with it")
    status, told = http(gateway.port, "GET", "/health")
    assert status == 503 and not told["ok"] and told["bus"] == f"no joint has answered for {silent} reads"
    loop.close()


def test_a_change_of_operator_is_told_to_all(begin: Begin, answering: Callable[..., Answering]) -> None:
    gateway = begin()
    answering(gateway.requests)
    with connect(f"ws://127.0.0.1:{gateway.port}/targets") as watching:
        watching.ping().wait(HANGING_S)
        with Client(port=gateway.port, source="page") as page, Client(port=gateway.port, source="phone") as phone:
            assert page.text("wave").state == "accepted"
            assert "'page' is the operator" in str(phone.text("wave").reason)
            assert phone.take().took_lease_from == "page"
        told = [json.loads(watching.recv(HANGING_S)) for _ in range(2)]
    assert [(one["before"], one["operator"]) for one in told] == [(None, "page"), ("page", "phone")]


def test_a_page_from_elsewhere_cannot_steer_the_robot(begin: Begin, answering: Callable[..., Answering]) -> None:
    gateway = begin()
    planner = answering(gateway.requests)
    address, wave = f"ws://127.0.0.1:{gateway.port}/targets", b'{"text":"wave"}'
    with pytest.raises(InvalidStatus) as refused:
        connect(address, origin="https://evil.example")  # type: ignore[arg-type]
    assert refused.value.response.status_code == 403
    assert http(gateway.port, "POST", "/text", wave, Origin="https://evil.example")[0] == 403
    assert http(gateway.port, "POST", "/text", wave, Host="evil.example")[0] == 403
    assert planner.seen == []
    found = counts(gateway.port)
    assert (found["rejected: origin"], found["rejected: host"]) == (2, 1)


def test_without_the_token_nothing_is_admitted(begin: Begin, answering: Callable[..., Answering]) -> None:
    gateway = begin(TOKEN)
    planner = answering(gateway.requests)
    status, told = http(gateway.port, "POST", "/text", b'{"text":"wave"}')
    assert status == 401 and "Authorization: Bearer" in told["reason"]
    # It said "server rejected WebSocket connection: HTTP 403", which no user can mend.
    with pytest.raises(GatewayError, match="refuses the connection: it needs its token: set FLEXMOTION_TOKEN"):
        Client(port=gateway.port).text("wave")
    with pytest.raises(GatewayError, match="refuses the connection: the token is not that of this run"):
        Client(port=gateway.port, token="another token here").text("wave")
    with pytest.raises(GatewayError, match="refused: the token is not that of this run"):
        Client(port=gateway.port, token="another token here").status()
    with Client(port=gateway.port, token=TOKEN) as client:
        assert client.text("wave").state == "accepted"
    with connect(f"ws://127.0.0.1:{gateway.port}/targets?token=correct%20horse%20battery") as page:
        page.send('{"type":"hold","source":"client"}')
        assert answered(page)["state"] == "accepted"
    assert len(planner.seen) == 2
    assert counts(gateway.port, Authorization=f"Bearer {TOKEN}")["rejected: token"] == 6


def test_messages_that_are_too_large_are_refused_and_counted(begin: Begin, answering: Callable[..., Answering]) -> None:
    gateway = begin(most_bytes=512)
    answering(gateway.requests)
    large = b'{"text":"' + b"a" * 600 + b'"}'
    assert http(gateway.port, "POST", "/text", large)[0] == 413
    with connect(f"ws://127.0.0.1:{gateway.port}/targets", max_size=None) as client:
        client.send(large.decode())
        assert answered(client)["reason"] == "611 bytes, expected at most 512"
        client.send("x" * 20_000)  # beyond what the server reads at all
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                client.recv(HANGING_S)
    assert closed.value.rcvd is not None and closed.value.rcvd.code == 1009
    assert counts(gateway.port)["rejected: too large"] == 2
    with Client(port=gateway.port) as client:
        assert client.text("wave").state == "accepted"


def test_a_client_that_does_not_read_is_cut_and_others_are_served(
    begin: Begin, answering: Callable[..., Answering]
) -> None:
    """Its answers filled the gateway's memory."""
    gateway = begin(most_unread=10)
    answering(gateway.requests)
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=HANGING_S) as raw:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        raw.sendall(
            b"GET /targets HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
        )
        assert raw.recv(12) == b"HTTP/1.1 101"
        frame = b"\x81\x82\x00\x00\x00\x00{}"  # a masked text frame that is refused, with an answer of 400 bytes

        def cut() -> bool:
            try:
                raw.send(frame * 50)
            except OSError:
                return True
            return counts(gateway.port).get("rejected: slow reader", 0) > 0

        wait_until(cut, "the client that does not read to be cut")
    wait_until(lambda: counts(gateway.port).get("rejected: slow reader") == 1, "the count")
    with Client(port=gateway.port) as client:
        assert client.text("wave").state == "accepted"


def test_further_connections_than_admitted_are_refused(begin: Begin) -> None:
    gateway = begin(most_connections=2)
    address = f"ws://127.0.0.1:{gateway.port}/targets"
    with connect(address), connect(address):
        with pytest.raises(InvalidStatus):
            connect(address)
        assert counts(gateway.port)["rejected: too many connections"] == 1


def test_a_client_that_leaves_in_the_middle_of_a_message_is_counted(
    begin: Begin, capfd: pytest.CaptureFixture[str]
) -> None:
    """Each wrote a traceback of 75 lines to the run's stderr."""
    gateway = begin()
    with socket.create_connection(("127.0.0.1", gateway.port)) as half:
        half.sendall(b'POST /text HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 60\r\n\r\n{"text":"wal')
        wait_until(lambda: counts(gateway.port) is not None, "the gateway to answer beside it")
    wait_until(lambda: counts(gateway.port).get("rejected: left") == 1, "the count")
    assert capfd.readouterr().err == ""


def test_a_port_that_is_taken_is_told_before_the_run(begin: Begin, run: Run, op3: Robot) -> None:
    gateway = begin()
    with pytest.raises(
        ConfigError, match=rf"--web-port: 127.0.0.1:{gateway.port} cannot be listened on: .*another port"
    ):
        GatewayService(op3, "sim", Gateway(), run.telemetry, run.targets, run.heard, Admission(), port=gateway.port)


def test_an_asynchronous_client(begin: Begin, answering: Callable[..., Answering]) -> None:
    import asyncio

    gateway = begin()
    answering(gateway.requests)

    async def asking() -> list[str]:
        async with AsyncClient(port=gateway.port) as client:
            answers = await asyncio.gather(*(client.velocity(0.1 + k / 100, 0.0, 0.0) for k in range(20)))
            return [answer.state for answer in answers]

    states = asyncio.run(asking())
    assert states[-1] == "accepted" and set(states) <= {"accepted", "superseded"}


def test_the_asynchronous_client_offers_what_the_other_does(begin: Begin, answering: Callable[..., Answering]) -> None:
    """It had no `stop`, `estop`, `status`, `take`, `release` and `kill`."""
    assert {name for name in dir(Client) if not name.startswith("_")} - {"close"} <= set(dir(AsyncClient))
    gateway = begin()
    answering(gateway.requests)

    async def operate() -> list[str]:
        async with AsyncClient(port=gateway.port, source="b") as robot, AsyncClient(port=gateway.port) as other:
            answers = [await other.hold(), await robot.hold(), await robot.take(), await robot.hold()]
            assert (await robot.status())["operator"] == "b"
            with pytest.raises(GatewayError, match="1: no run listens"):
                await robot.stop()
            return [answer.state for answer in [*answers, await robot.release()]]

    assert asyncio.run(operate()) == ["accepted", "refused", "accepted", "accepted", "accepted"]


def test_a_program_confirms_that_the_robot_will_fall() -> None:
    """`Client().kill()` cut the torque, though every other way to do so asks first."""
    for client in (Client, AsyncClient):
        with pytest.raises(TypeError, match="confirm"):
            client().kill()  # type: ignore[call-arg]
    with pytest.raises(MessageError, match="expected 'the robot will fall'"):
        Client(port=any_free()).kill(confirm="yes")


def test_what_is_no_message_is_named() -> None:
    """`ask("wave")` ended in an AttributeError."""
    with pytest.raises(MessageError, match="'wave', expected a mapping"):
        Client(port=any_free()).ask("wave")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("address", "here", "elsewhere"),
    [
        ("127.0.0.1", "http://127.0.0.1", None),
        ("0.0.0.0", "http://localhost", "http://ADDRESS-OF-THIS-MACHINE"),
        ("::", "http://localhost", "http://ADDRESS-OF-THIS-MACHINE"),
    ],
)
def test_the_page_is_named_by_an_address_that_can_be_opened(
    run: Run, op3: Robot, address: str, here: str, elsewhere: str | None
) -> None:
    """It printed http://0.0.0.0:8790, which no phone can open, and nothing of the token."""
    listens, port = Admission(address, TOKEN), any_free()
    service = GatewayService(
        op3, "sim", Gateway(), run.telemetry, run.targets, run.heard, listens, port=port, stop_port=1
    )
    assert service.url == f"{here}:{port}"
    assert service.far_url == (None if elsewhere is None else f"{elsewhere}:{port}/#token=TOKEN")


def test_the_address_is_printed_once_the_page_can_be_opened(
    run: Run, op3: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was printed seconds before the port was open, and `flexmotion send` said that no run listens."""

    class Started:
        """A session whose gateway listens some polls after the run has begun."""

        robot, source, seconds, stay, next_request = op3, SimpleNamespace(name="a test"), None, True, None

        def __init__(self) -> None:
            self.services = (
                GatewayService(
                    op3, "sim", Gateway(), run.telemetry, run.targets, run.heard, Admission(), port=any_free()
                ),
            )

        def run(self) -> None:
            gateway = self.services[0]
            assert self.next_request is not None and not gateway.listens
            self.next_request()
            assert "web:" not in capsys.readouterr().err
            end = gateway.follow()
            try:
                wait_until(lambda: gateway.listens, "the gateway to listen")
                self.next_request()
                assert f"web: {gateway.url}" in capsys.readouterr().err
                with connect(f"ws://127.0.0.1:{gateway.port}/targets"):
                    pass
                self.next_request()
                assert not capsys.readouterr().err  # once
            finally:
                end(True)
            raise DriverError("the test is over")

    with pytest.raises(DriverError, match="the test is over"):
        stream(cast(Session, Started()))


def test_a_machine_that_nobody_knows_is_told_in_words() -> None:
    """It said "gaierror: [Errno -2]"."""
    with pytest.raises(GatewayError, match="robot.invalid:8790: no machine of this name is known"):
        Client("robot.invalid").text("wave")


def test_a_client_without_a_run_says_how_to_start_one() -> None:
    with pytest.raises(GatewayError, match="no run listens; start one with: flexmotion dry-run --web"):
        Client(port=any_free()).text("wave")
    with pytest.raises(MessageError, match="velocity.0"):
        Client(port=any_free()).velocity(99.0, 0.0, 0.0)


def test_the_command_line_sends_and_exits_by_the_answer(
    begin: Begin, answering: Callable[..., Answering], capsys: pytest.CaptureFixture[str]
) -> None:
    gateway = begin()
    planner = answering(gateway.requests)
    port = ["--port", str(gateway.port)]
    assert execute(["send", "wave", *port]) == 0
    assert capsys.readouterr().out.startswith("accepted: heard as wave; from tick ")
    assert execute(["send", "--velocity", ".3", "0", "-0.5", "--for", "4", "--json", *port]) == 0
    assert json.loads(capsys.readouterr().out)["state"] == "accepted"
    assert [target.intent for target in planner.seen] == [Text("wave"), Velocity(0.3, 0.0, -0.5)]
    assert planner.seen[1].holds_s == 4.0
    assert execute(["status", "--json", *port]) == 0
    assert json.loads(capsys.readouterr().out)["following"]["asked"] == {"velocity": [0.3, 0.0, -0.5]}
    assert execute(["status", *port]) == 0
    assert "velocity 0.3 0 -0.5, of command line\n" in capsys.readouterr().out
    assert execute(["kill", *port]) == 2 and planner.requested == []
    planner.run.stopped = True
    assert execute(["send", "wave", *port]) == 1
    assert capsys.readouterr().out == "refused: a stop is in force\n"
    assert execute(["clear", *port]) == 0
    assert execute(["kill", "--the-robot-will-fall", *port]) == 0 and planner.requested[-1] is Request.KILL
    assert execute(["send", "wave", "--hold", *port]) == 2
    assert execute(["send", "--velocity", "9", "0", "0", *port]) == 2
    assert execute(["send", "wave", "--port", str(any_free())]) == 3
    assert "no run listens" in capsys.readouterr().err


def test_what_waits_for_a_page_that_is_closed_is_not_sent() -> None:
    """Asyncio warned "socket.send() raised exception.": a full queue was sent before the loop saw the closed socket."""

    async def sent_after_the_end() -> int:
        loop, sent = asyncio.get_running_loop(), []

        class Closing:
            async def send_text(self, text: str) -> None:
                sent.append(text)
                if len(sent) == 1:
                    loop.call_soon(task.cancel)  # as the loop tells that a connection is lost

        queue: asyncio.Queue[str | bytes] = asyncio.Queue()
        for number in range(100):
            queue.put_nowait(str(number))
        task = asyncio.create_task(Connections._send(Closing(), queue))  # type: ignore[arg-type]
        await asyncio.wait([task])
        return len(sent)

    assert asyncio.run(sent_after_the_end()) <= 2
