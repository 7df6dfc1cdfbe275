"""`Keyboard`: steers a run from a terminal, also over ssh. It is a client: the run may be on another machine.

The robot walks while a key is held. Stops go to the stop process, so they work while the gateway is busy or dead.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import sys
import termios
import time
import tty
from collections.abc import Callable, Coroutine, Iterator, Mapping
from typing import Any, TextIO

from flexmotion.configs.errors import ConfigError, GatewayError
from flexmotion.streamer.gateway.async_client import AsyncClient
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.keys import HeldKeys, KeyReader
from flexmotion.streamer.gateway.messages import Answer, MessageError

HELP = """w s, arrows up down   forward, back            space   STOP
a d, arrows           turn                     c       clear a STOP
q e                   to the side              !       emergency stop, as the robot file says
+ -                   faster, slower           o       arm: torque on, stand up
t                     take over from another operator
/ or Enter            type a sentence, where Escape is STOP and Enter alone says none
Ctrl-C                end; the robot stands"""

_LOOK_S, _AGAIN_S, _HOLDS_S = 0.05, 0.1, 0.4
"""Time between two looks at the held keys, between two equal velocities, and for which one holds [s]."""
_RETRY_S = 1.0
_FASTER, _SLOWEST, _FASTEST = 1.25, 0.2, 3.0
"""Factor of "+" and "-", and its bounds in all."""
_END_KEYS = {"\x03", "\x04"}
"""Ctrl-C and Ctrl-D."""
_AFTER = {"stop": "c releases it", "estop": "it parks, torque off; then c clears the fault, o arms"}
_WORDS = {"c": "clear", "o": "arm", "t": "take"}
_TEXT_KEYS, _SEND_KEYS, _ERASE_KEYS = ("/", "\n", "\r"), ("\n", "\r"), ("\x7f", "\b")


class Keyboard:
    """Steers a run until `run` ends.

    Args:
        connect: makes the client for targets.
        stops: the client for stops.
        fastest: speed of a held key: forward, left [m/s of the human], turning left [rad/s].
        out: to show what is done.
    """

    def __init__(
        self,
        connect: Callable[[], AsyncClient],
        stops: Client,
        fastest: tuple[float, float, float],
        out: TextIO = sys.stderr,
    ) -> None:
        self.connect, self.stops, self.out = connect, stops, out
        self._keys, self._held = KeyReader(), HeldKeys(fastest)
        self._fastest, self._factor = fastest, 1.0
        self._client: AsyncClient | None = None
        self._sent, self._sent_s = (0.0, 0.0, 0.0), 0.0
        self._typed: str | None = None
        self._shown = ""
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self, terminal: int) -> None:
        """Take keys from a terminal (a file descriptor) until Ctrl-C, or its end."""
        loop, ended = asyncio.get_running_loop(), asyncio.Event()

        def read() -> None:
            try:
                data = os.read(terminal, 1024)
            except OSError:
                data = b""
            keys = self._keys.keys(data)
            if not data or not _END_KEYS.isdisjoint(keys):
                ended.set()
            for key in keys:
                self._press(key)

        loop.add_reader(terminal, read)
        connecting = asyncio.create_task(self._stay_connected())
        try:
            self._show(HELP, end="\n")
            while not ended.is_set():
                self._drive()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(ended.wait(), _LOOK_S)
        finally:
            loop.remove_reader(terminal)
            self._held.release()
            self._drive()
            await self._ask({"type": "release"}, quietly=True)
            await asyncio.gather(*self._tasks)
            connecting.cancel()
            await asyncio.gather(connecting, return_exceptions=True)

    async def _stay_connected(self) -> None:
        while True:
            try:
                async with self.connect() as client:
                    self._client = client
                    await asyncio.to_thread(self.stops.learn_stop_port)
                    self._show("connected")
                    await client.closed()
            except GatewayError as error:
                self._show(str(error))
            self._client = None
            await asyncio.sleep(_RETRY_S)

    def _press(self, key: str) -> None:
        if self._typed is not None:
            self._type(key)
        elif self._held.press(key, time.monotonic()):
            self._drive()
        elif key in _TEXT_KEYS:
            self._typed = ""
            self._show("say: ")
        elif key == " ":
            self._stop("stop")
        elif key == "!":
            self._stop("estop")
        elif key in _WORDS:
            self._later(self._ask({"type": _WORDS[key]}))
        elif key in ("+", "-"):
            self._factor = min(max(self._factor * (_FASTER if key == "+" else 1.0 / _FASTER), _SLOWEST), _FASTEST)
            forward, left, turning = (round(self._factor * speed, 3) for speed in self._fastest)
            self._held.fastest = (forward, left, turning)
            self._show(f"fastest: {forward:g} m/s ahead, {left:g} m/s aside, {turning:g} rad/s turning")

    def _type(self, key: str) -> None:
        assert self._typed is not None
        if key in _SEND_KEYS or key == "escape":
            text, self._typed = self._typed.strip(), None
            if key == "escape":  # space is a letter here, and somebody may have to stop the robot in the middle of one
                self._stop("stop")
            elif text:
                self._later(self._ask({"type": "text", "text": text}))
            else:
                self._show("")
            return
        if key in _ERASE_KEYS:
            self._typed = self._typed[:-1]
        elif len(key) == 1 and key.isprintable():
            self._typed += key
        self._show(f"say: {self._typed}")

    def _drive(self) -> None:
        now = time.monotonic()
        velocity = self._held.velocity(now)
        if velocity != self._sent or (any(velocity) and now - self._sent_s >= _AGAIN_S):
            self._sent, self._sent_s = velocity, now
            self._later(self._ask({"type": "velocity", "velocity": list(velocity), "ttl_s": _HOLDS_S}))

    def _stop(self, what: str) -> None:
        self._held.release()
        self._later(self._press_stop(what))

    async def _press_stop(self, what: str) -> None:
        try:
            answer = await asyncio.to_thread(self.stops.stop if what == "stop" else self.stops.estop)
            self._show(f"{what}: {answer.state}, {answer.reason or _AFTER[what]}")
        except GatewayError as error:
            self._show(str(error))
            await self._ask({"type": what})

    async def _ask(self, message: Mapping[str, Any], *, quietly: bool = False) -> None:
        if self._client is None:
            return
        try:
            answer = await self._client.ask(message)
        except (GatewayError, MessageError) as error:
            self._show(str(error))
            return
        if not quietly and self._typed is None:
            self._show(_line(answer, message))

    def _later(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _show(self, text: str, end: str = "") -> None:
        """Show a line in place of the one before; what is wider than the terminal stays, and is shown once."""
        if text == self._shown:
            return
        self._shown = text
        if len(text) >= shutil.get_terminal_size().columns:
            end = "\n"
        with contextlib.suppress(OSError):  # the terminal was closed; the robot is still brought to a stand
            self.out.write(f"\r\x1b[K{text}{end}")
            self.out.flush()


def _line(answer: Answer, message: Mapping[str, Any]) -> str:
    if message["type"] == "velocity":
        forward, left, turning = message["velocity"]
        asked = f"{forward:g} m/s ahead, {left:g} m/s aside, {turning:g} rad/s" if any(message["velocity"]) else "stand"
    else:
        asked = str(message.get("text", message["type"]))
    heard = ", ".join(filter(None, (answer.heard_as, answer.manner))) if message["type"] == "text" else None
    parts = [f"{asked}: {answer.state}", f"heard as {heard}" if heard else None, answer.slowed, answer.reason]
    return ", ".join(part for part in parts if part)


@contextlib.contextmanager
def keys_at_once(terminal: int) -> Iterator[None]:
    """A terminal that gives each key as it is pressed and shows none; as before afterwards.

    Raises:
        ConfigError: it is no terminal.
    """
    try:
        before = termios.tcgetattr(terminal)
    except termios.error:
        raise ConfigError("standard input is no terminal; for programs there is: flexmotion run --stdin") from None
    try:
        tty.setcbreak(terminal)
        mode = termios.tcgetattr(terminal)
        mode[6][termios.VINTR] = b"\0"  # Ctrl-C is a key, so that the robot is brought to a stand first
        termios.tcsetattr(terminal, termios.TCSADRAIN, mode)
        yield
    finally:
        with contextlib.suppress(termios.error):  # it was closed
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)
