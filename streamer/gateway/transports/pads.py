"""Gamepads of Linux (`evdev`): which are plugged in, and what they send."""

from __future__ import annotations

import logging
import os
import select
import threading
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from flexmotion.streamer.gateway.ways import Way

if TYPE_CHECKING:
    from evdev import InputDevice, InputEvent

_SCAN_S, _DUE_S = 1.0, 0.05
"""Time between two looks for new gamepads, and between two calls of `Follower.due` [s]."""

Find = Callable[[set[str]], Iterable["InputDevice"]]
"""Function (paths of known gamepads) -> further ones, opened."""


log = logging.getLogger(__name__)


class Follower(Protocol):
    """What is done with one gamepad; all methods are called in the thread of `watch`."""

    def take(self, events: list[InputEvent]) -> None:
        """Events have come."""

    def due(self) -> None:
        """Called over and over."""

    def lost(self) -> None:
        """The gamepad is gone."""


class ConnectedPads:
    """Finds the gamepads that are plugged in: devices with sticks and the buttons of a gamepad.

    Args:
        name: part of the name; None: any.
    """

    def __init__(self, name: str | None = None) -> None:
        self.name = name
        self._others: set[tuple[str, int]] = set()

    def __call__(self, known: set[str]) -> list[InputDevice]:
        """The gamepads whose path is not known."""
        from evdev import InputDevice, list_devices

        found = []
        for path in sorted(list_devices()):
            try:
                identity = (path, os.stat(path).st_ctime_ns)
                if path in known or identity in self._others:
                    continue
                device = InputDevice(path)
            except OSError:
                continue  # pulled out meanwhile
            if self._is_pad(device):
                found.append(device)
            else:
                self._others.add(identity)
                device.close()
        return found

    def _is_pad(self, device: InputDevice) -> bool:
        from evdev import ecodes

        known = device.capabilities(absinfo=False)
        is_pad = ecodes.BTN_GAMEPAD in known.get(ecodes.EV_KEY, ()) and ecodes.ABS_X in known.get(ecodes.EV_ABS, ())
        return is_pad and (self.name is None or self.name in device.name)


def watch(find: Find, follow: Callable[[InputDevice], Follower], way: Way, name: str) -> Callable[[], None]:
    """Follow all gamepads in a thread of its own, those plugged in later as well; returns what ends it.

    Args:
        find: finds gamepads.
        follow: makes what is done with a new one.
        way: is told what fails; then gamepads are looked for anew.
        name: of the thread.
    """
    ended = threading.Event()
    thread = way.keep(partial(_watch, find, follow, way, ended), ended, name)

    def end() -> None:
        ended.set()
        thread.join(_SCAN_S)

    return end


def _watch(find: Find, follow: Callable[[InputDevice], Follower], way: Way, ended: threading.Event) -> None:
    pads: dict[int, tuple[InputDevice, Follower]] = {}
    rounds = 0
    try:
        while not ended.is_set():
            if rounds % round(_SCAN_S / _DUE_S) == 0:
                for device in find({str(known.path) for known, _ in pads.values()}):
                    try:
                        pads[device.fd] = (device, follow(device))
                    except OSError:  # pulled out again
                        device.close()
                way.works()
            rounds += 1
            for descriptor in select.select(list(pads), [], [], _DUE_S)[0]:
                device, follower = pads[descriptor]
                try:
                    follower.take(list(device.read()))
                except OSError:  # pulled out
                    _lose(*pads.pop(descriptor))
                except Exception as error:  # of one gamepad: it is opened again, the others go on
                    _lose(*pads.pop(descriptor))
                    way.failed(error)
            for _, follower in pads.values():
                follower.due()
    finally:
        for device, follower in pads.values():
            _lose(device, follower)


def _lose(device: InputDevice, follower: Follower) -> None:
    try:
        follower.lost()
    except Exception:
        log.exception("gamepad: %s was lost in disorder", device.name)
    finally:
        device.close()


def code(name: str) -> int:
    """The number of an axis or a button. Raises `KeyError`."""
    from evdev import ecodes

    number: Any = ecodes.ecodes[name]
    return int(number)
