"""Gamepads: recorded events become messages and stops; released and pulled out they bring the robot to a stand."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.gamepad import Gamepad
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.gateway.presses import Presses
from flexmotion.streamer.gateway.transports.gamepad import GamepadStops, GamepadTargets, check_gamepad
from flexmotion.streamer.gateway.transports.sticks import Sticks, curve
from flexmotion.streamer.motion.intents import Stop, Text, Velocity
from flexmotion.streamer.run.requests import Request

from ....waiting import wait_until
from ..conftest import Run
from .conftest import Serve, Served

evdev = pytest.importorskip("evdev", reason="needs evdev (extra 'gamepad')")
from benchmarks.shared.pads import EmulatedPad, recorded_ranges  # noqa: E402

codes = evdev.ecodes
RECORDING = Path(__file__).parent / "data" / "drive.evemu"
HELD_S = 0.25
"""In the middle of the time for which the stick is held."""
FORWARD, REST = (codes.EV_ABS, codes.ABS_Y, -32768), (codes.EV_ABS, codes.ABS_Y, 0)
SYN = (codes.EV_SYN, codes.SYN_REPORT, 0)


@pytest.fixture
def pad() -> Iterator[EmulatedPad]:
    made = EmulatedPad()
    yield made
    made.close()


@pytest.fixture
def steer(serve: Serve, pad: EmulatedPad) -> Callable[..., Served]:
    """Function (fields of the gamepad) -> a gateway and a stop process that read the emulated gamepad."""

    def start(**fields: Any) -> Served:
        settings = Gamepad.model_validate(fields)
        served = serve((GamepadTargets(settings, pad.find),), (GamepadStops(settings, pad.find),))
        wait_until(lambda: pad.ready == 2, "both to read the gamepad")
        return served

    return start


def enabled(pad: EmulatedPad, *events: tuple[int, int, int]) -> None:
    """Send events while the button that enables the sticks is held."""
    for event in ((codes.EV_KEY, codes.BTN_TL, 1), *events, SYN):
        pad.send(*event)


def velocities(served: Served) -> list[Any]:
    return [target.intent for target in served.loop.seen]


def test_a_recording_walks_stands_waves_and_stops(steer: Callable[..., Served], pad: EmulatedPad) -> None:
    assert recorded_ranges(RECORDING).keys() == pad.ranges.keys()
    served = steer()
    pad.play(RECORDING, end_s=HELD_S)
    wait_until(lambda: velocities(served) and velocities(served)[-1] == Velocity(0.6, 0.0, 0.0), "a walk")
    pad.play(RECORDING, HELD_S)
    wait_until(lambda: Request.STOP in served.loop.requested, "STOP")
    wait_until(lambda: Text("wave with the right hand") in velocities(served), "the wave")
    walked = [intent for intent in velocities(served) if isinstance(intent, Velocity)]
    assert all(intent.forward > 0.0 and not intent.left and not intent.turning for intent in walked)
    assert served.loop.requested.count(Request.ESTOP) == 0


def test_a_held_stick_is_sent_again_with_one_value_and_a_released_one_stands(
    steer: Callable[..., Served], pad: EmulatedPad
) -> None:
    served = steer(expo=0.0)
    enabled(pad, FORWARD)
    wait_until(lambda: len(velocities(served)) >= 3, "the velocity to be sent again")
    for tremble in (-32700, -32300, -32768):
        pad.send(codes.EV_ABS, codes.ABS_Y, tremble)
        pad.send(*SYN)
    before = len(velocities(served))
    wait_until(lambda: len(velocities(served)) >= before + 2, "the velocity to be sent again")
    assert set(velocities(served)) == {Velocity(0.6, 0.0, 0.0)}
    assert {target.holds_s for target in served.loop.seen} == {0.5}
    pad.send(*REST)
    pad.send(*SYN)
    wait_until(lambda: velocities(served)[-1] == Stop(), "the robot to stand")


@pytest.mark.parametrize("gone", ["button", "cable"])
def test_letting_the_button_go_or_pulling_the_plug_stands(
    gone: str, steer: Callable[..., Served], pad: EmulatedPad
) -> None:
    served = steer()
    enabled(pad, FORWARD)
    wait_until(lambda: velocities(served), "a velocity")
    if gone == "cable":
        pad.pull_out()
    else:
        pad.send(codes.EV_KEY, codes.BTN_TL, 0)
        pad.send(*SYN)
    wait_until(lambda: velocities(served)[-1] == Stop(), "the robot to stand")


def test_a_gamepad_that_is_plugged_in_again_steers_and_one_that_is_held_does_not(
    steer: Callable[..., Served], pad: EmulatedPad
) -> None:
    """A stick that is pushed while the gamepad is plugged in made the robot walk at once."""
    served = steer(enable=None)
    pad.pull_out()
    pad.axes[codes.ABS_Y] = -32768
    pad.plug_in()
    wait_until(lambda: pad.ready == 2, "both to read the gamepad")
    pad.send(codes.EV_ABS, codes.ABS_Y, -32000)
    pad.send(*SYN)
    pad.press(codes.BTN_NORTH)
    wait_until(lambda: velocities(served), "the wave")
    assert velocities(served) == [Text("wave with the right hand")]
    pad.send(*REST)
    pad.send(*FORWARD)
    pad.send(*SYN)
    wait_until(lambda: isinstance(velocities(served)[-1], Velocity), "a velocity")


def test_buttons_send_any_message(steer: Callable[..., Served], pad: EmulatedPad, run: Run) -> None:
    served = steer(
        buttons={"BTN_SOUTH": {"type": "hold"}, "BTN_START": {"type": "clear"}, "BTN_WEST": {"type": "stop"}}
    )
    pad.press(codes.BTN_SOUTH)
    wait_until(lambda: velocities(served) == [Stop()], "the hold")
    pad.press(codes.BTN_WEST)
    wait_until(lambda: run.stopped, "STOP")
    pad.press(codes.BTN_START)
    wait_until(lambda: Request.CLEAR in served.loop.requested, "CLEAR")


def test_stops_act_with_the_gateway_dead(steer: Callable[..., Served], pad: EmulatedPad, run: Run) -> None:
    served = steer()
    served.ends.pop()(True)
    pad.press(codes.BTN_MODE)
    wait_until(lambda: Request.ESTOP in served.loop.requested, "the emergency stop")
    assert run.state is not State.OFF


class Device:
    """A gamepad's answers, as evdev gives them."""

    def __init__(self, values: dict[int, int], ranges: tuple[int, int], keys: tuple[int, ...] = ()) -> None:
        self.values, self.ranges, self.keys = values, ranges, keys

    def absinfo(self, axis: int) -> Any:
        return evdev.AbsInfo(self.values[axis], *self.ranges, 0, 0, 0)

    def active_keys(self) -> list[int]:
        return list(self.keys)

    def capabilities(self, absinfo: bool = True) -> dict[int, list[int]]:
        return {codes.EV_ABS: list(self.values)}


