"""Intents for one part of the body, arms, head and feet: the rest goes on with what it does.

Places and directions of arms and head are seen from the robot's trunk: origin and axes of the robot file's `torso`
body, x forward, y left, z up along the trunk. A hand that is held there goes with the robot where it walks. The place
of a foot is seen from the other foot, which stands, that of the head from the middle between both soles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from flexmotion.configs.errors import ConfigError
from flexmotion.spatial.angle_words import told_angle
from flexmotion.streamer.motion.intent_values import require_numbers, require_words
from flexmotion.streamer.motion.part_values import LONGEST_JOINT, SIDES, Logged, Side, require_choice, require_joint
from flexmotion.streamer.motion.restriction_intents import FOOT_PARTS, TENSION, TORQUE, Contact, Tension, TorqueCap

FARTHEST_HAND_M = 2.0
"""Bound of each coordinate of a hand's place [m]."""
FARTHEST_FOOT_M = 1.0
"""Bound of each coordinate of a foot's place [m]."""
LONGEST_S = 10.0
"""Longest time to a place [s]."""
LEAST_DIRECTION = 1e-3
"""Least length of a direction."""
_WIDEST_RAD = math.pi
PLACE_OF = "place of "
"""How the name of the part of a foot's place begins."""
RELAXES = "relax "
"""How the name of the part of a `Relax` begins, where targets wait by part."""
HEAD, HEAD_PLACE = "head", "head place"
"""Names of the part that looks, and of that which is at a place: each may be asked for without the other."""

Vector = tuple[float, float, float]
HeadVector = tuple[float | None, float | None, float]


def _require_vector(word: str, value: Any, bound: float, axes: str = "x, y, z") -> None:
    count = len(axes.split(", "))
    if not isinstance(value, tuple) or len(value) != count:
        raise ConfigError(f"{word}: expected {count} numbers, [{axes}]; found {value!r}")
    require_numbers(f"{word}: expected [{axes}]", value, bound)


def _require_direction(word: str, value: Any) -> None:
    _require_vector(word, value, FARTHEST_HAND_M)
    if math.hypot(*value) < LEAST_DIRECTION:
        raise ConfigError(f"{word}: expected a direction of length {LEAST_DIRECTION:g} or more; found {value!r}")


def _require_timing(word: str, in_s: Any, tolerance: Any, widest: float) -> None:
    require_numbers(f"{word}: in_s: expected seconds", (in_s,), LONGEST_S, 0.0)
    require_numbers(f"{word}: tolerance: expected a number", (tolerance,), widest, 0.0)


def _told(values: Sequence[float | None]) -> str:
    return "[" + ", ".join("any" if value is None else f"{value:.3g}" for value in values) + "]"


@dataclass(frozen=True)
class Hand(Logged):
    """Bring a hand to a place.

    Attributes:
        side: which hand.
        place: x, y, z in the trunk's frame [m].
        in_s: time from now until it is there [s].
        tolerance: a place out of reach is replaced by the nearest one within this distance [m]; else it is refused.

    Raises:
        ConfigError: a value is not of its kind, or out of bounds.
    """

    side: Side
    place: Vector
    in_s: float = 0.5
    tolerance: float = 0.05

    def __post_init__(self) -> None:
        require_choice("hand: side", self.side, SIDES)
        _require_vector("hand: place", self.place, FARTHEST_HAND_M)
        _require_timing("hand", self.in_s, self.tolerance, FARTHEST_HAND_M)

    @property
    def part(self) -> str:
        """Name of the part of the body."""
        return f"{self.side} hand"

    def __str__(self) -> str:
        return f"{self.part} to {_told(self.place)} m in {self.in_s:g} s"


