"""`Intent`: what the human, and with it the robot, is to do; scripts, targets and logs share these words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.motion.intent_values import require_numbers, require_words
from flexmotion.streamer.motion.part_intents import PARTS, PartIntent, part_from_content
from flexmotion.streamer.motion.part_values import Logged

FASTEST = (3.0, 1.5, 3.0)
"""Greatest velocity that may be requested, in either direction: a run forward, a quick sidestep, half a turn a second
[m/s, m/s, rad/s]."""

LONGEST_TEXT = 240
"""In characters."""

FARTHEST_M = 1000.0
"""Bound of each coordinate of a place in the odometry [m]."""
WIDEST_RAD = math.tau
"""Bound of a heading [rad]: one in degrees is refused, not turned to."""
CLOSEST_M, LOOSEST_M = 0.03, 1.0
"""Bounds of a waypoint's tolerance [m]: a humanoid's step corrects no less."""
SLOWEST_TURN = 0.05
"""Least bound on the turning speed [rad/s]."""

_EXPECTED_HEADING = "heading: expected [heading rad] or [heading rad, fastest turning rad/s]"
_EXPECTED_WAYPOINT = "waypoint: expected [x m, y m], [x, y, heading rad or null] or [x, y, heading, tolerance m]"
_EXPECTED_VELOCITY = "velocity: expected [forward m/s, left m/s, turning rad/s]"


@dataclass(frozen=True)
class Clip:
    """Follow a clip: its name in a library, or its file in a script. Raises `ConfigError` without a name."""

    name: str

    def __post_init__(self) -> None:
        require_words("clip", self.name, "a file or a name")


@dataclass(frozen=True)
class Text:
    """Do what the words say, in one line. Raises `ConfigError` without words, and where they are not one line.

    Attributes:
        text: the words.
        tempo: factor on the speed of repeated strokes that they mean; other motions have the speed of their words.
        beside: gesture that arms or head make meanwhile; None: there is none. A sentence says it ("walk while waving"),
            and a target with one is refused.
    """

    text: str
    tempo: float = 1.0
    beside: Text | None = None

    def __post_init__(self) -> None:
        require_words("text", self.text, "words that say what to do")
        if not self.text.isprintable() or len(self.text) > LONGEST_TEXT:
            raise ConfigError(f"text: expected a line of {LONGEST_TEXT} characters at most, found {self.text[:80]!r}")


@dataclass(frozen=True)
class Velocity:
    """Move at a velocity in the human's heading frame: forward, left [m/s], turning left [rad/s].

    Attributes:
        manner: in which to move; None: the normal one. A sentence says it; targets, script files and logs hold
            velocities without one, and a target with one is refused.
        paced: whether it is slowed to the robot's pace; what makes up for the model's errors is not.
        beside: as of `Text`.

    Raises:
        ConfigError: a value is not a finite number, or beyond `FASTEST`, or the manner is no name.
    """

    forward: float
    left: float
    turning: float
    manner: str | None = None
    paced: bool = True
    beside: Text | None = None

    def __post_init__(self) -> None:
        value: list[Any] = [self.forward, self.left, self.turning]
        # In Python a bool is an int, but it is no speed.
        if not all(isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in value):
            raise ConfigError(f"{_EXPECTED_VELOCITY}, found {value!r}")
        if any(abs(number) > fastest for number, fastest in zip(value, FASTEST, strict=True)):
            limits = ", ".join(f"±{limit:g}" for limit in FASTEST)
            raise ConfigError(f"{_EXPECTED_VELOCITY} within [{limits}], found {value!r}")
        if self.manner is not None:
            require_words("velocity: manner", self.manner, "the name of a manner")


@dataclass(frozen=True)
class Heading:
    """Turn on the spot to a heading in the robot's odometry, the shorter way, then stand.

    Attributes:
        heading: counterclockwise from where the robot looked when it had stood up [rad].
        turning: greatest turning speed [rad/s]; None: the robot's own.

    Raises:
        ConfigError: a value is not a finite number, or out of bounds.
    """

    heading: float
    turning: float | None = None

    def __post_init__(self) -> None:
        require_numbers(_EXPECTED_HEADING, (self.heading,), WIDEST_RAD)
        if self.turning is not None:
            require_numbers(_EXPECTED_HEADING, (self.turning,), FASTEST[2])
            if self.turning < SLOWEST_TURN:
                raise ConfigError(f"{_EXPECTED_HEADING}, at {SLOWEST_TURN:g} rad/s or more, found {self.turning!r}")


@dataclass(frozen=True)
class Waypoint:
    """Walk to a place in the robot's odometry, then stand.

    Attributes:
        x, y: ahead and left of where the robot was when it had stood up [m].
        heading: at the end, as of `Heading` [rad]; None: as it arrives.
        tolerance: the robot has arrived when it stands within this distance [m].

    Raises:
        ConfigError: a value is not a finite number, or out of bounds.
    """

    x: float
    y: float
    heading: float | None = None
    tolerance: float = 0.1

    def __post_init__(self) -> None:
        require_numbers(_EXPECTED_WAYPOINT, (self.x, self.y), FARTHEST_M)
        if self.heading is not None:
            require_numbers(_EXPECTED_WAYPOINT, (self.heading,), WIDEST_RAD)
        require_numbers(_EXPECTED_WAYPOINT, (self.tolerance,), LOOSEST_M)
        if self.tolerance < CLOSEST_M:
            raise ConfigError(f"{_EXPECTED_WAYPOINT}, a tolerance of {CLOSEST_M:g} m or more; found {self.tolerance!r}")


@dataclass(frozen=True)
class Stop:
    """Come to a balanced stop."""


Intent = Clip | Text | Velocity | Heading | Waypoint | Stop | PartIntent
Goal = Heading | Waypoint
"""An intent that ends by itself, where the robot has arrived by its own odometry."""

WORDS: dict[str, type[Intent]] = {
    "clip": Clip,
    "text": Text,
    "velocity": Velocity,
    "heading": Heading,
    "waypoint": Waypoint,
    "stop": Stop,
    **PARTS,
}


def gesture_of(intent: Intent | None) -> Text | None:
    """The gesture that is made beside an intent; None: there is none."""
    return intent.beside if isinstance(intent, Text | Velocity) else None


def word_of(intent: Intent) -> str:
    """The word for this kind of intent, of `WORDS`."""
    return next(word for word, kind in WORDS.items() if isinstance(intent, kind))


def to_content(intent: Intent) -> dict[str, Any]:
    """An intent as scripts and logs hold it: its word and the value."""
    match intent:
        case Clip(name):
            value: Any = name
        case Text(text):
            value = text
        case Velocity(forward, left, turning):
            value = [forward, left, turning]
        case Heading(heading, turning):
            value = [heading] if turning is None else [heading, turning]
        case Waypoint(x, y, heading, tolerance):
            value = [x, y, heading, tolerance]
        case Stop():
            value = True
        case Logged():
            value = intent.content()
    return {word_of(intent): value}


def words_of(intent: Intent) -> str:
    """An intent in words, as answers name it. Standing still is no STOP, which refuses targets until it is released."""
    match intent:
        case Text(text):
            return text
        case Clip(name):
            return name
        case Velocity(forward, left, turning):
            return f"velocity {[forward, left, turning]}"
        case Heading() | Waypoint():
            return goal_text(intent)
        case Logged():
            return str(intent)
    return "stand still"


def goal_text(goal: Goal) -> str:
    """A goal in words: "heading 90°", "waypoint 1 m ahead, 0.5 m left, heading 180°"."""
    if isinstance(goal, Heading):
        most = "" if goal.turning is None else f", at most {goal.turning:g} rad/s"
        return f"heading {math.degrees(goal.heading):.0f}°{most}"
    end = "" if goal.heading is None else f", heading {math.degrees(goal.heading):.0f}°"
    return f"waypoint {goal.x:g} m ahead, {goal.y:g} m left{end}"


def from_content(content: Mapping[str, Any]) -> Intent:
    """The intent in a mapping that has exactly one of `WORDS`; other keys are ignored.

    Raises:
        ConfigError: there is none or more than one, or the value is not valid for the word.
    """
    found = [word for word in WORDS if word in content]
    if len(found) != 1:
        raise ConfigError(f"expected exactly one of: {', '.join(WORDS)}; found {' and '.join(found) or 'none'}")
    (word,) = found
    value = content[word]
    if word == "velocity":
        if not isinstance(value, list | tuple) or len(value) != len(FASTEST):
            raise ConfigError(f"{_EXPECTED_VELOCITY}, found {value!r}")
        return Velocity(*value)
    if word == "heading":
        numbers = value if isinstance(value, list | tuple) else [value]
        if not 1 <= len(numbers) <= 2:
            raise ConfigError(f"{_EXPECTED_HEADING}, found {value!r}")
        return Heading(*numbers)
    if word == "waypoint":
        if not isinstance(value, list | tuple) or not 2 <= len(value) <= 4:
            raise ConfigError(f"{_EXPECTED_WAYPOINT}, found {value!r}")
        return Waypoint(*value)
    if word in PARTS:
        return part_from_content(word, value)
    if word == "stop":
        if value is not True:
            raise ConfigError(f"stop: expected true, found {value!r}")
        return Stop()
    return Clip(value) if word == "clip" else Text(value)
