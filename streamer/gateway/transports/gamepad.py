"""`GamepadTargets`: sticks and buttons of gamepads become messages; `GamepadStops`: their stops, in the stop process.

A button that stops is read by both processes, so that it acts while the gateway is busy or dead.
"""

from __future__ import annotations

import itertools
import json
import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.gamepad import Gamepad
from flexmotion.streamer.gateway.hub import Hub
from flexmotion.streamer.gateway.messages import Answer, MessageError, decode
from flexmotion.streamer.gateway.presses import Presses
from flexmotion.streamer.gateway.transports.buttons import Buttons
from flexmotion.streamer.gateway.transports.extras import need
from flexmotion.streamer.gateway.transports.pads import ConnectedPads, Find, code, watch
from flexmotion.streamer.gateway.transports.sticks import Sticks
from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.run.requests import Request

if TYPE_CHECKING:
    from evdev import InputDevice, InputEvent

SOURCE = "gamepad"
_AGAIN_S = 0.1
"""A velocity that is held is sent again after this time [s]."""
_STOPS = {"stop": Request.STOP, "estop": Request.ESTOP}

log = logging.getLogger(__name__)


def check_gamepad(settings: Gamepad) -> None:
    """Check settings that need the library.

    Raises:
        ConfigError: the library is missing, an axis or a button has no such name, or a message is not valid.
    """
    need("evdev", "--gamepad", "gamepad")
    axes = {"forward": settings.forward, "left": settings.left, "turning": settings.turning}
    enable = [] if settings.enable is None else [("enable", settings.enable)]
    for field, name in [*axes.items(), *enable, *(("buttons", name) for name in settings.buttons)]:
        try:
            code(name)
        except KeyError:
            raise ConfigError(
                f"gateway.gamepad.{field}: {name}: expected the name of an input event of Linux, such as BTN_SOUTH"
            ) from None
    for name, content in settings.buttons.items():
        try:
            decode(json.dumps(content))
        except MessageError as error:
            raise ConfigError(f"gateway.gamepad.buttons: {name}: {error}") from None


class GamepadTargets:
    """A `flexmotion.streamer.gateway.hub.Transport`.

    Args:
        settings: what sticks and buttons do.
        find: finds gamepads; None: those of this machine.
    """

    name = SOURCE

    def __init__(self, settings: Gamepad, find: Find | None = None) -> None:
        self.settings, self.find = settings, find or ConnectedPads(settings.device)

    def begin(self, hub: Hub, way: Way) -> Callable[[], None]:
        """See `Transport.begin`."""
        return watch(self.find, lambda device: _Steering(self.settings, device, hub), way, SOURCE)


class _Steering:
    """One gamepad that steers."""

    def __init__(self, settings: Gamepad, device: InputDevice, hub: Hub) -> None:
        self.hub, self._name = hub, str(device.name)
        self._messages = {code(name): content for name, content in settings.buttons.items()}
        self._sticks, self._buttons = Sticks(settings, device), Buttons(device)
        self._sent, self._sent_s = (0.0, 0.0, 0.0), 0.0
        self._numbers = itertools.count(1)
        self._told: str | None = None
        log.info("gamepad: %s is plugged in", self._name)

    def take(self, events: list[InputEvent]) -> None:
        for event in events:
            for button in self._buttons.pressed(event):
                if button in self._messages:
                    self._send(self._messages[button])
            self._sticks.take(event)
        # A stick that is released does not wait for the next round.
        if any(self._sticks.velocity) != any(self._sent):
            self._drive()

    def due(self) -> None:
        velocity = self._sticks.velocity
        held = any(velocity) and time.monotonic() - self._sent_s >= _AGAIN_S
        if held or velocity != self._sent:
            self._drive()

    def lost(self) -> None:
        log.warning("gamepad: %s is gone", self._name)
        if any(self._sent):
            self._sticks.release()
            self._drive()

    def _drive(self) -> None:
        self._sent, self._sent_s = self._sticks.velocity, time.monotonic()
        self._send({"type": "velocity", "velocity": self._sent})

    def _send(self, content: dict[str, Any]) -> None:
        message = {**content, "source": SOURCE, "id": str(next(self._numbers))}
        self.hub.receive(json.dumps(message).encode(), self._answered, self)

    def _answered(self, answer: Answer) -> None:
        reason = f"{answer.asked}: {answer.reason}" if answer.state == "refused" else None
        if reason is not None and reason != self._told:
            log.warning("gamepad: refused: %s", reason)
        self._told = reason


class GamepadStops:
    """A `flexmotion.streamer.gateway.presses.StopInput`; arguments as of `GamepadTargets`."""

    name = SOURCE

    def __init__(self, settings: Gamepad, find: Find | None = None) -> None:
        self.settings, self.find = settings, find or ConnectedPads(settings.device)

    def begin(self, presses: Presses, way: Way) -> Callable[[], None]:
        """See `StopInput.begin`."""
        stops = {
            code(name): _STOPS[content["type"]]
            for name, content in self.settings.buttons.items()
            if content.get("type") in _STOPS
        }
        return watch(self.find, lambda device: _Stopping(stops, device, presses), way, "gamepad-stops")


class _Stopping:
    """The buttons of one gamepad that stop."""

    def __init__(self, stops: dict[int, Request], device: InputDevice, presses: Presses) -> None:
        self._stops, self._presses, self._buttons = stops, presses, Buttons(device)

    def take(self, events: list[InputEvent]) -> None:
        for event in events:
            for button in self._buttons.pressed(event):
                if button in self._stops:
                    self._presses.press(self._stops[button], SOURCE)

    def due(self) -> None:
        """Nothing: a stop is pressed once."""

    def lost(self) -> None:
        """Nothing: the gateway brings the robot to a stand."""
