"""`says_only`, `ends_gesture`: whether words mean a gesture beside something else and nothing more."""

from __future__ import annotations

import re

from flexmotion.streamer.motion.speeds import Model
from flexmotion.text.clause import Asks, Clause
from flexmotion.text.limbs import lowered_arm
from flexmotion.text.phrases import limbs, wordings
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import stem

# Fillers are not `stripped`: that loses marks, and "stop, waving" is a stop.
_POLITE = (
    r"(?:(?:please|ok|okay|now|hey|robot|just|and|but|then|so|you|can|may|should|could|must|that's|it's) |all right )*"
)
_ENDS = re.compile(
    rf"{_POLITE}(?:stop|quit|cease|finish|end|enough|no more|no)(?: the| your| that)? (?P<rest>\w+ing\b.*)"
)
_FORBIDS = re.compile(rf"{_POLITE}(?:don't|do not|never) (?P<rest>.+)")
"""Words that end a gesture, and nothing else."""
_NOW = re.compile(r"(?: (?:now|please|any ?more|again|already|at once|immediately|right now|then))+$")
_LOWERS = re.compile(
    rf"{_POLITE}(?:(?:lower|drop|put down|take down) (?:your |the )?(?:hands?|arms?)"
    r"|(?:(?:put|take|bring) )?(?:your |the )?(?:hands?|arms?) (?:back )?down)(?: (?:down|again|now|please))*"
)
"""Words that lower all arms that are raised."""
_SIDE = re.compile(r"-(?:left|right|both)(?:-hands?)?|-hands?$")


def ends_gesture(clause: Clause, kind: str, model: Model) -> bool:
    """Whether a request asks for the end of a kind of gesture, which is made beside something else: "stop waving"."""
    if clause.asks is not Asks.MOTION or clause.refusal is not None:
        return False
    arms = "arm" in (limbs(kind) or ())
    if lowered := lowered_arm(clause.text):
        return arms and lowered[0] in sides(kind)
    if _LOWERS.fullmatch(clause.text):
        return arms
    ends = _ENDS.fullmatch(clause.text) or (_FORBIDS.fullmatch(clause.text) if clause.forbidden else None)
    return ends is not None and says_only(_NOW.sub("", ends["rest"]), kind, model)


def says_only(text: str, kind: str, model: Model) -> bool:
    """Whether words name a gesture, with any hand unless they say which, and nothing else.

    Whatever else is said may have meant more: "stop waving and moving", "keep waving where you are".
    """
    words = {stem(word) for word in text.split()}
    heard = model.prompt(text).kind if words else None
    if heard is None or _SIDE.sub("", heard) != _SIDE.sub("", kind):
        return False
    named = sides(text)
    own = {stem(word) for one in (kind, heard) for wording in wordings(one) for word in wording.split()}
    known = vocabulary()
    feet = known.words("walk_verbs") | known.words("turn_verbs") | known.words("stop_verbs")
    return words <= (own | known.words("to_whom")) - {"and", "or", "a", *feet} and (
        not named or not sides(kind) or named == sides(kind)
    )
