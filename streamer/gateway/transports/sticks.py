"""`Sticks`: the velocity that the sticks of a gamepad ask for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexmotion.configs.gamepad import Gamepad
from flexmotion.streamer.gateway.transports.pads import code

if TYPE_CHECKING:
    from evdev import InputDevice, InputEvent

_STEP = 0.04
"""Change of the velocity that is followed, as a share of the fastest: a held stick trembles."""


def curve(deflection: float, dead_band: float, expo: float) -> float:
    """Share of the fastest speed in [-1, 1] for a deflection in [-1, 1]; continuous, zero within the dead band."""
    beyond = min(max((abs(deflection) - dead_band) / (1.0 - dead_band), 0.0), 1.0)
    share = (1.0 - expo) * beyond + expo * beyond**3
    return share if deflection >= 0.0 else -share


class Sticks:
    """The sticks of one gamepad. A stick counts once it has been seen at rest: one that is held at the start does not.

    Args:
        settings: axes, speeds and curve.
        device: the gamepad, for its ranges and its state.

    Attributes:
        velocity: forward, left [m/s], turning left [rad/s]; zero while the button that enables the sticks is not held.
    """

    def __init__(self, settings: Gamepad, device: InputDevice) -> None:
        self._settings, self._device = settings, device
        self._axes = [code(name) for name in (settings.forward, settings.left, settings.turning)]
        self._enable = None if settings.enable is None else code(settings.enable)
        self._deflections: dict[int, float] = {}
        self._ranges: dict[int, tuple[int, int]] = {}
        self._rested: set[int] = set()
        self._enabled = self._dropped = False
        self.velocity = (0.0, 0.0, 0.0)
        self._look()

    def take(self, event: InputEvent) -> None:
        """Follow an event."""
        from evdev import ecodes

        if event.type == ecodes.EV_SYN:
            if event.code == ecodes.SYN_DROPPED:  # the kernel's buffer ran over: its events are incomplete
                self._dropped = True
            elif event.code == ecodes.SYN_REPORT and self._dropped:
                self._dropped = False
                self._look()
        elif self._dropped:
            return
        elif event.type == ecodes.EV_ABS and event.code in self._ranges:
            self._move(event.code, event.value)
        elif event.type == ecodes.EV_KEY and event.code == self._enable:
            self._enabled = bool(event.value)
        self._follow()

    def release(self) -> None:
        """As if all sticks were let go."""
        self._deflections.clear()
        self._follow()

    def _look(self) -> None:
        """Ask the gamepad for its state."""
        from evdev import ecodes

        has = self._device.capabilities(absinfo=False).get(ecodes.EV_ABS, ())
        for axis in (axis for axis in self._axes if axis in has):
            info = self._device.absinfo(axis)
            if info.max > info.min:
                self._ranges[axis] = (info.min, info.max)
                self._move(axis, info.value)
        self._enabled = self._enable in self._device.active_keys()

    def _move(self, axis: int, value: int) -> None:
        low, high = self._ranges[axis]
        # Up and to the left are negative in Linux, and forward and left here.
        deflection = 1.0 - 2.0 * (value - low) / (high - low)
        self._deflections[axis] = deflection
        if abs(deflection) <= self._settings.dead_band:
            self._rested.add(axis)

    def _follow(self) -> None:
        velocity = [0.0, 0.0, 0.0]
        if self._enable is None or self._enabled:
            for place, axis in enumerate(self._axes):
                deflection = self._deflections.get(axis, 0.0) if axis in self._rested else 0.0
                share = curve(deflection, self._settings.dead_band, self._settings.expo)
                velocity[place] = round(share * self._settings.fastest[place], 3)
        steps = [_STEP * fastest for fastest in self._settings.fastest]
        if not any(velocity) or any(
            abs(new - old) > step or (new == 0.0) != (old == 0.0)
            for new, old, step in zip(velocity, self.velocity, steps, strict=True)
        ):
            self.velocity = (velocity[0], velocity[1], velocity[2])
