"""`StopService`: STOP and emergency stop in a process of their own (`fm-estop`), with a port of their own.

It writes to the loop's memory directly, so it works while the gateway's interpreter is busy or dead. `POST /stop` needs
no token, `POST /estop` does where the run has one. Other transports bring their stops here as well (`StopInput`). It is
no safety function: it needs a processor, a network and a loop that runs.
"""

from __future__ import annotations

import asyncio
import json
import os
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any
from urllib.parse import unquote

import h11

from flexmotion.configs.stream import Gateway
from flexmotion.drivers.realtime import priority
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.health import Health
from flexmotion.streamer.gateway.ports import bound, check_free
from flexmotion.streamer.gateway.presses import LOOK_S, Presses, StopInput, told
from flexmotion.streamer.gateway.stop_path import SOURCE_HEADER, STOPS
from flexmotion.streamer.gateway.ways import Way, began, ended
from flexmotion.streamer.run.planner_process import Heartbeat
from flexmotion.streamer.run.requests import Request, RequestChannel

_ASKS = {b"/stop": Request.STOP, b"/estop": Request.ESTOP}
_READ_S = 2.0
"""A request that is not complete after this time is dropped [s]."""
_ANSWER_S = 2.0
"""Longest time for an answer [s]; it is told far earlier."""
_MOST_BYTES = 8192
_MOST_CONNECTIONS = 100
"""Beyond these the oldest connection is closed: one that sends nothing keeps no other out."""
_CLOSE_S, _LINGER_S = 1.0, 0.5
_LONGEST_NAME = 60
"""Letters of the name of a program that presses a stop."""
_BEAT_S = 0.5
"""Time between two signs of life [s]."""


class StopService:
    """A `flexmotion.streamer.run.supervisor.Service` with its own channel to the loop.

    Args:
        admission: who may speak to it over the network, where a STOP needs no token; None: it does not listen there.
        port: to listen on; None: that of the settings.
        realtime: whether to ask for realtime scheduling.
        inputs: other ways to it, such as a gamepad.

    Attributes:
        name: of its process.
        requests: its channel to the loop.
        ways: whether stops can come over the inputs.
        alive: beats while it takes stops.
        health: both.

    Raises:
        ConfigError: the port is taken.
    """

    name = "estop"

    def __init__(
        self,
        settings: Gateway,
        telemetry: Telemetry,
        admission: Admission | None,
        *,
        port: int | None = None,
        realtime: bool = False,
        inputs: tuple[StopInput, ...] = (),
    ) -> None:
        self.telemetry, self.admission, self.realtime, self.inputs = telemetry, admission, realtime, inputs
        self.port = settings.stop_port if port is None else port
        if admission is not None:
            check_free(admission.address, self.port, "stop port of the gateway")
        self.requests = RequestChannel()
        self.ways = tuple(Way(f"stops over {one.name}", self.requests) for one in inputs)
        self.alive = Heartbeat()
        self.health = Health(self.ways, self.alive)
        self._parent = os.getpid()

    def follow(self) -> Callable[[bool], None]:
        """See `Service.follow`. Without a supervisor it listens until the loop has parked the robot."""
        server = _Server(self)

        def step(last: bool) -> None:
            if not last:
                if server.error is not None:
                    raise server.error
                return
            orphan = os.getpid() != self._parent and os.getppid() != self._parent
            ticks = -1
            while orphan and self.telemetry.ticks.count != ticks:
                ticks = self.telemetry.ticks.count
                time.sleep(_LINGER_S)
            server.close()

        return step