@dataclass(frozen=True)
class FootPlace(Logged):
    """Make a step with a foot to a place beside, ahead of or behind the other one, and stand there.

    Attributes:
        side: which foot.
        place: x, y of the centre of its sole from that of the other one, along the axes of the other sole, x to its
            toes, y left [m].
        heading: of its toes, from those of the other foot, positive to the left [rad].
        in_s: time from now until it is there [s].
        tolerance: a place out of reach is replaced by the nearest one within this distance [m]; else it is refused.
        tolerance_rad: a heading likewise [rad].

    Raises:
        ConfigError: a value is not of its kind, or out of bounds.
    """

    side: Side
    place: tuple[float, float]
    heading: float = 0.0
    in_s: float = 1.0
    tolerance: float = 0.05
    tolerance_rad: float = 0.1

    def __post_init__(self) -> None:
        require_choice("foot: side", self.side, SIDES)
        _require_vector("foot: place", self.place, FARTHEST_FOOT_M, "x, y")
        require_numbers("foot: heading: expected radians", (self.heading,), _WIDEST_RAD)
        _require_timing("foot", self.in_s, self.tolerance, FARTHEST_FOOT_M)
        require_numbers("foot: tolerance_rad: expected radians", (self.tolerance_rad,), _WIDEST_RAD, 0.0)

    @property
    def part(self) -> str:
        """See `Hand.part`; a foot that is kept down is another part: neither replaces the other unread."""
        return f"{PLACE_OF}{FOOT_PARTS[self.side]}"

    def __str__(self) -> str:
        turned = f", {told_angle(self.heading)}" if self.heading else ""
        return f"{FOOT_PARTS[self.side]} to {_told(self.place)} m{turned} in {self.in_s:g} s"


@dataclass(frozen=True)
class HeadPlace(Logged):
    """Bring the head to a place by hips and trunk, both feet staying where they stand.

    Attributes:
        place: x, y, z of the head's point from the middle between both soles on the floor [m]: x as the feet point, y
            left, z up. None: wherever the height leads, with the trunk as upright as it may be.
        in_s: time from now until it is there [s].
        tolerance: a place out of reach is replaced by the nearest one within this distance [m]; else it is refused.

    Raises:
        ConfigError: a value is not of its kind, or out of bounds.
    """

    place: HeadVector
    in_s: float = 1.0
    tolerance: float = 0.05

    def __post_init__(self) -> None:
        place: Any = self.place
        if isinstance(place, tuple) and len(place) == 3:  # x and y may be left open
            place = (*(0.0 if value is None else value for value in place[:2]), place[2])
        _require_vector("head: place", place, FARTHEST_HAND_M)
        _require_timing("head", self.in_s, self.tolerance, FARTHEST_HAND_M)

    @property
    def part(self) -> str:
        """See `Hand.part`: a head that looks is another part."""
        return HEAD_PLACE

    def __str__(self) -> str:
        return f"head to {_told(self.place)} m in {self.in_s:g} s"


@dataclass(frozen=True)
class Point(Logged):
    """Point somewhere with an arm, almost straight from shoulder to hand.

    Attributes:
        side: which arm.
        direction: in the trunk's frame, of any length.
        in_s: time from now until it points there [s].
        tolerance: a direction that the arm cannot take is replaced by the nearest one within this angle [rad]; else it
            is refused.

    Raises:
        ConfigError: a value is not of its kind, or out of bounds.
    """

    side: Side
    direction: Vector
    in_s: float = 0.5
    tolerance: float = 0.35

    def __post_init__(self) -> None:
        require_choice("point: side", self.side, SIDES)
        _require_direction("point: direction", self.direction)
        _require_timing("point", self.in_s, self.tolerance, _WIDEST_RAD)

    @property
    def part(self) -> str:
        """See `Hand.part`: an arm that points has its hand nowhere else."""
        return f"{self.side} hand"

    def __str__(self) -> str:
        return f"{self.side} arm towards {_told(self.direction)} in {self.in_s:g} s"


