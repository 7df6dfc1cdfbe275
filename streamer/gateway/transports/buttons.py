"""`Buttons`: which buttons of a gamepad are pressed, also where the kernel has dropped events."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evdev import InputDevice, InputEvent


class Buttons:
    """The buttons of one gamepad. One that is held at the start is not pressed.

    After dropped events (`SYN_DROPPED`) the gamepad is asked which buttons are held (EVIOCGKEY): a press that was among
    them counts, if the button is still held.

    Args:
        device: the gamepad.
    """

    def __init__(self, device: InputDevice) -> None:
        self._device = device
        self._held = set(device.active_keys())
        self._dropped = False

    def pressed(self, event: InputEvent) -> list[int]:
        """The buttons that an event says are newly pressed. Raises `OSError` where the gamepad is gone."""
        from evdev import ecodes

        if event.type == ecodes.EV_KEY:
            if event.value == 0:
                self._held.discard(event.code)
            elif event.value == 1:
                # Among dropped events as well: it has been pressed, whatever else is missing.
                self._held.add(event.code)
                return [event.code]
        elif event.type == ecodes.EV_SYN and event.code == ecodes.SYN_DROPPED:
            self._dropped = True
        elif event.type == ecodes.EV_SYN and event.code == ecodes.SYN_REPORT and self._dropped:
            self._dropped = False
            before, self._held = self._held, set(self._device.active_keys())
            return sorted(self._held - before)
        return []
