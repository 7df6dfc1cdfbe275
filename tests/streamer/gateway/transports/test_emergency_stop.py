"""An emergency stop over HTTP and each transport is at the driver within two periods of its arrival, without a gateway.

Counted in ticks: the loop makes none while the process handles the request.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from flexmotion.configs.gamepad import Gamepad
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway, load_stream
from flexmotion.drivers.interface import JointCommand
from flexmotion.drivers.registry import create
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.connection import StopAnswer
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.presses import StopInput
from flexmotion.streamer.gateway.stops import StopService
from flexmotion.streamer.gateway.transports.ros2_messages import EMPTY, Ros2Messages
from flexmotion.streamer.gateway.transports.ros2_node import Ros2Link, Ros2Node
from flexmotion.streamer.gateway.transports.ros2_stops import Ros2Stops
from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.requests import Request, RequestChannel
from flexmotion.streamer.run.session import Session

from ....waiting import HANGING_S, wait_until
from ..conftest import listens
from .conftest import open_session

StartRouter = Callable[[str], object]


@dataclass
class Over:
    """One way for an emergency stop.

    Attributes:
        press: sends it, given the stop process.
        input: of the stop process; None: its port.
        told: answers, where the way has some.
    """

    press: Callable[[StopService], None]
    input: StopInput | None
    told: list[StopAnswer]


@pytest.fixture
def open_ways() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def over_http(ways: ExitStack, _start_router: StartRouter) -> Over:
    told: list[StopAnswer] = []

    def press(service: StopService) -> None:
        wait_until(lambda: listens(service.port), "the stop process to listen")
        client = Client(stop_port=service.port)
        thread = threading.Thread(target=lambda: told.append(client.estop()))
        thread.start()
        ways.callback(thread.join, HANGING_S)

    return Over(press, None, told)


def over_zenoh(ways: ExitStack, _start_router: StartRouter) -> Over:
    pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra 'zenoh')")
    from flexmotion.streamer.gateway.transports.zenoh_link import zenoh_links
    from flexmotion.streamer.gateway.transports.zenoh_stops import ZenohStops

    settings = Gateway(zenoh_port=any_free(), zenoh_stop_port=any_free())
    _, link = zenoh_links("op3", "127.0.0.1", None, settings)

    def press(_service: StopService) -> None:
        session = ways.enter_context(open_session([link.listen]))
        wait_until(lambda: list(session.liveliness().get("flexmotion/op3/alive/stops")), "the stop process")
        session.put("flexmotion/op3/estop", b"")

    return Over(press, ZenohStops(link), [])


def over_ros2(ways: ExitStack, start_router: StartRouter) -> Over:
    pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra 'ros2')")
    pytest.importorskip("rosbags", reason="needs rosbags (extra 'ros2')")
    link = Ros2Link("op3", any_free(), 0)
    start_router(link.router)
    messages = Ros2Messages()

    def press(_service: StopService) -> None:
        session = ways.enter_context(open_session([link.router]))
        node = Ros2Node(link, session, "operator", messages, Way("operator", RequestChannel()))
        seen = "@ros2_lv/**/flexmotion_stops/%op3%estop/**"
        wait_until(lambda: list(session.liveliness().get(seen)), "the stop process")
        send = node.publish("estop", EMPTY)
        send(messages.empty())

    return Over(press, Ros2Stops(link), [])


def over_gamepad(ways: ExitStack, _start_router: StartRouter) -> Over:
    evdev = pytest.importorskip("evdev", reason="needs evdev (extra 'gamepad')")
    from benchmarks.shared.pads import EmulatedPad, wait_for_readers
    from flexmotion.streamer.gateway.transports.gamepad import GamepadStops

    pad = EmulatedPad()
    ways.callback(pad.close)

    def press(_service: StopService) -> None:
        wait_for_readers(pad, 1)
        pad.press(evdev.ecodes.BTN_MODE)

    return Over(press, GamepadStops(Gamepad(), pad.find), [])


@pytest.mark.parametrize(
    ("over", "after_s"),
    [(over_http, 2.5), (over_http, 3.1), (over_zenoh, 2.5), (over_ros2, 2.5), (over_gamepad, 2.5)],
)
def test_an_emergency_stop_is_at_the_driver_within_two_periods(
    over: Callable[[ExitStack, StartRouter], Over],
    after_s: float,
    op3: Robot,
    open_ways: ExitStack,
    start_router: StartRouter,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    way = over(open_ways, start_router)
    driver = create("sim", op3, seed=0)
    session = Session(op3, driver, ClipSource(default_clip()[225:330]), load_stream())
    service = StopService(
        session.settings.gateway,
        session.telemetry,
        Admission() if way.input is None else None,
        port=any_free(),
        inputs=() if way.input is None else (way.input,),
    )
    session.services = (service,)
    written: list[np.ndarray] = []
    write = driver.write

    def record(command: JointCommand) -> None:
        written.append(command.position.copy())
        write(command)

    monkeypatch.setattr(driver, "write", record)
    with session:
        while session.state.ladder is not State.STREAMING:
            session.step()
        session.advance(after_s)
        in_memory = service.requests.reader()
        in_memory.read()
        way.press(service)
        wait_until(lambda: arrived(in_memory.read()), "the request to reach the loop's memory")
        newest, before = session.state.tick, len(written)
        session.step()
        session.step()
        assert len(written) == before + 2 and session.state.tick == newest + 2
        assert (written[-1] == written[before - 1]).all(), "the goals still move two periods after the emergency stop"
        assert session.state.ladder is State.HOLD
        while session.step():
            pass
    open_ways.close()
    assert session.state.ladder is State.FAULT
    for answer in way.told:
        assert answer.state == "accepted" and answer.tick is not None and answer.arrived_tick is not None
        assert 0 < answer.tick - answer.arrived_tick <= 2
    assert len(way.told) == (over is over_http)


def arrived(requests: list[tuple[Request, Any]]) -> bool:
    return any(request is Request.ESTOP for request, _ in requests)
