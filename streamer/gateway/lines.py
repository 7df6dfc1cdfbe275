"""`Lines`: messages on standard input, a JSON object a line; their answers on standard output."""

from __future__ import annotations

import asyncio
import os
import queue
import threading
from collections.abc import Callable

from flexmotion.streamer.gateway.desk import Desk
from flexmotion.streamer.gateway.messages import Answer, encode
from flexmotion.streamer.gateway.ways import Way


class Lines:
    """Reads and writes in threads of its own, so that neither a sender nor a reader delays the desk.

    Args:
        source, sink: file descriptors to read from and to write to.
        wake: called after a message has come in.
        way: is told where the input cannot be read any more.
    """

    def __init__(self, source: int, sink: int, desk: Desk, wake: Callable[[], None], way: Way) -> None:
        self.desk, self._wake, self.way = desk, wake, way
        self._loop = asyncio.get_running_loop()
        self._told: queue.Queue[Answer] = queue.Queue(desk.settings.most_unread)
        threading.Thread(target=self._read, args=(source,), name="lines-in", daemon=True).start()
        threading.Thread(target=self._write, args=(sink,), name="lines-out", daemon=True).start()

    def _read(self, source: int) -> None:
        try:
            self._read_lines(source)
        except Exception as error:  # such as a terminal that hangs up
            self.way.fails(f"cannot be read any more: {type(error).__name__}: {error}")

    def _read_lines(self, source: int) -> None:
        most = self.desk.settings.most_bytes
        with os.fdopen(source, "rb") as lines:
            while line := lines.readline(most + 2):
                if not line.endswith(b"\n") and len(line) > most:
                    while (rest := lines.readline(most)) and not rest.endswith(b"\n"):
                        pass  # the rest of a line that is too long
                if line.strip():
                    self._loop.call_soon_threadsafe(self._receive, line.rstrip(b"\r\n"))

    def _receive(self, line: bytes) -> None:
        self.desk.receive(line, self._reply, "lines")
        self._wake()

    def _reply(self, answer: Answer) -> None:
        try:
            self._told.put_nowait(answer)
        except queue.Full:
            self.desk.reject("slow reader")

    def _write(self, sink: int) -> None:
        try:
            with os.fdopen(sink, "w", encoding="utf-8", buffering=1) as out:
                while True:
                    out.write(encode(self._told.get()) + "\n")
        except OSError:
            return  # nobody reads the answers any more; targets are still taken
