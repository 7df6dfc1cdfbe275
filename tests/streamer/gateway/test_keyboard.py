"""Steering by keys: what a terminal sends, and a run that is steered through a pseudo-terminal."""

from __future__ import annotations

import asyncio
import io
import os
import pty
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.async_client import AsyncClient
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.keyboard import Keyboard, keys_at_once
from flexmotion.streamer.gateway.keys import AGAIN_S, FIRST_S, HeldKeys, KeyReader
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.gateway.stops import StopService
from flexmotion.streamer.motion.intents import Stop, Text, Velocity
from flexmotion.streamer.run.requests import Request, RequestChannel

from ...waiting import wait_until
from .conftest import Answering, Run, listens

FASTEST = (0.3, 0.15, 0.5)


def test_what_terminals_send_is_split_into_keys() -> None:
    reader = KeyReader()
    assert reader.keys(b"ww\x1b[A\x1bOD ") == ["w", "w", "up", "left", " "]
    assert reader.keys(b"\x1b") == ["escape"] and reader.keys(b"\x1b\x1b[B") == ["escape", "down"]
    assert reader.keys(b"\x1b[1;5A\x1b[3~\x1b[200~q") == ["q"]  # with Ctrl, Delete, the begin of pasted text
    assert reader.keys(b"gr" + b"\xc3") + reader.keys(b"\xbc\xff") == ["g", "r", "ü", "\ufffd"]


@given(st.lists(st.binary(max_size=40), max_size=10))
def test_no_bytes_break_it(parts: list[bytes]) -> None:
    reader = KeyReader()
    assert all(keys for part in parts for keys in reader.keys(part))


def test_a_key_counts_until_its_repetition_fails_to_come() -> None:
    """A terminal does not tell that a key is let go, and waits up to half a second before it repeats one."""
    held = HeldKeys(FASTEST)
    assert held.press("w", 0.0) and not held.press("x", 0.0)
    assert held.velocity(FIRST_S - 0.01) == (0.3, 0.0, 0.0)
    held.press("w", 0.5)
    assert held.velocity(0.5 + AGAIN_S - 0.01) == (0.3, 0.0, 0.0) and not any(held.velocity(0.5 + AGAIN_S + 0.01))
    held.press("W", 2.0)
    held.press("up", 2.0)
    held.press("a", 2.0)
    held.press("e", 2.0)
    assert held.velocity(2.1) == (0.3, -0.15, 0.5)
    held.press("s", 2.1)
    assert held.velocity(2.2)[0] == 0.3  # of "w", "up" and "s"
    held.release()
    assert not any(held.velocity(2.2))


class Terminal:
    """A keyboard that steers in a thread, with the test at the keys."""

    def __init__(self, port: int, stop_port: int) -> None:
        self.keys, terminal = pty.openpty()
        self.shown = io.StringIO()
        keyboard = Keyboard(
            lambda: AsyncClient(port=port, source="keyboard"),
            Client(port=port, stop_port=stop_port),
            FASTEST,
            self.shown,
        )

        def steer() -> None:
            with keys_at_once(terminal):
                asyncio.run(keyboard.run(terminal))
            os.close(terminal)

        self.thread = threading.Thread(target=steer)
        self.thread.start()

    def press(self, keys: bytes) -> None:
        os.write(self.keys, keys)

    def close(self) -> None:
        if self.keys is not None:
            os.close(self.keys)
            self.keys = None
            self.thread.join()

    keys: int | None


@dataclass
class Steered:
    """A keyboard at a run, and the run's loop."""

    keyboard: Terminal
    loop: Answering
    begin_gateway: Callable[[], None]
    ends: list[Callable[[bool], None]]


@pytest.fixture
def steered(run: Run, op3: Robot, answering: Callable[..., Answering]) -> Iterator[Steered]:
    ports = any_free(), any_free()
    ends: list[Callable[[bool], None]] = []

    def begin_gateway() -> None:
        gateway = GatewayService(
            op3, "sim", Gateway(), run.telemetry, run.targets, run.heard, Admission(), port=ports[0], stop_port=1
        )
        ends.append(gateway.follow())
        channels.append(gateway.requests)

    channels: list[RequestChannel] = []
    stops = StopService(Gateway(), run.telemetry, Admission(), port=ports[1])
    ends.append(stops.follow())
    begin_gateway()
    for port in ports:
        wait_until(lambda port=port: listens(port), "both services to listen")
    loop = answering(*channels, stops.requests)
    keyboard = Terminal(*ports)
    wait_until(lambda: "connected" in keyboard.shown.getvalue(), "the connection")
    yield Steered(keyboard, loop, begin_gateway, ends)
    keyboard.close()
    for end in ends:
        end(True)


