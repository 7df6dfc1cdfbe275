"""`FrameReader`: frames from the datagrams of one sender, in whichever protocol they are."""

from __future__ import annotations

import json

from flexmotion.configs.errors import FrameError
from flexmotion.importers.frame import Frame
from flexmotion.streamer.mirror.named_joints import mediapipe, named_joints
from flexmotion.streamer.mirror.vmc import VmcReader

LARGEST = 16384
"""Longest datagram [bytes]; 256 joints as JSON take less."""


class FrameReader:
    """Reads JSON (`{`) and OSC (`/`, `#bundle`)."""

    def __init__(self) -> None:
        self._vmc = VmcReader()

    def take(self, datagram: bytes) -> list[Frame]:
        """The frames that a datagram completes.

        Raises:
            FrameError: it is neither, or too long; the message names the field.
        """
        if len(datagram) > LARGEST:
            raise FrameError(f"{len(datagram)} bytes, expected at most {LARGEST}")
        if datagram[:1] == b"/" or datagram.startswith(b"#bundle"):
            return self._vmc.take(datagram)
        if datagram[:1] != b"{":
            raise FrameError("neither JSON nor OSC")
        try:
            content = json.loads(datagram)
        except (ValueError, RecursionError) as error:
            raise FrameError(f"no JSON: {error}") from error
        if "joints" in content:
            return [named_joints(content)]
        if "landmarks" in content:
            return [mediapipe(content)]
        raise FrameError("expected one of the fields: joints, landmarks")
