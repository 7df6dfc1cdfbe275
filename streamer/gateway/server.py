"""HTTP and WebSocket in front of the desk: a thin adapter (FastAPI, uvicorn).

`/targets` is a WebSocket: a message a frame in, an answer a frame out, `?status=HZ` adds the status so many times a
second, `?ends` how the targets of this connection ended, `?page` pictures and figures for a page. `POST /targets` and
`POST /TYPE` take one message and give its answer.
`GET /` is the page, further `/status`, `/health`, `/metrics`, `/openapi.json`, `/docs`.
"""

from __future__ import annotations

import asyncio
import html
import itertools
import json
import math
from collections.abc import Awaitable, Callable
from typing import Any

from fastapi import FastAPI, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.responses import HTMLResponse, RedirectResponse
from fastapi.routing import APIRoute
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Receive, Scope, Send

from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.asked import OnEnd, Reply
from flexmotion.streamer.gateway.desk import Desk
from flexmotion.streamer.gateway.messages import GET_UP_S, KINDS, Answer, Ended, Message, encode
from flexmotion.streamer.gateway.metrics import METRICS_TYPE
from flexmotion.streamer.gateway.pages import FILES, Pages, add_pages
from flexmotion.streamer.gateway.status import Status
from flexmotion.streamer.gateway.stop_path import STOPS

_FASTEST_STATUS_HZ = 50.0
_ANSWER_S = GET_UP_S + 5.0
"""Longest time that a POST waits for its answer [s]; the desk answers before, and nearly everything far earlier."""
_BODY_S = 10.0
"""A POST whose body is not complete after this time is refused [s]."""
_NOT_DONE = ("expired", "refused")
_HEADERS = {
    "content-security-policy": "default-src 'self'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "cache-control": "no-store",
}


class Guard:
    """ASGI middleware: refuses what `Admission` refuses before any application code sees it."""

    def __init__(self, app: ASGIApp, admission: Admission, desk: Desk) -> None:
        self.app, self.admission, self.desk = app, admission, desk

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        # The page's own files hold nothing of the run: a browser loads them before the page can ask for the token. A
        # STOP needs no token, nor does the question where it goes to.
        path = scope["path"] if scope["type"] == "http" else ""
        is_open = path in ("/", STOPS) or path.startswith(FILES)
        query = scope.get("query_string", b"").decode("latin-1")
        refusal = self.admission.refusal(headers, query, token_needed=not is_open)
        if refusal is None:
            await self.app(scope, receive, send)
            return
        self.desk.reject(refusal.why)
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": refusal.reason[:120]})
            return
        await _answer(Answer(state="refused", reason=refusal.reason), refusal.status)(scope, receive, send)


