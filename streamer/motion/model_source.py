"""`ModelSource`: human motion sampled live from a model, window after window, as a script or targets ask for it."""

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
from flexmotion.streamer.motion.intents import Intent, Stop, Text, Velocity, word_of
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.targets import Target
from flexmotion.text.prompt_reader import SAME

_KEPT_S = 2.0
"""Motion this much older than what is asked for is forgotten: a plan that was given up may have looked further [s]."""


class ModelSource:
    """Samples each window from its own motion as history, and keeps it: what was said once is said again.

    A new plan sees the frames that the last one saw, and more at their end; only a target draws anew, from where it
    arrives. What is sampled depends on the frame at which a window begins, on what is asked for there, on what was
    before and on the seed: never on the clock.

    Args:
        sampler: of the model.
        items: what to do from when on, as of `flexmotion.streamer.motion.script.load_script`, without clips.
        name: what the report calls it.
        seed: of all noise.
        seconds: how long it lasts [s]; None: until a stop.
        pace: how fast the human goes at most, so that a robot keeps up (`streamer/motion/robot_pace.py`); None for as
            fast as it likes.

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
        self._asked: list[tuple[int, Intent]] = []
        for item in self.items:
            self._require(item.intent)
            self._asked.append((round(item.at * self.fps), item.intent))
        # What is spoken: frames from `_first` on, in pieces as they came, so that one that lacks forces does not take
        # those of the others; before frame 0 it stands.
        self._pieces = [sampler.standing()]
        self._first = -len(self._spoken)
        self._remarked: str | None = None  # what was last told of a target

    @property
    def seconds(self) -> float | None:
        """See `flexmotion.streamer.motion.sources.Performance.seconds`: to its end, or to the script's stop."""
        stops = [item.at for item in self.items if isinstance(item.intent, Stop)]
        return min([*stops, *([] if self._length_s is None else [self._length_s])], default=None)

    def cut(self, seconds: float) -> ModelSource:
        """See `flexmotion.streamer.motion.sources.Performance.cut`."""
        return ModelSource(self.sampler, self.items, self.name, self.seed, seconds, self.pace)

    def human(self) -> Motion:
        """See `flexmotion.streamer.motion.sources.Performance.human`. Raises `ValueError` where there is no end."""
        if self.seconds is None:
            raise ValueError(f"{self.name}: has no end")
        again = self.cut(self.seconds)
        end, step = again._until(sys.maxsize), self.sampler.future
        return concatenate([again._say(first, min(first + step, end)) for first in range(0, end, step)])

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """See `Source.window`. Raises `LookupError` where the frames are forgotten."""
        last = self._until(first_frame + frames)
        if last - first_frame < 2:
            return None
        if first_frame > self._next + self.sampler.future:
            # Nobody has asked for so long that the robot has come to a stop, and so has the human.
            self._rest(first_frame)
        return self._say(first_frame, last)

    def turn_to(self, target: Target, frame: int, played: Motion | None) -> str | None:
        """See `LiveSource.turn_to`; nothing remains of the script from `frame` on."""
        self._require(target.intent)
        if played is None:
            self._rest(frame + 1)
        else:
            begin = frame + 1 - len(played)
            before = self._cut(self._first, begin) if self._first < begin <= self._next else []
            self._pieces, self._first = before, begin - sum(len(piece) for piece in before)
            self._append(played)
        self._asked = [(frame + 1, target.intent)]
        remark, told = self.remark(target.intent), self._remarked
        # A stick sends ten velocities a second: that they are slowed is told once, until something else is asked for.
        kind = "velocity" if isinstance(target.intent, Velocity) else remark
        self._remarked = None if remark is None else kind
        return None if self._remarked == told else remark

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `flexmotion.streamer.motion.sources.Performance.remarks`."""
        found = [self.remark(item.intent) for item in self.items]
        if self.pace is not None and not self.sampler.follows_velocity:
            found.append(f"model {self.sampler.name} follows no velocity: its human does not wait for the robot")
        return tuple(dict.fromkeys(remark for remark in found if remark is not None))

    def remark(self, intent: Intent) -> str | None:
        """What is to be told of an intent: as what words are heard, how much slower it is followed; None: nothing."""
        asked = self.condition(intent)
        said, found = f"velocity {list(asked.velocity or ())}", []
        if isinstance(intent, Text):
            # A sentence is heard as one kind of motion, which need not be the one that was meant.
            said, prompt = repr(intent.text), self.sampler.prompt(intent.text)
            if prompt.warning is not None:
                return prompt.warning
            if prompt.likeness < SAME and intent.text != prompt.kind:
                found.append(f"heard as {prompt.kind}")
        slowed, meant = self.sampler.meant(asked).velocity, self.sampler.meant(replace(asked, pace=None)).velocity
        if slowed is not None and (meant is None or not np.allclose(slowed, meant)):
            found.append(f"slowed to a human's {_told(slowed)}, so that the robot can follow")
        return f"{said} is {' and '.join(found)}" if found else None

    @property
    def _spoken(self) -> Motion:
        """All that is kept, in one."""
        return concatenate(self._pieces)

    @property
    def _next(self) -> int:
        """The first frame that is not spoken yet."""
        return self._first + sum(len(piece) for piece in self._pieces)

    def _until(self, frame: int) -> int:
        """`frame`, or where it is over before."""
        stops = [at for at, intent in self._asked if isinstance(intent, Stop)]
        return min([frame, *stops, *([] if self._end is None else [self._end])])

    def _say(self, first: int, last: int) -> Motion:
        """Frames from `first` to before `last`, sampled as far as they are not yet."""
        while self._next < last:
            self._speak()
        frames = self._frames(first, last)
        self._forget(first - int(_KEPT_S * self.fps))
        return frames

    def _frames(self, first: int, last: int) -> Motion:
        """What is spoken already."""
        if first < self._first:
            raise LookupError(f"{self.name}: frame {first} is forgotten, the oldest is {self._first}")
        return concatenate(self._cut(first, last))

    def _cut(self, first: int, last: int) -> list[Motion]:
        """The pieces of what is kept from `first` to before `last`."""
        found, begin = [], self._first
        for piece in self._pieces:
            part = slice(max(first - begin, 0), min(last - begin, len(piece)))
            if part.start < part.stop:
                found.append(piece if part.stop - part.start == len(piece) else piece[part])
            begin += len(piece)
        return found

    def _append(self, piece: Motion) -> None:
        """Keep a piece after the others, its quaternions in the sign of theirs."""
        known = [before[len(before) - 1 :] for before in self._pieces[-1:]]
        quaternions = concatenate([*known, piece]).root_quaternion[len(known) :]
        self._pieces.append(replace(piece, root_quaternion=quaternions))

    def _speak(self) -> None:
        """Sample on, up to where something else is asked for."""
        begin = self._next
        intent = next((intent for at, intent in reversed(self._asked) if at <= begin), None)
        change = min((at for at, _ in self._asked if at > begin), default=begin + self.sampler.future)
        # Numbered by frame, noise is the same however often plans are drawn; frames before 0 are never sampled.
        history = self._frames(max(begin - self.sampler.remembers, self._first), begin)
        window = self.sampler.sample(history, self.condition(intent), (self.seed << 32) + begin)
        self._append(window[: change - begin])

    def _rest(self, before: int) -> None:
        """From the place of the last frame spoken before `before`, stand until then."""
        known = self._spoken[: max(before - self._first, 1)]
        self._pieces = [self.sampler.standing(after=known)]
        self._first = before - len(self._spoken)

    def _forget(self, before: int) -> None:
        """Drop frames before that one, but none that the next window is sampled from."""
        first = min(before, self._next - self.sampler.remembers)
        if first > self._first:
            self._pieces, self._first = self._cut(first, self._next), first
            current = max((at for at, _ in self._asked if at <= self._first), default=self._first)
            self._asked = [(at, intent) for at, intent in self._asked if at >= current]

    def _require(self, intent: Intent) -> None:
        """What the model cannot follow is refused; words are read now, which takes time and warns."""
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
        """What the model is asked for where `intent` is; standing still for None."""
        match intent:
            case Text(text):
                return Condition(text, pace=self.pace)
            case Velocity(forward, left, turning):
                return Condition(velocity=(forward, left, turning), pace=self.pace)
        return Condition()


def _told(velocity: tuple[float, float, float]) -> str:
    forward, left, turning = velocity
    parts = (
        (forward, "m/s ahead" if forward > 0 else "m/s back"),
        (left, f"m/s to the {_side(left)}"),
        (turning, f"rad/s turning {_side(turning)}"),
    )
    return " and ".join(f"{abs(value):.2g} {what}" for value, what in parts if value)


def _side(value: float) -> str:
    return "left" if value > 0 else "right"
