"""`Pages`: the browser pages of a run: their files, and what they are sent."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
import re
from collections.abc import Callable
from importlib.resources import files
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.responses import HTMLResponse
from starlette.staticfiles import StaticFiles

from flexmotion.streamer.gateway.status import Status
from flexmotion.streamer.page.feed import Feed

FILES = "/page/"
"""Address of the page's files."""
_PICTURE_S, _IDLE_S = 0.04, 0.2
"""Time between two pictures, and between two looks whether a page is open [s]."""
_BEHIND = 50
"""A page that has so many messages unread is sent no more until it has caught up."""

Queue = asyncio.Queue[str | bytes]


class Pages:
    """The open pages. Nothing is computed while none is open.

    Args:
        feed: makes the feed, when the first page is opened.
        robot: what a page must know of the robot (`flexmotion.streamer.page.body.page_robot`).
    """

    def __init__(self, feed: Callable[[], Feed], robot: Callable[[], dict[str, Any]]) -> None:
        self._make_feed, self._robot = feed, robot
        self._feed: Feed | None = None
        self._queues: list[Queue] = []
        self._known: bytes | None = None
        self._making = asyncio.Lock()

    def add(self, queue: Queue) -> None:
        """A page is opened: what it is sent goes to a queue."""
        if self._feed is None:
            self._feed = self._make_feed()
        for text in self._feed.opened():
            _put(queue, text)
        self._queues.append(queue)

    def remove(self, queue: Queue) -> None:
        """A page, or any other connection, is closed."""
        if queue in self._queues:
            self._queues.remove(queue)
        if not self._queues:
            self._feed = None

    async def robot(self) -> bytes:
        """What a page must know of the robot, as JSON."""
        async with self._making:
            if self._known is None:
                # Meshes take half a second, in which targets go on.
                self._known = await asyncio.to_thread(lambda: json.dumps(self._robot()).encode())
        return self._known

    async def run(self) -> None:
        """Send to the open pages, without an end."""
        while True:
            if self._feed is None:
                await asyncio.sleep(_IDLE_S)
                continue
            picture, texts = self._feed.update()
            for queue in self._queues:
                if picture is not None and queue.empty():  # a slow reader gets fewer of them
                    _put(queue, picture)
                for text in texts:
                    _put(queue, text)
            await asyncio.sleep(_PICTURE_S)


def _put(queue: Queue, item: str | bytes) -> None:
    # Answers to what the page asks have the rest of the queue.
    if queue.qsize() < queue.maxsize - 2 * _BEHIND:
        queue.put_nowait(item)


def add_pages(app: FastAPI, pages: Pages, status: Callable[[], Status]) -> None:
    """Serve the page, its files and what it must know of the robot."""
    folder = files("flexmotion.streamer.page") / "static"
    page = (folder / "index.html").read_text(encoding="utf-8")
    inline = re.search(r'<script type="importmap">(.*?)</script>', page, re.DOTALL)
    assert inline is not None
    digest = base64.b64encode(hashlib.sha256(inline[1].encode()).digest()).decode()

    @app.get("/", include_in_schema=False)
    async def get_page(request: Request) -> HTMLResponse:
        url = request.url  # its host is known to `Admission`
        name = _bracketed(url.hostname or "")
        here, stops = f"ws://{name}:{url.port or 80}", f"http://{name}:{status().stop_port}"
        policy = (
            f"default-src 'none'; script-src 'self' 'sha256-{digest}'; style-src 'self'; img-src 'self' data:; "
            f"connect-src 'self' {here} {stops}; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
        )
        return HTMLResponse(page, headers={"content-security-policy": policy})

    @app.get("/robot", include_in_schema=False)
    async def get_robot() -> Response:
        return Response(await pages.robot(), media_type="application/json")

    app.mount(FILES.rstrip("/"), StaticFiles(directory=str(folder)))


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
