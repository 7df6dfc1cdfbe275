"""`ModelSource`: human motion sampled live from a model, window after window, according to a script or targets."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexmotion.configs.errors import ConfigError
from flexmotion.human.concatenate import concatenate
from flexmotion.human.motion import Motion
from flexmotion.sampling.pace import Pace
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.streamer.motion.answers import Heard
from flexmotion.streamer.motion.intents import Intent, Stop, Text, Velocity, word_of
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.targets import Target
from flexmotion.text.prompt_reader import SAME

_KEPT_S = 2.0
"""Motion older than a requested window by this much is dropped [s]; an abandoned plan may have requested later
frames."""


class ModelSource:
    """Samples each window from the motion before it, and keeps it: the same frames are the same whenever requested.

    A new plan gets the frames of the last one, and more after them. Only a target replaces frames, from where it takes
    effect. A sample depends on the frame at which its window begins, on the intent there, on the motion before it and
    on the seed; it does not depend on the clock.

    Args:
        sampler: of the model.
        items: what to do from when on, as of `flexmotion.streamer.motion.script.load_script`, without clips.
        name: for the report.
        seed: of all noise.
        seconds: length [s]; None: until a stop.
        pace: greatest speed of the human, so that a robot keeps up (`streamer/motion/robot_pace.py`); None: no limit.

    Raises:
        ConfigError: the model cannot follow an item.
    """

    def __init__(
        self,
        sampler: Sampler,
        items: Sequence[Item],
        name: str,
        seed: int = 0,
        seconds: float | None = None,
        pace: Pace | None = None,
    ) -> None:
        self.sampler, self.items, self.name, self.seed, self.pace = sampler, tuple(items), name, seed, pace
        self.fps, self.body = sampler.fps, sampler.body
        self._length_s = seconds
        self._end = None if seconds is None else int(np.floor(seconds * self.fps)) + 1
        self._schedule: list[tuple[int, Intent]] = []  # first frames and what to do from there on, ascending
        for item in self.items:
            self._require(item.intent)
            self._schedule.append((round(item.at * self.fps), item.intent))
        # Sampled motion: frames from `_first` on, in the pieces in which they were sampled, so that a piece without
        # forces does not remove those of the others. Before frame 0 the human stands.
        self._pieces = [sampler.standing()]
        self._first = -len(self._sampled)
        self._remarked: str | None = None  # kind of the last message about a target

    @property
    def seconds(self) -> float | None:
        """See `flexmotion.streamer.motion.sources.Performance.seconds`: to its end, or to the script's stop."""
        stops = [item.at for item in self.items if isinstance(item.intent, Stop)]
        return min([*stops, *([] if self._length_s is None else [self._length_s])], default=None)

    def cut(self, seconds: float) -> ModelSource:
        """See `flexmotion.streamer.motion.sources.Performance.cut`."""
        return ModelSource(self.sampler, self.items, self.name, self.seed, seconds, self.pace)

    def human(self) -> Motion:
        """See `flexmotion.streamer.motion.sources.Performance.human`. Raises `ValueError` if there is no end."""
        if self.seconds is None:
            raise ValueError(f"{self.name}: has no end")
        again = self.cut(self.seconds)
        end, step = again._until(sys.maxsize), self.sampler.future
        return concatenate([again._extend(first, min(first + step, end)) for first in range(0, end, step)])

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """See `Source.window`. Raises `LookupError` if the frames were dropped."""
        last = self._until(first_frame + frames)
        if last - first_frame < 2:
            return None
        if first_frame > self._next + self.sampler.future:
            # No window was requested for so long that the robot has stopped; the human has stopped too.
            self._stand_until(first_frame)
        return self._extend(first_frame, last)

    def turn_to(self, target: Target, frame: int, played: Motion | None) -> str | None:
        """See `LiveSource.turn_to`; from `frame` on the script no longer applies."""
        self._require(target.intent)
        if played is None:
            self._stand_until(frame + 1)
        else:
            begin = frame + 1 - len(played)
            before = self._cut(self._first, begin) if self._first < begin <= self._next else []
            self._pieces, self._first = before, begin - sum(len(piece) for piece in before)
            self._append(played)
        self._schedule = [(frame + 1, target.intent)]
        remark, last = self.remark(target.intent), self._remarked
        # A joystick sends ten velocities a second: the message that they are slowed comes once, until another intent.
        kind = "velocity" if isinstance(target.intent, Velocity) else remark
        self._remarked = None if remark is None else kind
        return None if self._remarked == last else remark

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `flexmotion.streamer.motion.sources.Performance.remarks`."""
        found = [self.remark(item.intent) for item in self.items]
        if self.pace is not None and not self.sampler.follows_velocity:
            found.append(
                f"model {self.sampler.name} follows no velocity: its motion is not slowed to the robot's speed"
            )
        return tuple(dict.fromkeys(remark for remark in found if remark is not None))

    def heard(self, intent: Intent) -> Heard:
        """See `LiveSource.heard`."""
        asked = self.condition(intent)
        slowed, meant = self.sampler.meant(asked).velocity, self.sampler.meant(replace(asked, pace=None)).velocity
        unchanged = slowed is None or (meant is not None and np.allclose(slowed, meant))
        if not isinstance(intent, Text):
            return Heard(slowed_to=None if unchanged else slowed)
        prompt = self.sampler.prompt(intent.text)
        if prompt.warning is not None:
            return Heard(prompt.kind, prompt.likeness, refusal=prompt.warning)
        return Heard(prompt.kind, prompt.likeness, None if unchanged else slowed)

    def remark(self, intent: Intent) -> str | None:
        """Message about an intent: the prompt that words are taken for, a slower velocity; None: there is none."""
        asked = self.condition(intent)
        request, found = f"velocity {list(asked.velocity or ())}", []
        if isinstance(intent, Text):
            # A sentence is taken for one kind of motion, which may not be the one that was meant.
            request, prompt = repr(intent.text), self.sampler.prompt(intent.text)
            if prompt.warning is not None:
                return prompt.warning
            if prompt.likeness < SAME and intent.text != prompt.kind:
                found.append(f"heard as {prompt.kind}")
        slowed, meant = self.sampler.meant(asked).velocity, self.sampler.meant(replace(asked, pace=None)).velocity
        if slowed is not None and (meant is None or not np.allclose(slowed, meant)):
            found.append(f"slowed to a human's {_velocity_text(slowed)}, so that the robot can follow")
        return f"{request} is {' and '.join(found)}" if found else None

    @property
    def _sampled(self) -> Motion:
        """All that is kept, as one motion."""
        return concatenate(self._pieces)

    @property
    def _next(self) -> int:
        """First frame that is not sampled yet."""
        return self._first + sum(len(piece) for piece in self._pieces)

    def _until(self, frame: int) -> int:
        """`frame`, or the source's end if that is earlier."""
        stops = [at for at, intent in self._schedule if isinstance(intent, Stop)]
        return min([frame, *stops, *([] if self._end is None else [self._end])])

    def _extend(self, first: int, last: int) -> Motion:
        """Frames from `first` to before `last`; samples those that are not sampled yet."""
        while self._next < last:
            self._sample_window()
        frames = self._frames(first, last)
        self._drop(first - int(_KEPT_S * self.fps))
        return frames

    def _frames(self, first: int, last: int) -> Motion:
        """Frames that are sampled already."""
        if first < self._first:
            raise LookupError(f"{self.name}: frame {first} was dropped, the oldest is {self._first}")
        return concatenate(self._cut(first, last))

    def _cut(self, first: int, last: int) -> list[Motion]:
        """Pieces with the frames from `first` to before `last`."""
        found, begin = [], self._first
        for piece in self._pieces:
            part = slice(max(first - begin, 0), min(last - begin, len(piece)))
            if part.start < part.stop:
                found.append(piece if part.stop - part.start == len(piece) else piece[part])
            begin += len(piece)
        return found

    def _append(self, piece: Motion) -> None:
        """Append a piece, its quaternions with the sign of those before."""
        known = [before[len(before) - 1 :] for before in self._pieces[-1:]]
        quaternions = concatenate([*known, piece]).root_quaternion[len(known) :]
        self._pieces.append(replace(piece, root_quaternion=quaternions))

    def _sample_window(self) -> None:
        """Sample the next window, up to the next change of intent."""
        begin = self._next
        intent = next((intent for at, intent in reversed(self._schedule) if at <= begin), None)
        change = min((at for at, _ in self._schedule if at > begin), default=begin + self.sampler.future)
        # Seeded by frame, noise does not depend on the number of plans; frames before 0 are never sampled.
        history = self._frames(max(begin - self.sampler.remembers, self._first), begin)
        window = self.sampler.sample(history, self.condition(intent), (self.seed << 32) + begin)
        self._append(window[: change - begin])

    def _stand_until(self, before: int) -> None:
        """Replace the motion by standing until frame `before`, at the last position sampled before it."""
        known = self._sampled[: max(before - self._first, 1)]
        self._pieces = [self.sampler.standing(after=known)]
        self._first = before - len(self._sampled)

    def _drop(self, before: int) -> None:
        """Drop frames before that one, except those that the next window is sampled from."""
        first = min(before, self._next - self.sampler.remembers)
        if first > self._first:
            self._pieces, self._first = self._cut(first, self._next), first
            current = max((at for at, _ in self._schedule if at <= self._first), default=self._first)
            self._schedule = [(at, intent) for at, intent in self._schedule if at >= current]

    def _require(self, intent: Intent) -> None:
        """Raise `ConfigError` if the model cannot follow an intent; reads its words now, since that takes time."""
        match intent:
            case Text(text):
                self.sampler.prompt(text)
            case Velocity() if not self.sampler.follows_velocity:
                raise ConfigError(f"velocity: model {self.sampler.name} was trained without, expected: text, stop")
            case Velocity() | Stop():
                return
            case _:
                raise ConfigError(f"target: a model cannot follow {word_of(intent)}, expected: text, velocity, stop")

    def condition(self, intent: Intent | None) -> Condition:
        """Condition of the model for an intent; standing still for None."""
        match intent:
            case Text(text):
                return Condition(text, pace=self.pace)
            case Velocity(forward, left, turning):
                return Condition(velocity=(forward, left, turning), pace=self.pace)
        return Condition()


def _velocity_text(velocity: tuple[float, float, float]) -> str:
    forward, left, turning = velocity
    parts = (
        (forward, "m/s ahead" if forward > 0 else "m/s back"),
        (left, f"m/s to the {_side(left)}"),
        (turning, f"rad/s turning {_side(turning)}"),
    )
    return " and ".join(f"{abs(value):.2g} {what}" for value, what in parts if value)


def _side(value: float) -> str:
    return "left" if value > 0 else "right"
