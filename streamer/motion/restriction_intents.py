"""Intents that restrict what the robot does, whatever it is asked for: feet, torques, how stiff arms and head follow.

A restriction moves nothing. It holds beside all targets until it is let go (`Relax`), or its time is over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from flexmotion.streamer.motion.intent_values import require_numbers
from flexmotion.streamer.motion.part_values import Logged, require_choice, require_joint
from flexmotion.text.restriction_phrases import LEAST_NM

Foot = Literal["left", "right", "both"]
FEET: tuple[Foot, ...] = get_args(Foot)
FOOT_PARTS: dict[Foot, str] = {"left": "left foot", "right": "right foot", "both": "both feet"}
"""Names of the parts of the body, as `relax` takes them."""
TORQUE = "torque "
"""How the name of the part of a torque cap begins."""

Limb = Literal["left arm", "right arm", "both arms", "head"]
TENSION_LIMBS: tuple[Limb, ...] = get_args(Limb)
TENSION = "tension "
"""How the name of the part of a tension begins."""

MOST_NM = 1000.0
"""Greatest torque cap, beside `LEAST_NM` [N·m]."""


@dataclass(frozen=True)
class Contact(Logged):
    """Keep a foot on the ground where it is, or both: no step lifts it.

    Attributes:
        foot: left, right or both.

    Raises:
        ConfigError: it is none of these.
    """

    foot: Foot

    def __post_init__(self) -> None:
        require_choice("contact: foot", self.foot, FEET)

    @property
    def part(self) -> str:
        """Name of the part of the body."""
        return FOOT_PARTS[self.foot]

    @property
    def sides(self) -> frozenset[int]:
        """The feet that stay: 0 left, 1 right."""
        return frozenset((0, 1) if self.foot == "both" else (FEET.index(self.foot),))

    def __str__(self) -> str:
        return f"keep {self.part} down"


@dataclass(frozen=True)
class TorqueCap(Logged):
    """Ask no more than a torque of a joint's servo.

    Attributes:
        joint: its name in the robot file; or a name of the body, `knee` for both, `left knee` for one
            (`flexmotion/retarget/joint_names.py`).
        limit: greatest torque, in either direction [N·m].

    Raises:
        ConfigError: it is no name, or the limit is no number or out of bounds.
    """

    joint: str
    limit: float

    def __post_init__(self) -> None:
        require_joint("torque: joint", self.joint)
        require_numbers("torque: limit: expected N·m", (self.limit,), MOST_NM, LEAST_NM)

    @property
    def part(self) -> str:
        """See `Contact.part`."""
        return f"{TORQUE}{self.joint}"

    def __str__(self) -> str:
        return f"{self.joint}: {self.limit:g} N·m at most"


@dataclass(frozen=True)
class Tension(Logged):
    """Let an arm, both, or the head follow as stiffly as that, whatever the human's muscles do.

    Attributes:
        limb: left arm, right arm, both arms or head.
        tension: 1: as stiff as the robot file lets it be; 0: as soft (`least_stiffness`).

    Raises:
        ConfigError: it is no such limb, or the tension is no number from 0 to 1.
    """

    limb: Limb
    tension: float

    def __post_init__(self) -> None:
        require_choice("tension: limb", self.limb, TENSION_LIMBS)
        require_numbers("tension: expected a number", (self.tension,), 1.0, 0.0)

    @property
    def part(self) -> str:
        """See `Contact.part`."""
        return f"{TENSION}{self.limb}"

    @property
    def limbs(self) -> tuple[str, ...]:
        """Names of the limbs, as of the chains of a robot file."""
        return ("left_arm", "right_arm") if self.limb == "both arms" else (self.limb.replace(" ", "_"),)

    def __str__(self) -> str:
        return f"{self.limb}: tension {self.tension:g}"


Restriction = Contact | TorqueCap | Tension
