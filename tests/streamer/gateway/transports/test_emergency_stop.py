"""An emergency stop over each transport is at the driver within two periods of its arrival, without the gateway."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from flexmotion.configs.gamepad import Gamepad
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway, load_stream
from flexmotion.drivers.interface import JointCommand
from flexmotion.drivers.registry import create
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.presses import StopInput
from flexmotion.streamer.gateway.stops import StopService
from flexmotion.streamer.gateway.transports.ros2_messages import EMPTY, Ros2Messages
from flexmotion.streamer.gateway.transports.ros2_node import Ros2Link, Ros2Node
from flexmotion.streamer.gateway.transports.ros2_stops import Ros2Stops
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.session import Session

from ....waiting import wait_until
from .conftest import open_session

WALKING_S = 2.5
Way = tuple[StopInput, Callable[[], None]]
StartRouter = Callable[[str], object]


@pytest.fixture
def open_ways() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def over_zenoh(ways: ExitStack, _start_router: StartRouter) -> Way:
    pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra 'zenoh')")
    from flexmotion.streamer.gateway.transports.zenoh_link import zenoh_links
    from flexmotion.streamer.gateway.transports.zenoh_stops import ZenohStops

    settings = Gateway(zenoh_port=any_free(), zenoh_stop_port=any_free())
    _, link = zenoh_links("op3", "127.0.0.1", None, settings)

    def press() -> None:
        session = ways.enter_context(open_session([link.listen]))
        wait_until(lambda: list(session.liveliness().get("flexmotion/op3/alive/stops")), "the stop process")
        session.put("flexmotion/op3/estop", b"")

    return ZenohStops(link), press


def over_ros2(ways: ExitStack, start_router: StartRouter) -> Way:
    pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra 'ros2')")
    pytest.importorskip("rosbags", reason="needs rosbags (extra 'ros2')")
    link = Ros2Link("op3", any_free(), 0)
    start_router(link.router)
    messages = Ros2Messages()

    def press() -> None:
        session = ways.enter_context(open_session([link.router]))
        node = Ros2Node(link, session, "operator", messages)
        seen = "@ros2_lv/**/flexmotion_stops/%op3%estop/**"
        wait_until(lambda: list(session.liveliness().get(seen)), "the stop process")
        send = node.publish("estop", EMPTY)
        send(messages.empty())

    return Ros2Stops(link), press


def over_gamepad(ways: ExitStack, _start_router: StartRouter) -> Way:
    evdev = pytest.importorskip("evdev", reason="needs evdev (extra 'gamepad')")
    from benchmarks.shared.pads import EmulatedPad, wait_for_readers
    from flexmotion.streamer.gateway.transports.gamepad import GamepadStops

    pad = EmulatedPad()
    ways.callback(pad.close)

    def press() -> None:
        wait_for_readers(pad, 1)
        pad.press(evdev.ecodes.BTN_MODE)

    return GamepadStops(Gamepad(), pad.find), press


@pytest.mark.parametrize("over", [over_zenoh, over_ros2, over_gamepad])
def test_an_emergency_stop_is_at_the_driver_within_two_periods(
    over: Callable[[ExitStack, StartRouter], Way],
    op3: Robot,
    open_ways: ExitStack,
    start_router: StartRouter,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Counted in ticks: the loop makes none while the process handles the request."""
    way, press = over(open_ways, start_router)
    driver = create("sim", op3, seed=0)
    session = Session(op3, driver, ClipSource(default_clip()[225:330]), load_stream())
    service = StopService(session.settings.gateway, session.telemetry, None, inputs=(way,))
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
        session.advance(WALKING_S)
        requests = service.requests._ring
        press()
        wait_until(lambda: requests.count == 1, "the request to reach the loop's memory")
        arrived, before = session.state.tick, len(written)
        session.step()
        session.step()
        assert len(written) == before + 2 and session.state.tick == arrived + 2
        assert (written[-1] == written[before - 1]).all(), "the goals still move two periods after the emergency stop"
        assert session.state.ladder is State.HOLD
        while session.step():
            pass
    assert session.state.ladder is State.FAULT
