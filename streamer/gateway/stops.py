"""`StopService`: STOP and emergency stop in a process of their own (`fm-estop`), with a port of their own.

It writes to the loop's memory directly, so it works while the gateway's interpreter is busy or dead. `POST /stop` needs
no token, `POST /estop` does where the run has one. It is no safety function: it needs a processor, a network and a loop
that runs.
"""

from __future__ import annotations

import asyncio
import json
import os
import threading
import time
from collections.abc import Callable
from typing import Any

import h11

from flexmotion.configs.stream import Gateway
from flexmotion.drivers.realtime import priority
from flexmotion.streamer.control.telemetry import Telemetry, events
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.ports import bound, check_free
from flexmotion.streamer.run.requests import Request, RequestChannel

_ASKS = {b"/stop": Request.STOP, b"/estop": Request.ESTOP}
_READ_S = 2.0
"""A request that is not complete after this time is dropped [s]."""
_TAKEN_S = 1.0
"""A loop that has not taken a request after this time does not run [s]."""
_LOOK_S = 0.001
_MOST_BYTES = 8192
_MOST_CONNECTIONS = 100
"""Beyond these the oldest connection is closed: one that sends nothing keeps no other out."""
_CLOSE_S, _LINGER_S = 1.0, 0.5


class StopService:
    """A `flexmotion.streamer.run.supervisor.Service` with its own channel to the loop.

    Args:
        admission: who may speak to it; a STOP needs no token.
        port: to listen on; None: that of the settings.
        realtime: whether to ask for realtime scheduling.

    Attributes:
        name: of its process.
        requests: its channel to the loop.

    Raises:
        ConfigError: the port is taken.
    """

    name = "estop"

    def __init__(
        self,
        settings: Gateway,
        telemetry: Telemetry,
        admission: Admission,
        *,
        port: int | None = None,
        realtime: bool = False,
    ) -> None:
        self.telemetry, self.admission, self.realtime = telemetry, admission, realtime
        self.port = settings.stop_port if port is None else port
        check_free(admission.address, self.port, "stop port of the gateway")
        self.requests = RequestChannel()
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
        with bound(self.service.admission.address, self.service.port) as listening:
            server = await asyncio.start_server(self._accept, sock=listening, limit=_MOST_BYTES)
            await self._ended.wait()
            server.close()
            for task in self._open:
                task.cancel()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._open[task] = None
        if len(self._open) > _MOST_CONNECTIONS:
            next(iter(self._open)).cancel()
        try:
            async with asyncio.timeout(_READ_S + _TAKEN_S):
                await self._one(reader, writer)
        except (TimeoutError, ConnectionError, asyncio.CancelledError, h11.RemoteProtocolError):
            pass  # it sent nothing complete, went away, or made room for others
        finally:
            self._open.pop(task, None)
            writer.transport.abort()

    async def _one(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
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
        status, content, headers = await self._answer(request)
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

    async def _answer(self, request: h11.Request) -> tuple[int, dict[str, Any], list[tuple[str, str]]]:
        known = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in request.headers}
        path, _, query = request.target.partition(b"?")
        asked = _ASKS.get(path)
        refusal = self.service.admission.refusal(
            known,
            query.decode("latin-1"),
            # A browser asks with OPTIONS whether it may send the token at all.
            token_needed=asked is not Request.STOP and request.method != b"OPTIONS",
        )
        if refusal is not None:
            return refusal.status, _told(asked, "refused", reason=refusal.reason), []
        shared = [("access-control-allow-origin", known["origin"])] if "origin" in known else []
        if request.method == b"OPTIONS" and asked is not None:
            allowed = [("access-control-allow-methods", "POST"), ("access-control-allow-headers", "authorization")]
            return 200, {}, shared + allowed
        if asked is None:
            return 404, _told(None, "refused", reason="expected POST /stop or POST /estop"), shared
        if request.method != b"POST":
            return 405, _told(asked, "refused", reason="expected POST"), shared
        content = await self._ask(asked)
        return (200 if content["state"] == "accepted" else 503), content, shared

    async def _ask(self, asked: Request) -> dict[str, Any]:
        """Send the request, and wait until the loop has taken it."""
        telemetry = self.service.telemetry
        seen = telemetry.events.reader(new_only=True)
        newest = telemetry.ticks.latest()
        arrived = -1 if newest is None else int(newest["tick"])
        self.service.requests.send(asked, "stop process")
        end = asyncio.get_running_loop().time() + _TAKEN_S
        while asyncio.get_running_loop().time() < end:
            for event in events(seen):
                if event.kind == "request" and event.message == asked.name:
                    return _told(asked, "accepted", arrived_tick=arrived, tick=event.tick)
            await asyncio.sleep(_LOOK_S)
        return _told(asked, "refused", arrived_tick=arrived, reason=f"the loop did not take it within {_TAKEN_S:g} s")


def _told(asked: Request | None, state: str, **known: Any) -> dict[str, Any]:
    return {"type": "answer", "version": 1, "asked": asked.name.lower() if asked else None, "state": state, **known}
