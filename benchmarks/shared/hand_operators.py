"""Operators by hand: gamepad and keyboard."""

from __future__ import annotations

import asyncio
import io
import os
import pty
import threading
import time
from collections import Counter
from contextlib import ExitStack

from evdev import ecodes

from benchmarks.shared.operators import ANSWERS, PATIENCE_S, Operator, Place, wait
from benchmarks.shared.pads import wait_for_readers
from flexmotion.streamer.gateway.async_client import AsyncClient
from flexmotion.streamer.gateway.keyboard import Keyboard, keys_at_once


class _Counted(Operator):
    """One whose messages carry no id that it knows: the gateway's counts say what became of them."""

    def __init__(self, place: Place) -> None:
        super().__init__()
        self._client = place.client()
        self._before = self._counts()

    def _counts(self) -> Counter[str]:
        return Counter(self._client.status()["counts"])

    def release(self) -> None:
        """Let all keys and sticks go."""

    def answers(self, number: int) -> tuple[Counter[str], list[float]]:
        """See `Operator.answers`."""
        self.release()
        end = time.monotonic() + PATIENCE_S
        while True:
            time.sleep(0.5)
            found = self._counts() - self._before
            states = Counter({state: found[state] for state in ANSWERS if found[state]})
            self.sent = found["received"]
            if states.total() == self.sent >= number or time.monotonic() > end:
                return states, []


class OverGamepad(_Counted):
    """Both by a gamepad."""

    name = "gamepad"

    def __init__(self, place: Place, _stack: ExitStack) -> None:
        super().__init__(place)
        self._pad = place.pad
        wait_for_readers(self._pad, 2)

    def take(self) -> None:
        """See `Operator.take`."""
        self._pad.press(ecodes.BTN_SELECT)
        self._move(ecodes.EV_KEY, ecodes.BTN_TL, 1)

    def send(self, turning: float) -> None:
        """See `Operator.send`; the stick is moved."""
        self._move(ecodes.EV_ABS, ecodes.ABS_RX, int(-32767 * turning))

    def release(self) -> None:
        """See `_Counted.release`."""
        self._move(ecodes.EV_ABS, ecodes.ABS_RX, 0)

    def estop(self) -> None:
        """See `Operator.estop`."""
        self._pad.press(ecodes.BTN_MODE)

    def _move(self, kind: int, code: int, value: int) -> None:
        self._pad.send(kind, code, value)
        self._pad.send(ecodes.EV_SYN, ecodes.SYN_REPORT, 0)


class OverKeyboard(_Counted):
    """Both by keys, in a pseudo-terminal."""

    name = "keyboard"

    def __init__(self, place: Place, stack: ExitStack) -> None:
        super().__init__(place)
        self._keys, terminal = pty.openpty()
        shown = io.StringIO()
        keyboard = Keyboard(
            lambda: AsyncClient(port=place.gateway.port, source="keyboard"), place.client(), (0.3, 0.15, 0.4), shown
        )

        def steer() -> None:
            with keys_at_once(terminal):
                asyncio.run(keyboard.run(terminal))

        thread = threading.Thread(target=steer, daemon=True)
        thread.start()
        stack.callback(thread.join, PATIENCE_S)
        stack.callback(os.close, self._keys)
        wait(lambda: "connected" in shown.getvalue(), "the keyboard's connection")

    def take(self) -> None:
        """See `Operator.take`."""
        os.write(self._keys, b"t")

    def send(self, turning: float) -> None:
        """See `Operator.send`; a key is pressed."""
        os.write(self._keys, b"a" if turning > 0.0 else b"d")

    def estop(self) -> None:
        """See `Operator.estop`."""
        os.write(self._keys, b"!")