class Connections:
    """The open WebSockets, and the tasks of one."""

    def __init__(
        self, desk: Desk, status: Callable[[], Status], wake: Callable[[], None], pages: Pages | None = None
    ) -> None:
        self.desk, self.status, self.wake, self.pages = desk, status, wake, pages
        self._open: dict[int, asyncio.Queue[str | bytes]] = {}
        self._numbers = itertools.count()

    def tell(self, text: str) -> None:
        """Send a text to all; one whose answers pile up does not get it."""
        for queue in self._open.values():
            if not queue.full():
                queue.put_nowait(text)

    async def serve(self, socket: WebSocket, status_hz: float, *, page: bool = False, ends: bool = False) -> None:
        """One WebSocket, until it is closed.

        Args:
            status_hz: how often it is sent the status; 0: never.
            page: it is sent pictures and figures of the run; ends: it is told how its targets ended.
        """
        settings = self.desk.settings
        if len(self._open) >= settings.most_connections:
            self.desk.reject("too many connections")
            await socket.close(1013, f"{settings.most_connections} connections are open already")
            return
        await socket.accept()
        queue: asyncio.Queue[str | bytes] = asyncio.Queue(settings.most_unread)
        full = asyncio.Event()
        key = next(self._numbers)  # never one that another connection has had
        self._open[key] = queue

        def reply(answer: Answer | Ended) -> None:
            if queue.full():
                full.set()
            else:
                queue.put_nowait(encode(answer))

        tasks = [
            asyncio.create_task(self._receive(socket, reply, key, reply if ends else None)),
            asyncio.create_task(self._send(socket, queue)),
            asyncio.create_task(full.wait()),
        ]
        if status_hz:
            tasks.append(asyncio.create_task(self._report(queue, status_hz)))
        if page and self.pages is not None:
            self.pages.add(queue)
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            if full.is_set():
                self.desk.reject("slow reader")
                # What it does not read cannot be flushed: the connection is cut.
                await asyncio.wait_for(socket.close(1013, "too many unread answers"), 1.0)
            for task in done:
                task.result()
        except (WebSocketDisconnect, TimeoutError, RuntimeError):
            pass  # closed by the other side, or cut
        finally:
            del self._open[key]
            self.desk.forget(key)
            if self.pages is not None:
                self.pages.remove(queue)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _receive(self, socket: WebSocket, reply: Reply, key: int, on_end: OnEnd | None) -> None:
        while True:
            event = await socket.receive()
            if event["type"] == "websocket.disconnect":
                raise WebSocketDisconnect(event.get("code", 1006))
            text = event.get("text")
            data = event.get("bytes") if text is None else text.encode()
            self.desk.receive(data or b"", reply, key, on_end)
            self.wake()
            # A socket that always has a message does not keep the loop from the others.
            await asyncio.sleep(0)

    @staticmethod
    async def _send(socket: WebSocket, queue: asyncio.Queue[str | bytes]) -> None:
        while True:
            item = await queue.get()
            await (socket.send_text(item) if isinstance(item, str) else socket.send_bytes(item))
            # A queue that is never empty must not keep the loop from noticing that the other side has gone.
            await asyncio.sleep(0)

    async def _report(self, queue: asyncio.Queue[str | bytes], status_hz: float) -> None:
        while True:
            if queue.empty():  # a slow reader gets fewer of them
                queue.put_nowait(encode(self.status()))
            await asyncio.sleep(1.0 / status_hz)


def build_app(
    desk: Desk,
    admission: Admission,
    status: Callable[[], Status],
    wake: Callable[[], None],
    pages: Pages | None = None,
    metrics: Callable[[], bytes] | None = None,
) -> tuple[ASGIApp, Connections]:
    """The application.

    Args:
        metrics: gives those of the run for `/metrics`; None: it has none.
        wake: called after a message has come in, so that the desk's pump runs.
        pages: of the run; None: it has none.
    """
    app = FastAPI(title="FlexMotion", version="1", docs_url=None, redoc_url=None, openapi_url="/openapi.json")
    connections = Connections(desk, status, wake, pages)

    async def ask(request: Request, kind: str | None = None) -> Response:
        try:
            async with asyncio.timeout(_BODY_S):
                data = await _body(request, desk.settings.most_bytes)
        except TimeoutError:
            desk.reject("slow sender")
            return _answer(Answer(state="refused", reason=f"the message was not complete after {_BODY_S:g} s"), 408)
        except ClientDisconnect:
            desk.reject("left")
            return Response(status_code=400)  # nobody reads it
        if data is not None and kind is not None:
            data = _typed(data, kind)
        answered: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()

        def reply(answer: Answer) -> None:
            if not answered.done():
                answered.set_result(answer)

        if data is None:
            desk.reject("too large")
            return _answer(Answer(state="refused", reason=f"expected at most {desk.settings.most_bytes} bytes"), 413)
        desk.receive(data, reply)
        wake()
        answer = await asyncio.wait_for(answered, _ANSWER_S)
        return _answer(answer, 422 if answer.asked is None else 409 if answer.state in _NOT_DONE else 200)

    _add_post(app, "/targets", ask, "One message of any type.", Message, "targets")
    for word, kind in KINDS.items():

        async def one(request: Request, kind: str = word) -> Response:
            return await ask(request, kind)

        _add_post(app, f"/{word}", one, kind.__doc__ or word, kind, word)

    @app.get("/status")
    async def get_status() -> Status:
        """The run now."""
        return status()

    @app.get(STOPS)
    async def get_stops() -> dict[str, int | None]:
        """The port of the process that takes stops; without the token."""
        return {"stop_port": status().stop_port}

    @app.get("/health")
    async def get_health(response: Response) -> dict[str, Any]:
        """Whether the loop ticks, the servo bus answers and every way to the run works; 503 where not."""
        now = status()
        response.status_code = 200 if now.well else 503
        return {"ok": now.well, "loop": now.loop, "bus": now.bus, "ways": now.ways}

    if metrics is not None:
        text = metrics

        @app.get("/metrics", include_in_schema=False)
        async def get_metrics() -> Response:
            return Response(text(), media_type=METRICS_TYPE)

    @app.get("/docs", response_class=HTMLResponse)
    async def get_docs() -> HTMLResponse:
        """What can be asked, for people."""
        return HTMLResponse(docs_page())

    if pages is None:

        @app.get("/", include_in_schema=False)
        async def get_root() -> RedirectResponse:
            return RedirectResponse("/docs")
    else:
        add_pages(app, pages, status)

    @app.exception_handler(404)
    async def unknown(request: Request, _error: Exception) -> Response:
        paths = sorted({route.path for route in app.routes if isinstance(route, APIRoute)})
        return _answer(
            Answer(state="refused", reason=f"{request.url.path[:64]!r}: expected one of: {', '.join(paths)}"), 404
        )

    @app.websocket("/targets")
    async def serve(socket: WebSocket) -> None:
        try:
            rate = float(socket.query_params.get("status", 0.0))
        except ValueError:
            rate = 0.0
        rate = min(rate, _FASTEST_STATUS_HZ) if math.isfinite(rate) and rate > 0.0 else 0.0
        asked = socket.query_params
        await connections.serve(socket, rate, page="page" in asked, ends="ends" in asked)

    @app.middleware("http")
    async def add_headers(request: Request, call_next: Callable[[Request], Awaitable[Response]]) -> Response:
        response = await call_next(request)
        for name, value in _HEADERS.items():
            response.headers.setdefault(name, value)
        return response

    return Guard(app, admission, desk), connections