@dataclass(frozen=True)
class Look(Logged):
    """Look into a direction with the head; nothing else turns.

    Attributes:
        direction: in the trunk's frame, of any length.
        in_s: time from now until it looks there [s].
        tolerance: a direction that the head cannot take is replaced by the nearest one within this angle [rad]; else it
            is refused.

    Raises:
        ConfigError: a value is not of its kind, or out of bounds.
    """

    direction: Vector
    in_s: float = 0.5
    tolerance: float = 0.35

    def __post_init__(self) -> None:
        _require_direction("look: direction", self.direction)
        _require_timing("look", self.in_s, self.tolerance, _WIDEST_RAD)

    @property
    def part(self) -> str:
        """See `Hand.part`."""
        return HEAD

    def __str__(self) -> str:
        return f"look towards {_told(self.direction)} in {self.in_s:g} s"


@dataclass(frozen=True)
class JointAngle(Logged):
    """Bring one joint of arms or head to an angle.

    Attributes:
        joint: its name in the robot file.
        angle: [rad], in the joint's own sign.
        in_s: time from now until it is there [s].
        tolerance: an angle beyond the joint's limits is replaced by the limit where that is within this angle [rad];
            else it is refused.

    Raises:
        ConfigError: a value is not of its kind, or out of bounds.
    """

    joint: str
    angle: float
    in_s: float = 0.5
    tolerance: float = 0.1

    def __post_init__(self) -> None:
        require_joint("joint", self.joint)
        require_numbers("joint: angle: expected radians", (self.angle,), math.tau)
        _require_timing("joint", self.in_s, self.tolerance, _WIDEST_RAD)

    @property
    def part(self) -> str:
        """See `Hand.part`."""
        return f"joint {self.joint}"

    def __str__(self) -> str:
        return f"{self.joint} to {told_angle(self.angle)} in {self.in_s:g} s"


@dataclass(frozen=True)
class Relax(Logged):
    """Let a part go: it goes back to what the rest of the body does.

    Attributes:
        part: "left hand", "right hand", "head", "head place", "joint NAME", "left foot", "right foot", "both feet",
            "torque NAME", "tension LIMB"; "all": every one that was asked for something.

    Raises:
        ConfigError: it is no name.
    """

    part: str = "all"

    def __post_init__(self) -> None:
        require_words("relax", self.part, "the name of a part, or all")
        if len(self.part) > LONGEST_JOINT + 8 or not self.part.isprintable():
            raise ConfigError(f"relax: expected the name of a part, or all; found {self.part[:80]!r}")

    @property
    def lifts(self) -> bool:
        """Whether it lets go feet, or what restricts the robot, torques or tension, rather than an arm or the head."""
        return self.part in FOOT_PARTS.values() or self.part.startswith((TORQUE, TENSION))

    def ends(self, part: str) -> bool:
        """Whether it lets a part go, by the name that its intent has."""
        if self.part == FOOT_PARTS["both"] and part.startswith(PLACE_OF):
            return True
        return self.part in ("all", part) or part == f"{PLACE_OF}{self.part}"

    def __str__(self) -> str:
        return f"relax {self.part}"


Placed = Hand | Point | Look | JointAngle
"""An intent that brings an arm or the head somewhere."""
PartIntent = Placed | FootPlace | HeadPlace | Relax | Contact | TorqueCap | Tension
"""An intent for one part of the body."""

PARTS: dict[str, type[PartIntent]] = {
    "hand": Hand,
    "foot": FootPlace,
    "head": HeadPlace,
    "point": Point,
    "look": Look,
    "joint": JointAngle,
    "relax": Relax,
    "contact": Contact,
    "torque": TorqueCap,
    "tension": Tension,
}


def part_from_content(word: str, value: Any) -> PartIntent:
    """The intent of a word of `PARTS`, from its fields.

    Raises:
        ConfigError: a field is missing, not known or not valid; names the word and what is valid.
    """
    kind = PARTS[word]
    known = tuple(kind.__dataclass_fields__)
    if not isinstance(value, Mapping) or not set(value) <= set(known):
        raise ConfigError(f"{word}: expected the fields {', '.join(known)}; found {value!r}")
    fields: dict[str, Any] = {name: tuple(one) if isinstance(one, list) else one for name, one in value.items()}
    try:
        made: PartIntent = kind(**fields)
    except TypeError:
        raise ConfigError(f"{word}: expected the fields {', '.join(known)}; found {', '.join(value)}") from None
    return made