class _Server:
    """The thread of the server."""

    def __init__(self, service: StopService) -> None:
        self.service = service
        self.error: BaseException | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._open: dict[asyncio.Task[None], None] = {}
        self._ended = asyncio.Event()
        self._presses = Presses(service.telemetry, service.requests)
        self._thread = threading.Thread(target=self._run, name="stops", daemon=True)
        self._thread.start()

    def close(self) -> None:
        if self._loop is not None and self._loop.is_running():
            self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except BaseException as error:  # for the main thread, which ends the process with it
            self.error = error

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        # Of this thread, which handles the stops: on a busy machine one waited 50 ms for other programs.
        priority.claim(priority.STOP_PRIORITY, allowed=self.service.realtime)
        # Threads that the inputs start inherit the priority.
        inputs = [
            asyncio.create_task(began(partial(one.begin, self._presses, way), way))
            for one, way in zip(self.service.inputs, self.service.ways, strict=True)
        ]
        beating = asyncio.create_task(self._beat())
        try:
            if self.service.admission is None:
                await self._ended.wait()
            else:
                await self._listen(self.service.admission)
        finally:
            beating.cancel()
            await ended(inputs)

    async def _beat(self) -> None:
        while True:
            self.service.alive.beat()
            await asyncio.sleep(_BEAT_S)

    async def _listen(self, admission: Admission) -> None:
        with bound(admission.address, self.service.port) as listening:
            server = await asyncio.start_server(partial(self._accept, admission), sock=listening, limit=_MOST_BYTES)
            await self._ended.wait()
            server.close()
            for task in self._open:
                task.cancel()

    async def _accept(self, admission: Admission, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._open[task] = None
        if len(self._open) > _MOST_CONNECTIONS:
            next(iter(self._open)).cancel()
        try:
            async with asyncio.timeout(_READ_S + _ANSWER_S):
                await self._one(admission, reader, writer)
        except (TimeoutError, ConnectionError, asyncio.CancelledError, h11.RemoteProtocolError):
            pass  # it sent nothing complete, went away, or made room for others
        finally:
            self._open.pop(task, None)
            writer.transport.abort()

    async def _one(self, admission: Admission, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connection = h11.Connection(h11.SERVER, max_incomplete_event_size=_MOST_BYTES)
        request: h11.Request | None = None
        async with asyncio.timeout(_READ_S):
            while request is None:
                event = connection.next_event()
                if event is h11.NEED_DATA:
                    connection.receive_data(await reader.read(_MOST_BYTES))
                elif isinstance(event, h11.Request):
                    request = event
                else:
                    return
        status, content, headers = await self._answer(admission, request)
        body = json.dumps(content).encode()
        head = h11.Response(
            status_code=status,
            headers=[
                ("content-type", "application/json"),
                ("content-length", str(len(body))),
                ("connection", "close"),
                *headers,
            ],
        )
        for part in (head, h11.Data(data=body), h11.EndOfMessage()):
            writer.write(connection.send(part) or b"")
        await writer.drain()
        # Closed in order: an abort could drop what the other side has not read yet.
        writer.close()
        await writer.wait_closed()

    async def _answer(
        self, admission: Admission, request: h11.Request
    ) -> tuple[int, dict[str, Any], list[tuple[str, str]]]:
        known = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in request.headers}
        path, _, query = request.target.partition(b"?")
        asked = _ASKS.get(path)
        refusal = admission.refusal(
            known,
            query.decode("latin-1"),
            # A browser asks with OPTIONS whether it may send the token at all.
            token_needed=asked is not Request.STOP and path != STOPS.encode() and request.method != b"OPTIONS",
        )
        if refusal is not None:
            return refusal.status, told(asked, "refused", reason=refusal.reason), []
        shared = [("access-control-allow-origin", known["origin"])] if "origin" in known else []
        if request.method == b"OPTIONS" and asked is not None:
            allowed = [("access-control-allow-methods", "POST"), ("access-control-allow-headers", "authorization")]
            return 200, {}, shared + allowed
        if path == STOPS.encode():
            return 200, {"stop_port": self.service.port}, shared
        if asked is None:
            return 404, told(None, "refused", reason="expected POST /stop or POST /estop"), shared
        if request.method != b"POST":
            return 405, told(asked, "refused", reason="expected POST"), shared
        content = await self._ask(asked, known.get(SOURCE_HEADER.lower(), ""))
        return (200 if content["state"] == "accepted" else 503), content, shared

    async def _ask(self, asked: Request, source: str) -> dict[str, Any]:
        """Send the request of a program, by its name, and wait until the loop has taken it."""
        name = "".join(letter for letter in unquote(source)[:_LONGEST_NAME] if letter.isprintable())
        press = self._presses.press(asked, name or "stop process")
        while press.told is None:
            await asyncio.sleep(LOOK_S)
            self._presses.look()
        return press.told