@pytest.mark.parametrize("at", ["scan", "read"])
def test_stops_come_again_after_an_error(
    at: str, serve: Serve, pad: EmulatedPad, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error that was no `OSError` ended the thread, and no button stopped the robot any more."""
    errors = [ValueError("a device like no other"), KeyError("BTN_NEW")]
    find, press = pad.find, Presses.press

    def scan(known: set[str]) -> list[Any]:
        if at == "scan" and errors:
            raise errors.pop()
        return find(known)

    def take(self: Presses, *arguments: Any) -> Any:
        if at == "read" and errors:
            raise errors.pop()
        return press(self, *arguments)

    monkeypatch.setattr(Presses, "press", take)
    served = serve((), (GamepadStops(Gamepad(), scan),))
    while errors or Request.ESTOP not in served.loop.requested:
        if pad.ready:
            pad.press(codes.BTN_MODE)
        time.sleep(0.1)
    assert Request.WARNING in served.loop.requested
    wait_until(lambda: served.stops.health.problems()["stops over gamepad"] == "works", "the gamepad to work again")


def test_a_stop_button_among_lost_events_stops(serve: Serve, pad: EmulatedPad) -> None:
    """The press was among the events that the kernel dropped: the robot walked on while the button was held."""
    served = serve((), (GamepadStops(Gamepad(), pad.find),))
    wait_until(lambda: pad.ready, "the gamepad to be read")
    pad.pressed.add(codes.BTN_MODE)  # its event is dropped
    pad.send(codes.EV_SYN, codes.SYN_DROPPED, 0)
    pad.send(*SYN)
    wait_until(lambda: Request.ESTOP in served.loop.requested, "the emergency stop")
    pad.send(codes.EV_SYN, codes.SYN_DROPPED, 0)
    pad.send(*SYN)
    pad.press(codes.BTN_EAST)
    wait_until(lambda: Request.STOP in served.loop.requested, "STOP")
    assert served.loop.requested == [Request.ESTOP, Request.STOP], "a button that is held on is pressed once"


def test_after_a_lost_event_the_gamepad_is_asked_for_its_state() -> None:
    """The release of a stick was among the events that the kernel dropped: the robot walked on."""
    device: Any = Device({codes.ABS_X: 128, codes.ABS_Y: 128, codes.ABS_RX: 128}, (0, 255))
    sticks = Sticks(Gamepad(enable=None, expo=0.0), device)

    def take(kind: int, code: int, value: int) -> tuple[float, float, float]:
        sticks.take(evdev.InputEvent(0, 0, kind, code, value))
        return sticks.velocity

    assert take(codes.EV_ABS, codes.ABS_Y, 0)[0] == 0.6
    take(codes.EV_SYN, codes.SYN_DROPPED, 0)
    assert take(codes.EV_ABS, codes.ABS_X, 0)[1] == 0.0  # of an incomplete report
    assert take(*SYN) == (0.0, 0.0, 0.0)


def test_a_gamepad_without_one_of_the_sticks_drives_with_the_others() -> None:
    device: Any = Device({codes.ABS_X: 0, codes.ABS_Y: 0}, (-100, 100))
    sticks = Sticks(Gamepad(enable=None, expo=0.0), device)
    sticks.take(evdev.InputEvent(0, 0, codes.EV_ABS, codes.ABS_RX, -100))
    sticks.take(evdev.InputEvent(0, 0, codes.EV_ABS, codes.ABS_X, 100))
    assert sticks.velocity == (0.0, -0.3, 0.0)


def test_the_curve_is_continuous_zero_in_the_dead_band_and_reaches_the_end() -> None:
    values = [curve(step / 1000, 0.12, 0.4) for step in range(-1000, 1001)]
    assert values[0] == -1.0 and values[-1] == 1.0
    assert all(curve(inside, 0.12, 0.4) == 0.0 for inside in (-0.12, -0.05, 0.0, 0.12))
    steps = [after - before for before, after in zip(values, values[1:], strict=False)]
    assert min(steps) >= 0.0 and max(steps) < 0.003
    assert curve(0.56, 0.12, 0.0) == pytest.approx(0.5) and curve(0.56, 0.12, 1.0) == pytest.approx(0.125)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("forward", "ABS_QUITE", "gateway.gamepad.forward: ABS_QUITE"),
        ("enable", "BTN_NONE", "gateway.gamepad.enable: BTN_NONE"),
        ("buttons", {"BTN_NONE": {"type": "stop"}}, "gateway.gamepad.buttons: BTN_NONE"),
        ("buttons", {"BTN_SOUTH": {"type": "dance"}}, "BTN_SOUTH: type: expected one of"),
        ("buttons", {"BTN_SOUTH": {"type": "text"}}, "BTN_SOUTH: .*text: missing"),
    ],
)
def test_settings_that_name_nothing_are_refused(field: str, value: Any, said: str) -> None:
    check_gamepad(Gamepad())
    with pytest.raises(ConfigError, match=said):
        check_gamepad(Gamepad.model_validate(json.loads(json.dumps({field: value}))))