def test_a_key_walks_and_let_go_stands(steered: Steered) -> None:
    keyboard, loop = steered.keyboard, steered.loop
    keyboard.press(b"w")
    wait_until(lambda: loop.seen and loop.seen[-1].intent == Velocity(0.3, 0.0, 0.0), "the walk")
    assert loop.seen[-1].holds_s < FIRST_S
    wait_until(lambda: loop.seen[-1].intent == Stop(), "the stand")


def test_sentences_stops_and_clear(steered: Steered) -> None:
    keyboard, loop = steered.keyboard, steered.loop
    keyboard.press("/wave twiced\x7f, grüß mich\r".encode())
    wait_until(lambda: loop.seen, "the sentence")
    assert loop.seen[0].intent == Text("wave twice, grüß mich")
    keyboard.press(b"/\r ")  # a sentence of no words, then a STOP
    wait_until(lambda: loop.requested == [Request.STOP], "STOP")
    wait_until(lambda: "stop: accepted" in keyboard.shown.getvalue(), "its answer")
    keyboard.press(b"c")
    wait_until(lambda: loop.requested == [Request.STOP, Request.CLEAR], "CLEAR")
    keyboard.press(b"!")
    wait_until(lambda: loop.requested[-1] == Request.ESTOP, "the emergency stop")
    assert len(loop.seen) == 1


def test_escape_stops_in_the_middle_of_a_sentence(steered: Steered) -> None:
    """While a sentence was typed, no key stopped the robot: space was a letter of it, and Escape gave it up."""
    keyboard, loop = steered.keyboard, steered.loop
    keyboard.press(b"/ space is no STOP here!\x1b")
    wait_until(lambda: loop.requested == [Request.STOP], "STOP")
    keyboard.press(b"c")
    wait_until(lambda: loop.requested == [Request.STOP, Request.CLEAR], "keys that are no letters any more")
    assert loop.seen == []


def test_stops_work_with_the_gateway_dead_and_a_gateway_that_comes_back_is_used(steered: Steered) -> None:
    keyboard, loop = steered.keyboard, steered.loop
    steered.ends.pop()(True)
    wait_until(lambda: "no run listens" in keyboard.shown.getvalue(), "the lost connection to be told")
    keyboard.press(b"w ")
    wait_until(lambda: loop.requested == [Request.STOP], "STOP")
    assert loop.seen == []
    before = keyboard.shown.getvalue().count("connected")
    steered.begin_gateway()
    wait_until(lambda: keyboard.shown.getvalue().count("connected") > before, "the connection to the next gateway")
    keyboard.press(b"w")
    wait_until(lambda: loop.seen, "the walk")


def test_a_line_wider_than_the_terminal_stays_and_is_shown_once(
    steered: Steered, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ten refusals a second filled the terminal while a key was held: of each only the last row was replaced."""
    keyboard = steered.keyboard
    monkeypatch.setenv("COLUMNS", "30")
    steered.ends.pop()(True)
    wait_until(lambda: "no run listens" in keyboard.shown.getvalue(), "the lost connection to be told")
    steered.begin_gateway()
    wait_until(lambda: keyboard.shown.getvalue().endswith("connected"), "the connection to the next gateway")
    shown = keyboard.shown.getvalue().split("\r\x1b[K")
    assert all(text.endswith("\n") for text in shown if "no run listens" in text)
    assert all(one != other for one, other in pairwise(shown))
    keyboard.press(b" ")
    wait_until(lambda: "stop: accepted, c releases it" in keyboard.shown.getvalue(), "how to go on")


def test_a_terminal_that_is_closed_stands_the_robot(steered: Steered) -> None:
    keyboard, loop = steered.keyboard, steered.loop
    keyboard.press(b"wwwwwwwwww")
    wait_until(lambda: loop.seen and loop.seen[-1].intent == Velocity(0.3, 0.0, 0.0), "the walk")
    keyboard.close()
    wait_until(lambda: loop.seen[-1].intent == Stop(), "the stand")


def test_what_is_no_terminal_is_refused() -> None:
    read, write = os.pipe()
    try:
        with pytest.raises(ConfigError, match="no terminal"), keys_at_once(read):
            raise AssertionError("a pipe was taken for a terminal")
    finally:
        os.close(read)
        os.close(write)
