"""`ModelSource`: human motion sampled live from a model, window after window, according to a script or targets."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flexmotion.configs.errors import ConfigError
from flexmotion.human.concatenate import concatenate
from flexmotion.human.motion import Motion
from flexmotion.sampling.at_rest import ARMS
from flexmotion.sampling.beside import Beside, columns_of
from flexmotion.sampling.course import MEASURED_S, Course
from flexmotion.sampling.kept_pose import KeptPose
from flexmotion.sampling.pace import Pace
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.streamer.motion.allowed_clips import AllowedClips
from flexmotion.streamer.motion.gesture_beside import GestureBeside
from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.motion.hearing import Hearing
from flexmotion.streamer.motion.intents import (
    Clip,
    Heading,
    Intent,
    Stop,
    Text,
    Velocity,
    Waypoint,
    gesture_of,
    word_of,
)
from flexmotion.streamer.motion.programs import Program
from flexmotion.streamer.motion.remarks import remark_on
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.sequence import turned_to
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.motion.undo import Undo
from flexmotion.text.manners import NORMAL

_REACHED_S = 1.0
"""A pose counts as reached this long after it was asked for [s]: about one window of the model. A hand that is slower
goes on to its pose with less noise as well."""

_IN_POSE, _IN_BRIEF, _BETWEEN = 2, 3, 2
"""Windows in which a pose is asked that is to be done a number of times, one that the model reaches in its own time
("raise your hand"), and those of a stand after it. Left to the model, a hand that was to be raised twice stayed up for
ten seconds."""

OFF_COURSE = np.radians(2.5)
"""A human that stands turns back to its course where it heads further from it than this [rad]."""

_WALKING, _WALKING_S = 0.3, 0.5
"""A human walks whose mean speed over the second [s] is greater than the first [m/s]. Bows and squats on the spot move
the pelvis by less."""

_KEPT_S = 2.0
"""Motion older than a requested window by this much is dropped [s]; an abandoned plan may have requested later
frames."""


class ModelSource:
    """Samples each window from the motion before it, and keeps it: the same frames are the same whenever requested.

    A new plan gets the frames of the last one, and more after them; forces are those of the joined motion, also where
    windows meet. Only a target replaces frames, from where it takes effect. A sample depends on the frame at which its
    window begins, on the intent there, on the motion before it and on the seed; it does not depend on the clock.

    Args:
        sampler: of the model.
        items: what to do from when on, as of `flexmotion.streamer.motion.script.load_script`, without clips.
        name: for the report.
        seed: of all noise.
        seconds: length [s]; None: until a stop.
        pace: greatest speed of the human, so that a robot keeps up (`streamer/motion/robot_pace.py`); None: no limit.
        clips: that targets may name; None: none.
        straight: whether heading, place and turning are kept as they are asked (`flexmotion/sampling/course.py`).

    Attributes:
        clips: names of those that targets may name.
        heard_items: the answers to the items.
        answer: the answer to the last target; None: none yet.

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
        *,
        clips: Mapping[str, Motion] | None = None,
        straight: bool = True,
    ) -> None:
        self.sampler, self.items, self.name, self.seed, self.pace = sampler, tuple(items), name, seed, pace
        self.straight = straight and sampler.follows_velocity
        if self.straight:
            sampler.prepare()
        self.fps, self.body = sampler.fps, sampler.body
        self._length_s = seconds
        self._end = None if seconds is None else int(np.floor(seconds * self.fps)) + 1
        self._clips = AllowedClips(clips or {}, sampler.fps, sampler.body)
        self.clips = tuple(self._clips.clips)
        self._hearing = Hearing(sampler, pace, self._clips.seconds)
        self._schedule: list[tuple[int, Intent]] = []  # first frames and what to do from there on, ascending
        self._programs: list[tuple[int, Program]] = []  # the same of whole programs
        self._numbers = 0
        self._finished: int | None = None  # number of the program that is done
        self._last: Program | None = None  # what "again" repeats
        self.answer: Heard | None = None
        heard: list[Program] = []
        for number, item in enumerate(self.items):
            self._require(item.intent)
            frame = round(item.at * self.fps)
            program = self._heard(item.intent, frame, item=number, at_s=item.at)
            heard.append(program)
            if self._is_refused_change(program):
                continue
            self._programs.append((frame, program))
            # A change of speed acts on the step that is then under way, which is not known yet (`change`).
            step = program.steps[-1 if self._continues() else 0]
            self._schedule.append((frame, step.begins))
        self._item_programs = tuple(heard)
        self.heard_items = tuple(program.heard for program in heard)
        # Sampled motion: frames from `_first` on, in the pieces in which they were sampled, so that a piece without
        # forces does not remove those of the others. Before frame 0 the human stands.
        self._pieces = [sampler.standing()]
        self._first = -len(self._pieces[0])
        self._courses: list[tuple[int, Course]] = []  # first frames of windows, and the course after each
        self._pose: tuple[int, Intent, KeptPose] | None = None  # first frame of words, and the pose that they reached
        self._gesture: GestureBeside | None = None  # made beside what the words ask for
        self._remarked: str | None = None  # kind of the last message about a target

    @property
    def seconds(self) -> float | None:
        """See `flexmotion.streamer.motion.sources.Performance.seconds`: to its end, or to the script's stop."""
        stops = [item.at for item in self.items if isinstance(item.intent, Stop)]
        return min([*stops, *([] if self._length_s is None else [self._length_s])], default=None)

    def cut(self, seconds: float) -> ModelSource:
        """See `flexmotion.streamer.motion.sources.Performance.cut`."""
        how: dict[str, Any] = {"clips": self._clips.clips, "straight": self.straight}
        return ModelSource(self.sampler, self.items, self.name, self.seed, seconds, self.pace, **how)

    @property
    def is_measured(self) -> bool:
        """Whether the robot decides when a step of the script ends, so that its motion is known in the run alone."""
        return not all(program.is_open for program in self._item_programs)

    @property
    def limit_s(self) -> float | None:
        """The longest time that the script's last item takes [s]; None: without an end."""
        return self._item_programs[-1].limit_s

    def human(self) -> Motion:
        """See `flexmotion.streamer.motion.sources.Performance.human`.

        Raises:
            ValueError: there is no end, or the robot's progress decides about it (`is_measured`).
        """
        if self.seconds is None or self.is_measured:
            raise ValueError(f"{self.name}: has no end, or one that the robot decides about")
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

    def turn_to(self, target: Target, frame: int, played: Motion | None, yaw: float | None = None) -> str | None:
        """See `LiveSource.turn_to`; from `frame` on the script no longer applies."""
        self._require(target.intent)
        current, held = self.program_at(frame), self._holds(frame) or self._poses(frame)
        program = self._heard(target.intent, frame + 1, id=target.id)
        if self._is_refused_change(program):
            raise ConfigError(str(program.heard.reason))
        self._replace_after(frame, played, yaw)
        intent: Intent | None = program.steps[0].begins
        if current is not None and current[1].number == program.number:
            # The speed changes, or nothing: the step goes on where it is.
            following = self._intent_at(frame)
            place = next((i for i, step in enumerate(current[1].steps) if step.intent == following), None)
            intent = following if place is None else program.steps[place].intent
            self._programs = [(current[0], program)]
        else:
            self._programs = [(frame + 1, program)]
        begun, first = self._begun(frame), frame + 1
        if played is not None and begun is not None and begun[1] == intent and held:
            first = begun[0]  # words that are said again: a pose that is held, or under way, is not reached anew
        self._schedule = [] if intent is None else [(first, intent)]
        if isinstance(intent, Clip):
            self._clips.begin(intent, frame + 1, self._frames(frame, frame + 1))
        self.answer = program.heard
        remark, last = remark_on(self.sampler, target.intent, program), self._remarked
        # A joystick sends ten velocities a second: the message that they are slowed comes once, until another intent.
        kind = "velocity" if isinstance(target.intent, Velocity) else remark
        self._remarked = None if remark is None else kind
        return None if self._remarked == last else remark

    def kept(self) -> Undo:
        """See `LiveSource.kept`."""
        return Undo(self, self._clips)

    def program_at(self, frame: int) -> tuple[int, Program] | None:
        """The program that is followed at a frame, and its first frame; None before the first."""
        return next((one for one in reversed(self._programs) if one[0] <= frame), None)

    def change(self, intent: Intent, frame: int, played: Motion | None, yaw: float | None = None) -> None:
        """Follow another intent of the program from `frame` on; what the script has later stays.

        After a rest of the robot the human stands anew, with arms or neck as in the gesture beside the last intent: the
        robot has held its own. The gesture goes on from there where it is beside this intent too.

        Args:
            intent, frame, played, yaw: see `turn_to`.
        """
        before = gesture_of(self._intent_at(frame))
        self._replace_after(frame, played, yaw)
        if played is None and self._gesture is not None and self._gesture.intent == before:
            self._gesture = self._gesture.after_rest(frame + 1)
            self._pieces = [self._gesture.held(concatenate(self._pieces), frame + 1)]
        later = [one for one in self._schedule if one[0] > frame + 1]
        self._schedule = [(frame + 1, intent), *later]

    def steer(self, intent: Intent) -> None:
        """Follow another intent of the program from the first frame on that is not sampled yet: no motion is cut."""
        before = [one for one in self._schedule if one[0] < self._next]
        self._schedule = [*before, (self._next, intent), *(one for one in self._schedule if one[0] > self._next)]

    def sampled(self, first: int) -> Motion | None:
        """The frames from `first` on that are sampled already; None: there are none, or some of them were dropped."""
        return concatenate(self._cut(first, self._next)) if self._first <= first < self._next else None

    def drawn(self, first: int, last: int) -> Motion:
        """Frames from `first` to before `last`; the forces of the last ones change with the window after them."""
        while self._next < last:
            self._sample_window()
        return self._frames(first, last)

    def forget(self, before: int) -> None:
        """Drop frames before that one, except those that the next window is sampled from."""
        first = min(before, self._next - self.sampler.remembers)
        if first > self._first:
            self._pieces, self._first = self._cut(first, self._next), first
            current = max((at for at, _ in self._schedule if at <= self._first), default=self._first)
            self._schedule = [(at, intent) for at, intent in self._schedule if at >= current]
            if self._gesture is not None:
                self._gesture.forget(first)
            self._courses = [
                *[one for one in self._courses if one[0] < first][-1:],
                *[one for one in self._courses if one[0] >= first],
            ]

    def finish(self, frame: int) -> None:
        """The program at a frame is done; where the source has an end and nothing follows, it ends with that frame.

        That of a target ends nothing: another target may come until the end.
        """
        current = self.program_at(frame)
        self._finished = None if current is None else current[1].number
        asked = current is not None and current[1].heard.id > 0
        if self._end is not None and not asked and not any(at > frame for at, _ in self._programs):
            self._end = min(self._end, frame + 1)

    def stopped(self, program: Program) -> None:
        """The robot was stopped: a program is under way no more, so that its speed cannot change."""
        self._finished = program.number

    def is_over(self, frame: int) -> bool:
        """Whether the source has nothing from a frame on."""
        return self._until(frame + 1) <= frame

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `flexmotion.streamer.motion.sources.Performance.remarks`."""
        found = [
            remark_on(self.sampler, item.intent, program)
            for item, program in zip(self.items, self._item_programs, strict=True)
        ]
        if self.pace is not None and not self.sampler.follows_velocity:
            found.append(
                f"model {self.sampler.name} follows no velocity: its motion is not slowed to the robot's speed"
            )
        return tuple(dict.fromkeys(remark for remark in found if remark is not None))

    def _heard(self, intent: Intent, frame: int, **about: Any) -> Program:
        """The program of an intent that is followed from a frame on; `about`: fields of its answer."""
        current = self.program_at(frame - 1)
        over = current is None or current[1].number == self._finished or current[1].steps[0].is_still
        under_way = None if current is None or over else current[1]
        program = self._hearing(intent, under_way, self._last)
        program = replace(program, heard=program.heard.model_copy(update=about))
        if program.number == 0:
            self._numbers += 1
            program = replace(program, number=self._numbers)
            if program.heard.state != "refused" and not isinstance(intent, Stop) and not program.steps[0].is_still:
                self._last = program
        return program

    def _is_refused_change(self, program: Program) -> bool:
        """Whether a program is one that goes on as before, since its speed cannot change: an answer, and no more."""
        return program.heard.state == "refused" and program.number in {one.number for _, one in self._programs}

    def _continues(self) -> bool:
        """Whether the newest program of the script is the one before it, at another speed."""
        return len({program.number for _, program in self._programs[-2:]}) < len(self._programs[-2:])

    def _intent_at(self, frame: int) -> Intent | None:
        begun = self._begun(frame)
        return None if begun is None else begun[1]

    def _begun(self, frame: int) -> tuple[int, Intent] | None:
        """The intent that is followed at a frame, and its first frame."""
        return next((one for one in reversed(self._schedule) if one[0] <= frame), None)

    def _replace_after(self, frame: int, played: Motion | None, yaw: float | None) -> None:
        """Forget what was sampled after a frame, and take the motion up to it as it was played (see `turn_to`)."""
        if played is None:
            self._stand_until(frame + 1)
            if yaw is not None:
                self._pieces = [turned_to(piece, yaw) for piece in self._pieces]
            return
        begin = frame + 1 - len(played)
        before = self._cut(self._first, begin) if self._first < begin <= self._next else []
        self._pieces, self._first = before, begin - sum(len(piece) for piece in before)
        self._append(played)

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
        while self._next < last + self.sampler.unsettled:
            self._sample_window()
        frames = self._frames(first, last)
        self.forget(first - int(_KEPT_S * self.fps))
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
        intent = self._intent_at(begin)
        change = min((at for at, _ in self._schedule if at > begin), default=begin + self.sampler.future)
        clip = self._clips.window(begin, change - begin) if isinstance(intent, Clip) else None
        if clip is not None:
            return self._append(clip)
        # Seeded by frame, noise does not depend on the number of plans; frames before 0 are never sampled.
        history = self._frames(max(begin - self.sampler.remembers, self._first), begin)
        asked, seed = self._kept_straight(begin, intent), (self.seed << 32) + begin
        asked = replace(asked, beside=self._beside(begin, intent))
        if self._holds(begin):
            asked = self.sampler.requests.held(asked)
        found = self.sampler.extend(history, self._in_pose(begin, asked), seed)
        if self._reaches(begin, asked, found.window):
            # People leave the pose in the window in which they reach it.
            found = self.sampler.extend(history, self._in_pose(begin, asked), seed)
        self._pieces = [*self._cut(self._first, begin - len(found.before)), found.before]
        self._append(found.window[: change - begin])

    def _in_pose(self, frame: int, asked: Condition) -> Condition:
        """The condition of a window that begins at a frame, in the pose that its words have reached, if one is kept."""
        begun, pose = self._begun(frame), self._pose
        if begun is None or self._is_between(frame):
            return asked
        rhythm = self.sampler.rhythm(self.condition(begun[1]), size=begun[0] + self.seed)
        if rhythm is not None:
            return replace(asked, pose=rhythm.later(frame - begun[0]))
        begin = begun[0] + self._repetition(frame) * sum(self._turn(begun[1])) * self.sampler.future
        if pose is None or pose[:2] != (begin, begun[1]):
            before = self._frames(max(begin - 1, self._first), frame)[:1]
            made = self.sampler.made_pose(asked, before, begun[0] + self.seed)
            if made is None:
                return asked
            pose = self._pose = begin, begun[1], made
        return replace(asked, pose=pose[2].later(frame - begin))

    def _repetition(self, frame: int) -> int:
        """How often a pose that is asked for a number of times was done before the window at a frame."""
        begun = self._begun(frame)
        if begun is None or self._is_endless(frame):
            return 0
        return (frame - begun[0]) // self.sampler.future // sum(self._turn(begun[1]))

    def _is_between(self, frame: int) -> bool:
        """Whether the window at a frame is between two repetitions of a pose that is asked for a number of times."""
        begun = self._begun(frame)
        if begun is None or self._is_endless(frame):
            return False
        if self.sampler.requests.pose(self.sampler.meant(self.condition(begun[1]))) is None:
            return False
        pose, between = self._turn(begun[1])
        return (frame - begun[0]) // self.sampler.future % (pose + between) >= pose

    def _turn(self, intent: Intent) -> tuple[int, int]:
        """Windows in a pose that is asked for a number of times, and between two of them."""
        brief = self.sampler.requests.is_brief(self.sampler.meant(self.condition(intent)))
        return _IN_BRIEF if brief else _IN_POSE, _BETWEEN

    def _beside(self, frame: int, intent: Intent | None) -> Beside | None:
        """What the window that begins at a frame shows of the gesture that is made meanwhile; None: there is none."""
        gesture = gesture_of(intent)
        if gesture is None:
            return None
        if self._gesture is None or not self._gesture.goes_on(gesture, frame):
            human = ModelSource(self.sampler, (), gesture.text, self.seed + frame, straight=False)
            human.steer(gesture)
            self._gesture = GestureBeside(gesture, frame, self.sampler.prompt(gesture.text).kind, human)
        return self._gesture.window(frame, self.sampler.future)

    def _reaches(self, frame: int, asked: Condition, window: Motion) -> bool:
        """Whether a window that begins at a frame reaches the pose of its words, which people would leave at once."""
        begun = self._begun(frame)
        if begun is None or not self.sampler.requests.is_brief(asked) or not self._is_endless(frame):
            return False
        known = self._pose is not None and self._pose[:2] == begun
        if known and self._pose is not None and begun[0] + self._pose[2].frame <= frame:
            return False
        first = max(begun[0], self._first)  # frames before it were dropped
        columns = columns_of(self.sampler.requests.pose(asked) or "") or ARMS
        pose = KeptPose.reached(concatenate([*self._cut(first, frame), window]), columns)
        self._pose = None if pose is None else (*begun, pose.later(begun[0] - first))
        return pose is not None

    def _is_endless(self, frame: int) -> bool:
        """Whether the words at a frame are not to be done a number of times."""
        begun, current = self._begun(frame), self.program_at(frame)
        steps = () if current is None or begun is None else current[1].steps
        same = [step for step in steps if begun is not None and step.intent == begun[1]]
        # "Salute once and then salute for ten seconds": the same words, of which one step is under way.
        own = [step.amount for step in same if begun is not None and step.intent is begun[1]]
        amounts = own or [step.amount for step in same]
        return all(amount is None or amount.quantity == "time" for amount in amounts)

    def _poses(self, frame: int) -> bool:
        """Whether the words at a frame ask for a pose that is made."""
        begun = self._begun(frame)
        return begun is not None and self._pose is not None and self._pose[:2] == begun and self._pose[2].frame < 0

    def _holds(self, frame: int) -> bool:
        """Whether the words at a frame have been followed for long enough, and are not to be done a number of times."""
        begun = self._begun(frame)
        if begun is None or not isinstance(begun[1], Text) or frame - begun[0] < _REACHED_S * self.fps:
            return False
        return self._is_endless(frame)

    def _kept_straight(self, begin: int, intent: Intent | None) -> Condition:
        """Condition of the window that begins at a frame, so that the motion keeps its heading and place."""
        condition = self.sampler.meant(self.condition(intent))
        if self._walks_on(begin, condition) or self._is_between(begin):
            condition = self.sampler.meant(Condition())
        if not self.straight:
            return condition
        # What was sampled after a cut is forgotten, and so is what it was asked for.
        self._courses = [(at, course) for at, course in self._courses if at < begin]
        past = self._frames(max(begin - round(MEASURED_S * self.fps), self._first), begin)
        last, course = self._courses[-1] if self._courses else (begin, Course())
        sampler, played = self.sampler, begin - last
        if played > sampler.future:  # a clip was played meanwhile, and led elsewhere
            course = Course()
        own, noise = sampler.requests.own_velocity(condition), sampler.requests.travelling_noise
        course, asked = course.followed(condition, own, past, sampler.free, noise, played)
        # A body that stands keeps the heading at which it came to rest, and is asked for nothing. Asked to turn its
        # pelvis back by some degrees over feet that stay, bodies that were to nod trembled for a window.
        turn = 0.0 if asked.constraints is None else asked.constraints.turn
        still = abs(turn + course.settled) < OFF_COURSE and sampler.rests(condition, past)
        self._courses.append((begin, replace(course, stood=still)))
        return condition if still else asked

    def _walks_on(self, begin: int, condition: Condition) -> bool:
        """Whether the human still walks a window after it was asked for something on the spot (a condition of `meant`).

        Most gestures stop a walk by themselves. People of the data often walk before they bow, so that a human that
        walks and is asked to bow never stops. It is to stand first.
        """
        requests, begun = self.sampler.requests, self._begun(begin)
        if begun is None or begin - begun[0] < _REACHED_S * self.fps or requests.travels(condition):
            return False
        past = self._frames(max(begin - round(_WALKING_S * self.fps), self._first), begin)
        return past.net_speed > _WALKING

    def _stand_until(self, before: int) -> None:
        """Replace the motion by standing until frame `before`, at the last position sampled before it."""
        known = concatenate(self._pieces)[: max(before - self._first, 1)]
        self._pieces = [self.sampler.standing(after=known)]
        self._first = before - len(self._pieces[0])
        self._courses = []

    def _require(self, intent: Intent) -> None:
        """Raise `ConfigError` if the model cannot follow an intent; reads its words now, since that takes time."""
        match intent:
            case Text(beside=Text(text)) | Velocity(beside=Text(text)):
                raise ConfigError(f"{word_of(intent)}: beside {text!r}: say both in words, as in 'walk while waving'")
            case Text(text):
                self.sampler.prompt(text)
            case Velocity() | Heading() | Waypoint() if not self.sampler.follows_velocity:
                raise ConfigError(
                    f"{word_of(intent)}: model {self.sampler.name} follows no velocity, expected: text, stop"
                )
            case Velocity(manner=str(manner)) if manner not in (NORMAL, *self.sampler.requests.manners):
                offered = ", ".join(dict.fromkeys((NORMAL, *self.sampler.requests.manners)))
                raise ConfigError(f"velocity: manner {manner!r}, model {self.sampler.name} offers: {offered}")
            case Clip():
                self._clips.require(intent)

    def condition(self, intent: Intent | None) -> Condition:
        """Condition of the model for an intent; standing still for None."""
        match intent:
            case Text(text, tempo):
                return Condition(text, pace=self.pace, tempo=tempo)
            case Velocity(forward, left, turning, manner, paced):
                return Condition(velocity=(forward, left, turning), manner=manner, pace=self.pace if paced else None)
        return Condition()
