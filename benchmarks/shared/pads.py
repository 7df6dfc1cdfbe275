"""`EmulatedPad`: a gamepad that any process can read, on machines without one and without `/dev/uinput`.

It sends the events of Linux (`struct input_event`) over a socket, and evdev's own code reads them.
"""

from __future__ import annotations

import errno
import math
import os
import re
import socket
import struct
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from evdev import AbsInfo, InputDevice, InputEvent, ecodes

_EVENT = struct.Struct("llHHi")
_LINE = re.compile(r"^E: (?P<time>\d+\.\d+) (?P<type>[0-9a-f]{4}) (?P<code>[0-9a-f]{4}) (?P<value>-?\d+)")
_AXIS = re.compile(r"^A: (?P<code>[0-9a-f]+) (?P<low>-?\d+) (?P<high>-?\d+)")
AXES = {ecodes.ABS_X: (-32768, 32767), ecodes.ABS_Y: (-32768, 32767), ecodes.ABS_RX: (-32768, 32767)}
"""Ranges of the sticks of an Xbox pad."""


class EmulatedPad:
    """A gamepad with readers in any process of this machine.

    Attributes:
        pressed, axes: buttons that are held, and values of the axes: what a reader that opens it is told.
        looked: readers of this process that have asked for that; what is moved before counts as held from the start.
    """

    def __init__(self, axes: dict[int, tuple[int, int]] | None = None) -> None:
        self.ranges = AXES if axes is None else axes
        self.axes = {axis: (low + high + 1) // 2 for axis, (low, high) in self.ranges.items()}
        self.pressed: set[int] = set()
        self.looked: set[int] = set()
        self.folder = tempfile.TemporaryDirectory()
        self.path = os.path.join(self.folder.name, "pad")
        self._readers: list[socket.socket] = []
        self._listening: socket.socket | None = None
        self.plug_in()

    def plug_in(self) -> None:
        """Readers find it from now on."""
        self._listening = listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        listening.bind(self.path)
        listening.listen()
        threading.Thread(target=self._accept, args=(listening,), daemon=True).start()

    def pull_out(self) -> None:
        """Its readers lose it, as when its cable is pulled."""
        assert self._listening is not None
        self._listening.close()
        os.unlink(self.path)
        for reader in self._readers:
            reader.close()
        self._readers.clear()
        self.looked.clear()

    def close(self) -> None:
        """Pull it out for ever."""
        if os.path.exists(self.path):
            self.pull_out()
        self.folder.cleanup()

    @property
    def readers(self) -> int:
        """How many read it."""
        return len(self._readers)

    @property
    def ready(self) -> int:
        """How many of this process are told all events, and have asked for its state."""
        return min(len(self._readers), len(self.looked))

    def send(self, kind: int, code: int, value: int) -> None:
        """Send an event."""
        if kind == ecodes.EV_ABS:
            self.axes[code] = value
        elif kind == ecodes.EV_KEY:
            (self.pressed.add if value else self.pressed.discard)(code)
        for reader in list(self._readers):
            try:
                reader.sendall(_EVENT.pack(0, 0, kind, code, value))
            except OSError:
                self._readers.remove(reader)  # it has ended

    def press(self, button: int) -> None:
        """Press a button and let it go."""
        for value in (1, 0):
            self.send(ecodes.EV_KEY, button, value)
            self.send(ecodes.EV_SYN, ecodes.SYN_REPORT, 0)

    def play(self, recording: Path, begin_s: float = 0.0, end_s: float = math.inf) -> None:
        """Send the events of a recording of `evemu-record` from a time to another, without its pauses."""
        for line in recording.read_text(encoding="utf-8").splitlines():
            if (found := _LINE.match(line)) and begin_s <= float(found["time"]) < end_s:
                self.send(int(found["type"], 16), int(found["code"], 16), int(found["value"]))

    def find(self, known: set[str]) -> list[InputDevice]:
        """See `flexmotion.streamer.gateway.transports.pads.Find`."""
        if self.path in known or not os.path.exists(self.path):
            return []
        return [_Reader(self)]

    def _accept(self, listening: socket.socket) -> None:
        while True:
            try:
                self._readers.append(listening.accept()[0])
            except OSError:
                return


def recorded_ranges(recording: Path) -> dict[int, tuple[int, int]]:
    """The ranges of the axes in the head of a recording of `evemu-record`."""
    found = map(_AXIS.match, recording.read_text(encoding="utf-8").splitlines())
    return {int(one["code"], 16): (int(one["low"]), int(one["high"])) for one in found if one}


class _Reader(InputDevice):
    """What `InputDevice` is for a device file."""

    def __init__(self, pad: EmulatedPad) -> None:
        self._pad, self.path, self.name = pad, pad.path, "Emulated pad"
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        connection.connect(pad.path)
        self.fd = connection.detach()

    def read(self) -> Iterator[InputEvent]:
        events = list(super().read())
        if not events:
            raise OSError(errno.ENODEV, "no such device")
        return iter(events)

    def absinfo(self, axis_num: int) -> AbsInfo:
        low, high = self._pad.ranges[axis_num]
        return AbsInfo(self._pad.axes[axis_num], low, high, 0, 0, 0)

    def active_keys(self, verbose: bool = False) -> list[int]:
        self._pad.looked.add(self.fd)
        return sorted(self._pad.pressed)

    def capabilities(self, verbose: bool = False, absinfo: bool = True) -> dict[Any, Any]:
        return {ecodes.EV_ABS: list(self._pad.ranges)}


def wait_for_readers(pad: EmulatedPad, number: int, patience_s: float = 60.0) -> None:
    """Wait until so many processes read a gamepad. Raises `TimeoutError`."""
    end = time.monotonic() + patience_s
    while pad.readers < number:
        if time.monotonic() > end:
            raise TimeoutError(f"{pad.readers} of {number} processes read the gamepad after {patience_s:g} s")
        time.sleep(0.01)
