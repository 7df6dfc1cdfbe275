"""`Intake`: from datagrams to poses of the person; without sockets and clocks of its own."""

from __future__ import annotations

from collections.abc import Callable

from flexmotion.configs.errors import FlexMotionError, FrameError
from flexmotion.importers.live_person import REASONS, LivePerson
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.mirror.frame_reader import FrameReader
from flexmotion.streamer.mirror.sender_clock import SenderClock
from flexmotion.streamer.mirror.senders import Address, Senders
from flexmotion.streamer.motion.person_channel import FPS, PersonChannel, PersonPose


class Intake:
    """Takes datagrams and publishes poses.

    Args:
        admission: address and token.
        channel: for the poses.
        mapping: of the skeleton, a shipped name or a file; None: found by the names of the joints.
        on_note: called with a message for the operator: once for each change.

    Attributes:
        senders: who is read; counts those who are not.
        person: counts frames that were not used.
        unreadable: datagrams that are no frames.
    """

    def __init__(
        self,
        admission: Admission,
        channel: PersonChannel,
        mapping: str | None = None,
        on_note: Callable[[str], None] = lambda _message: None,
    ) -> None:
        self.senders, self.person = Senders(admission), LivePerson(FPS, mapping)
        self.unreadable = 0
        self._channel, self._on_note = channel, on_note
        self._reader, self._clock = FrameReader(), SenderClock()
        self._told: set[str] = set()
        self._told_height = False

    def take(self, datagram: bytes, address: Address, now_s: float) -> None:
        """Take a datagram.

        Args:
            address: of its sender.
            now_s: when it arrived, on the clock of the poses [s].
        """
        if not self.senders.admits(datagram, address, now_s):
            if self.senders.refused["second sender"]:
                self._tell("mirror: a second sender is not read until the first is silent")
            return
        try:
            frames = self._reader.take(datagram)
        except FrameError as error:
            self.unreadable += 1
            self._tell(f"mirror: a datagram from {address[0]} is no frame: {error}")
            return
        except Exception as error:  # of a library that reads them: no datagram ends the process
            self.unreadable += 1
            self._tell(f"mirror: a datagram from {address[0]} cannot be read: {type(error).__name__}: {error}")
            return
        for frame in frames:
            if self.senders.heard(address, now_s):
                self._clock = SenderClock()
                self._on_note(f"mirror: frames ({frame.skeleton.protocol}) from {address[0]} port {address[1]}")
            time_s = self._clock.local(frame.time_s, now_s)
            try:
                poses = self.person.take(frame, time_s)
            except (FlexMotionError, ArithmeticError, ValueError) as error:
                # One frame that cannot be fitted is left out as those that are refused.
                self.person.refused["no human"] += 1
                self._tell(f"mirror: a frame cannot be used: {error}")
                continue
            for pose in poses:
                self._channel.publish(PersonPose(pose.stream, pose.time_s, now_s, pose.motion))
            if not poses:
                self._tell_left_out()
            self._tell_state(poses[-1].motion.body.height if poses else None)

    def _tell_left_out(self) -> None:
        """Say of each reason, once, that frames are left out for it; a network delays some, which is nothing new."""
        for reason, meaning in REASONS.items():
            if self.person.refused[reason] and reason not in ("late", "too fast"):
                self._tell(f"mirror: frames are left out ({reason}): {meaning}")

    def _tell_state(self, height: float | None) -> None:
        if self.person.trouble is not None:
            self._tell(f"mirror: {self.person.trouble}")
        if height is not None and not self._told_height:
            without = f", without what is not seen yet: {', '.join(self.person.unseen)}" if self.person.unseen else ""
            self._on_note(f"mirror: a person of {height:.2f} m is measured{without}")
        # The frame that ends the measurement brings no pose yet; another person is told anew.
        self._told_height = self.person.measured and (self._told_height or height is not None)

    def _tell(self, message: str) -> None:
        """Tell a message once; of endless kinds of nonsense the first few."""
        if message not in self._told and len(self._told) < 16:
            self._told.add(message)
            self._on_note(message)