def _add_post(app: FastAPI, path: str, endpoint: Any, text: str, kind: Any, name: str) -> None:
    from pydantic import TypeAdapter

    schema = TypeAdapter(kind).json_schema(ref_template="#/components/schemas/{model}")
    parts = schema.pop("$defs", {})
    body = {"required": True, "content": {"application/json": {"schema": _inline(schema, parts)}}}
    app.add_api_route(
        path,
        endpoint,
        methods=["POST"],
        summary=text.strip().splitlines()[0],
        name=name,
        response_model=None,
        responses={code: {"model": Answer, "description": "The answer."} for code in (200, 409, 413, 422)},
        openapi_extra={"requestBody": body},
    )


def _inline(schema: Any, parts: dict[str, Any]) -> Any:
    """A schema with its named parts in place, since OpenAPI keeps them elsewhere."""
    if isinstance(schema, dict):
        if "$ref" in schema:
            return _inline(parts[schema["$ref"].rsplit("/", 1)[1]], parts)
        return {key: _inline(value, parts) for key, value in schema.items() if key != "discriminator"}
    return [_inline(one, parts) for one in schema] if isinstance(schema, list) else schema


async def _body(request: Request, most: int) -> bytes | None:
    """The body of a request; None where it is longer than `most` bytes."""
    data = bytearray()
    async for chunk in request.stream():
        data += chunk
        if len(data) > most:
            return None
    return bytes(data)


def _typed(data: bytes, kind: str) -> bytes:
    """A message whose type is that of its address; what is no JSON object stays as it is and is refused by the desk."""
    try:
        content = json.loads(data or b"{}")
    except (ValueError, RecursionError):
        return data
    if not isinstance(content, dict) or content.get("type", kind) != kind:
        return data
    return json.dumps({**content, "type": kind}).encode()


def _answer(answer: Answer, status: int) -> Response:
    return Response(encode(answer), status, _HEADERS, "application/json")


def docs_page() -> str:
    """The messages as a page that needs no network and no script."""
    rows = []
    for word, kind in KINDS.items():
        own = [name for name in kind.model_fields if name not in ("version", "id", "source", "sequence", "stamp_s")]
        fields = ", ".join(name for name in own if name not in ("type", "ttl_s"))
        text = html.escape((kind.__doc__ or "").split("Attributes:")[0].strip())
        rows.append(f"<tr><td>POST /{word}</td><td>{html.escape(fields)}</td><td>{text}</td></tr>")
    return f"""<!doctype html><html lang="en"><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>FlexMotion: messages</title>
<h1>FlexMotion: messages</h1>
<p>A WebSocket at <code>/targets</code> takes one message a frame and answers each; <code>POST</code> takes one.
<a href="/status">Status</a>, <a href="/openapi.json">OpenAPI</a>.</p>
<table><tr><th>address</th><th>fields</th><th>does</th></tr>{"".join(rows)}</table></html>"""
