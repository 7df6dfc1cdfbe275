"""`Clause`: one request of a sentence, as far as words alone tell."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from flexmotion.text.amounts import Amount
from flexmotion.text.paces import Rate

NO_KNOWN_WORD = "none of its words is known; the model hears English"
"""Refusal of words that a listener may still take for something."""

UNITS = "say metres, steps, degrees, seconds or times"
"""Behind a number without a unit."""
SAY_A_SPEED = "say one speed with the motion that has it, as in 'walk forward at 0.5 m/s'"
"""Refusal of a speed with a unit that is of no motion."""

ONE_SPEED = "expected one speed, as in 'walk forward at 0.5 m/s'"
"""Refusal of a range of speeds, and of a rough one."""

PER_TIME = "expected metres, degrees or radians per second, minute or hour, as in 'walk forward at 0.5 m/s'"
"""Refusal of a speed in another unit."""


class Asks(Enum):
    """What a clause asks for: a motion of its own, or something of the motion that is under way."""

    MOTION = "motion"
    FASTER = "faster"
    SLOWER = "slower"
    AGAIN = "again"
    CONTINUE = "continue"


@dataclass(frozen=True)
class Clause:
    """One request of a sentence.

    Attributes:
        said: its words as said, for the answer.
        text: its words for the listener, without amounts; where `asks` is AGAIN the motion to repeat, if it names one;
            else empty.
        asks: what it asks for.
        amount: how much of it; None: not said.
        times: how often; 1: once, or not said.
        counted: whether `times` was said.
        speed: factor on the speed of the motion.
        rate: its speed, with a unit; None: not said.
        forbidden: the clause says what not to do.
        refusal: why it cannot be done, as far as the words alone tell; None: they do not.
        dropped: parts of it that are not done.
        joint: what joins it to the one before: "then" for an order of doing.
        notes: what was taken for rough words.
        manner: the adverbs of `speed`.
        degree: how large it is to be, if it is a gesture ("a little", "very deeply").
        needs_head: whether only a motion of the head or the eyes does it.
        until_told: it says that it goes on until something else is said.
        side: of what is done again, or `BACK`, `FORWARD`; None: as it was done.
        more: it asks for more of the motion before ("two more steps"); `text` is for a robot that has done none. Of
            what is done again: `times` counts single ones of a counted motion.
        verbless: it names no verb of its own.
        on_the_spot: its turn is not to walk ahead, since the sentence forbids walks.
        still: a stand is asked for with it ("stand still while waving").
        beside: gesture that is made meanwhile, by arms or a head that are free for it; None: there is none.
    """

    said: str
    text: str
    asks: Asks = Asks.MOTION
    amount: Amount | None = None
    times: int = 1
    counted: bool = False
    speed: float = 1.0
    rate: Rate | None = None
    forbidden: bool = False
    refusal: str | None = None
    dropped: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    manner: str = ""
    degree: str = ""
    needs_head: bool = False
    until_told: bool = False
    joint: str = "then"
    side: str | None = None
    more: bool = False
    verbless: bool = False
    on_the_spot: bool = False
    still: bool = False
    beside: Clause | None = None
