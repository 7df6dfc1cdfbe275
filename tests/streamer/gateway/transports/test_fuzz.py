"""Bytes that are no message, at each transport's own decoder: every one is answered or ignored, and none breaks it."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexmotion.configs.gamepad import Gamepad
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.lines import Lines
from flexmotion.streamer.gateway.messages import KINDS, Answer
from flexmotion.streamer.gateway.transports.buttons import Buttons
from flexmotion.streamer.gateway.transports.ros2_messages import STRING, TWIST, TWIST_STAMPED, Ros2Messages
from flexmotion.streamer.gateway.transports.ros2_node import Ros2Link
from flexmotion.streamer.gateway.transports.ros2_targets import Ros2Targets
from flexmotion.streamer.gateway.transports.ros2_targets import _Desk as Ros2Desk
from flexmotion.streamer.gateway.transports.sticks import Sticks
from flexmotion.streamer.gateway.transports.zenoh_link import ZenohLink
from flexmotion.streamer.gateway.transports.zenoh_targets import _Desk as ZenohDesk
from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.run.requests import Request, RequestChannel

from ....waiting import HANGING_S
from ..conftest import Office
from .ros2_peer import twist, twist_stamped

EXAMPLES = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
TOKEN = "correct horse battery"
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner, max_size=4),
    max_leaves=8,
)
FIELDS = st.sampled_from(
    ["type", "id", "source", "sequence", "stamp_s", "ttl_s", "text", "velocity", "confirm", "version"]
)
MESSAGES = st.builds(
    lambda kind, fields: json.dumps({"type": kind, **fields}).encode(),
    st.sampled_from(sorted(KINDS)),
    st.dictionaries(FIELDS, JSON, max_size=4),
)
ANY = st.binary(max_size=400) | JSON.map(lambda value: json.dumps(value).encode()) | MESSAGES


class HubOf:
    """A hub whose desk answers in the caller's thread."""

    def __init__(self, office: Office) -> None:
        self.office, self.settings = office, office.desk.settings

    def receive(self, data: bytes, reply: Callable[[Answer], None], sender: Any = None) -> None:
        self.office.desk.receive(data, reply, sender)

    def reject(self, why: str) -> None:
        self.office.desk.reject(why)


@pytest.fixture
def hub(make_office: Callable[..., Office]) -> Any:
    return HubOf(make_office())


def way() -> Way:
    return Way("fuzz", RequestChannel())


def message(key: str, data: bytes, attachment: bytes | None) -> Any:
    """A sample of zenoh."""

    def wrapped(value: bytes) -> Any:
        return SimpleNamespace(to_bytes=lambda: value)

    return SimpleNamespace(
        key_expr=key, payload=wrapped(data), attachment=None if attachment is None else wrapped(attachment)
    )


def counted(hub: Any) -> int:
    """Messages that have an answer, or wait for the planner's or the loop's."""
    desk = hub.office.desk
    waiting = len(desk._open) + len(desk._asked) + len(desk._behind) + (desk._waiting is not None)
    states = ("accepted", "slowed", "partly", "superseded", "expired", "refused")
    return sum(desk.counts[state] for state in states) + waiting


@given(data=ANY, attachment=st.none() | st.binary(max_size=120), operator=st.text(min_size=1, max_size=80))
@EXAMPLES
def test_zenoh_without_a_token(hub: Any, data: bytes, attachment: bytes | None, operator: str) -> None:
    desk = ZenohDesk(ZenohLink("op3", None, "tcp/127.0.0.1:1"), hub, way())
    before = counted(hub)
    desk._put(message(f"flexmotion/op3/targets/{operator}", data, attachment))
    assert counted(hub) == before + 1, "a message without an answer"


@given(data=ANY, attachment=st.none() | st.binary(max_size=120))
@EXAMPLES
def test_zenoh_with_a_token(hub: Any, data: bytes, attachment: bytes | None) -> None:
    desk = ZenohDesk(ZenohLink("op3", TOKEN, "tcp/127.0.0.1:1"), hub, way())
    desk._put(message("flexmotion/op3/targets/alice", data, attachment))
    assert desk._out.qsize() == 1 and hub.office.desk.counts["received"] == 0


pytest.importorskip("rosbags", reason="needs rosbags (extra 'ros2')")
CDR = Ros2Messages()


def whole(kind: str) -> st.SearchStrategy[bytes]:
    """Messages of a type that can be decoded."""
    number = st.floats(width=64)
    vector = st.tuples(number, number, number)
    if kind == STRING:
        texts = st.text(max_size=60) | ANY.map(lambda data: data.decode("utf-8", "replace"))
        return texts.map(lambda text: CDR.string(text.replace("\0", "")))
    if kind == TWIST:
        return st.builds(twist, vector, vector)
    return st.builds(twist_stamped, st.integers(0, 2**31 * 10**9 - 1), vector, vector)


def damaged(data: bytes, place: int, value: int, length: int) -> bytes:
    """A message with one byte changed, or cut off."""
    place %= max(len(data), 1)
    return (data[:place] + bytes([value]) + data[place + 1 :])[: length if length % 3 == 0 else None]


@pytest.mark.parametrize(
    ("topic", "kind"),
    [("targets", STRING), ("text", STRING), ("cmd_vel", TWIST_STAMPED), ("cmd_vel_unstamped", TWIST)],
)
@given(draw=st.data())
@EXAMPLES
def test_ros_2(hub: Any, op3: Robot, topic: str, kind: str, draw: st.DataObject) -> None:
    """Malformed CDR raised IndexError and struct.error in zenoh's thread."""
    desk = Ros2Desk(Ros2Targets(Ros2Link("op3", 1, 0), op3, 4.0, 50.0, Gateway().ros2_types), hub, way())
    take = {name: take for name, _, take in desk.takers()}[topic]
    before = counted(hub)
    data = draw.draw(
        st.binary(max_size=200)
        | whole(kind)
        | st.builds(damaged, whole(kind), st.integers(0, 500), st.integers(0, 255), st.integers(0, 300))
    )
    take(data)
    assert counted(hub) + desk._answers.qsize() > before, "a message without an answer"
    assert {request for request, _ in hub.office.requests.reader().read()} <= {Request.STOP, Request.ESTOP}


class Pad:
    """A gamepad with a stick and a few buttons, as evdev has it."""

    def __init__(self, held: list[int], value: int) -> None:
        self.held, self.value = held, value

    def active_keys(self) -> list[int]:
        return self.held

    def absinfo(self, _axis: int) -> Any:
        return SimpleNamespace(min=-100, max=100, value=self.value)

    def capabilities(self, absinfo: bool = True) -> dict[int, list[int]]:
        return {3: [0, 1, 3]}


CODES = st.sampled_from([0, 1, 3, 0x131, 0x13C, 0x136]) | st.integers(0, 0xFFFF)  # axes, East, Mode, left shoulder
EVENT = st.tuples(st.integers(0, 5), CODES, st.integers(-(2**31), 2**31 - 1) | st.integers(0, 2))


@given(events=st.lists(EVENT, max_size=30), held=st.lists(CODES, max_size=3), value=st.integers(-200, 200))
@EXAMPLES
def test_gamepads(events: list[tuple[int, int, int]], held: list[int], value: int) -> None:
    evdev = pytest.importorskip("evdev", reason="needs evdev (extra 'gamepad')")
    pad: Any = Pad(held, value)
    sticks, buttons = Sticks(Gamepad(), pad), Buttons(pad)
    for kind, code, amount in events:
        event = evdev.InputEvent(0, 0, kind, code, amount)
        for button in buttons.pressed(event):
            assert (kind, code, amount) == (1, button, 1) or (kind == 0 and button in held)
        sticks.take(event)
        assert all(abs(speed) <= most for speed, most in zip(sticks.velocity, Gamepad().fastest, strict=True))


@given(lines=st.lists(ANY | st.binary(max_size=6000), max_size=20))
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_lines(hub: Any, lines: list[bytes]) -> None:
    """Each line that is not blank gets one answer, or waits for one, and the input is read to its end."""
    desk, told = hub.office.desk, way()
    expected = [part for line in lines for part in line.split(b"\n") if part.strip()]
    before = desk.counts["received"]

    async def read() -> None:
        source, out = os.pipe()
        sink = os.open(os.devnull, os.O_WRONLY)
        Lines(source, sink, desk, lambda: None, told)
        await asyncio.to_thread(write, out)
        while desk.counts["received"] < before + len(expected):
            await asyncio.sleep(0.001)

    def write(out: int) -> None:
        with os.fdopen(out, "wb") as pipe:
            pipe.write(b"\n".join(lines) + b"\n")

    asyncio.run(asyncio.wait_for(read(), HANGING_S))
    assert desk.counts["received"] == before + len(expected) and told.problem is None
