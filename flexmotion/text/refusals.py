"""`refusal_of`, `needs_head`, `condition_of`: what the words alone tell that is not done."""

from __future__ import annotations

import re

from flexmotion.text.amounts import tokens_of
from flexmotion.text.hand_places import hand_place
from flexmotion.text.no_walks import is_gesture, no_walk
from flexmotion.text.phrases import STAND
from flexmotion.text.postures import without_posture
from flexmotion.text.sayings import NOTHING
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import plain, stem, taught

_FROM_SIDE = re.compile(r" from (?:(?:the|your|my|stage|house) )*(?:left|right) (?!to )")
"""Where one comes from ("enter from the left") is not where one goes; "from left to right" is both."""
ONE_WAY = "the robot walks ahead, back or to a side; say which comes first, with 'then'"
"""Refusal of a walk between two directions."""
SAY_HOW_MUCH = "say it in metres, steps, degrees, seconds or times"
"""Behind an amount that is none."""
_BESIDE_WAYS = frozenset(["and", "to", "towards", "the", "your", "side", "then", "a", "bit", "little"])
_INSTANCE = re.compile(r"\bon (?:the|every|each) (?:first|second|third|fourth|fifth|last|next) [a-z]+")
"""One of several repetitions: "on the second bow"."""

_WRONG_LIMB = re.compile(r" wrong (hand|arm|foot|leg|side|way) ")
_ARMS = r"(?:your |the )?(?:both |both of your )?(?:arms|hands)"
_ARMS_OUT = re.compile(rf"(?:hold|put|stick|reach|keep|get|have) (?:{_ARMS} out|out {_ARMS})")
"""Forward, or to the sides."""
_ASIDE = ("sideways", "sideward", "to the side", "to one side")
_FAR = re.compile(r"(?<!\w)as (?:far|long|much|often|many)$")
"""Ends an amount of the motion before: "twice as far"."""


def refusal_of(words: list[str]) -> str | None:
    """Why the words alone tell that a request cannot be done; None where they do not."""
    known = vocabulary()
    verb = next((word for word in words if word in known.verbs), None)
    text = f" {' '.join(words)} "
    if other := no_walk(words):
        return other
    if came := _FROM_SIDE.search(text):
        return f"{came[0].strip()!r}: a place: the robot knows none"
    if " where " in text and not in_place(text) and verb in known.words("walk_verbs") | known.words("turn_verbs"):
        return "a place: the robot knows none"
    for phrase in known.phrases("impossible"):
        if f" {phrase} " in text:
            return _not_done(phrase if phrase.split()[0] != "carry" else "carry")
    if limits := [word for word in words if word in known.words("restricting")]:
        return f"{limits[0]!r}: a restriction of the robot; say it in a sentence of its own"
    if " take off " in text and not any(f" take off {word} " in text for word in known.words("harmed") | {"your"}):
        return _not_done("take off")
    if words and stem(words[0]) in known.words("flight") and not known.words("limbs") & set(words):
        return _not_done(words[0])
    if words and stem(words[0]) in known.words("harms") and known.words("harmed") & set(words[1:2]):
        return f"{words[0]!r}: the robot does nothing that hurts or breaks"
    if other := hand_place(words):
        return other
    if _leans_aside(words, text):
        return "the robot leans to no side; say 'bow', or 'walk to the left'"
    if part := _moved_trunk(words, text):
        return f"{part!r}: no motion of it alone; say 'turn left 30 degrees', and the whole robot turns"
    if wrong := _WRONG_LIMB.search(text):
        return f"which {wrong[1]}? say left or right"
    if _ARMS_OUT.fullmatch(text.strip()):
        return "to where? say 'stretch both arms forward' or 'spread your arms'"
    if _FAR.search(text.strip()):
        return f"how much is that? {SAY_HOW_MUCH}"
    if _moves_arm(words):
        return "say what the arm does: raise it, lower it, hold it out, stretch it, wave or point"
    if target := _unknown_target(words, text):
        return f"{target!r}: the robot does not know where that is; say left, right, up, down or behind you"
    if _places_foot(words):
        return "no words place or lift a foot or a leg; a foot is placed by a target: flexmotion send --foot --help"
    if instance := _INSTANCE.search(text):
        return unbounded(instance[0].strip(), None)
    named = list(dict.fromkeys(stem(word) for word in words if stem(word) in known.words("single_motions")))
    feet = [word for word in words if stem(word) in known.words("feet_motions")]
    if len(named) + bool(feet) > 1:
        return f"{named[0]!r} and {(named[1:] + feet)[0]!r} in one request: say which comes first, with 'then'"
    rest = [word for word in without_posture([*words])[0] if isinstance(word, str)]
    return _walking_refusal(rest, f" {' '.join(rest)} ")


def _not_done(what: str) -> str:
    tries = "say for example 'walk forward', 'look up' or 'shrug' (flexmotion bundles lists all)"
    return f"no model and no robot of this project does {what!r}; {tries}"


def lowered_meanwhile(words: list[str], phrases: list[str]) -> str | None:
    """Why a walk or a turn is not made "while kneeling"; None where it says no such thing of the robot.

    Args:
        phrases: what is said to be done meanwhile.
    """
    known = vocabulary()
    feet = known.words("paths") | known.words("walk_verbs") | known.words("turn_verbs") | known.words("backing")
    if words[:1] == [] or stem(words[0]) not in feet:
        return None
    for phrase in phrases:
        said = phrase.split()
        lowered = any(stem(word) in known.words("lowered") for word in said)
        if said[0] in ("while", "whilst", "as") and lowered and not known.words("other_people") & set(said):
            return f"{phrase!r}: the robot walks and turns upright; say one of them, or both with 'then'"
    return None


def _moved_trunk(words: list[str], text: str) -> str | None:
    """The part of the trunk that a request turns or moves; None where it does not."""
    known = vocabulary()
    if words[:1] and words[0] in known.words("turn_verbs") | {"move", "tilt", "shift"}:
        return next((part for part in known.table["trunk"] if f" {words[0]} your {part} " in text), None)
    return None


def _leans_aside(words: list[str], text: str) -> bool:
    """Whether the trunk is to lean to a side: "tilt your body to the left"; "bend left" is a turn."""
    known = vocabulary()
    if words[:1] == [] or stem(words[0]) not in known.words("leaning") or known.words("head") & set(words):
        return False
    aside = bool(sides(text)) or any(f" {way} " in text for way in _ASIDE)
    trunk = any(f" {part} " in text for part in (*known.table["trunk"], "body", "yourself"))
    plain_lean = words[0] not in known.words("turn_verbs") and (stem(words[0]) != "bend" or not sides(text))
    return aside and (trunk or plain_lean) and text.strip() not in taught()


def _moves_arm(words: list[str]) -> bool:
    """Whether words move an arm and say no more than to which side: "move your hand to the left"."""
    known = vocabulary()
    if words[:1] != ["move"] or not known.words("limbs") & set(words):
        return False
    sideways = {"to", "sideways", "around", "aside", "more", "little", "bit"}
    return set(words[1:]) <= known.words("limbs") | known.words("limb_owners") | sideways


def _places_foot(words: list[str]) -> bool:
    """Whether words put a foot or a leg somewhere, or name nothing else: "lift both feet", "first the left foot"."""
    known = vocabulary()
    legs = set(known.table["limb_groups"]["leg"])
    place = next((place for place, word in enumerate(words) if word in legs), None)
    if place is None:
        return False
    before, after = words[:place], words[place + 1 :]
    verb = stem(before[0]) if before else ""
    puts = verb == "move" or verb in known.words("puts")
    owners = set(before[puts:]) - {"up", "down"}  # "pick up your feet"
    if not owners <= known.words("limb_owners") | known.words("refers"):
        return False
    counted = bool(owners & known.words("lengths_of_feet"))  # "move two feet ahead" is a length
    if puts:
        return verb != "move" or not counted
    # "left leg kick" names the limb of a motion, "left foot forward" a place.
    to_place = not after or after[0] in known.words("foot_places")
    return to_place and (not after or after == ["up"] or (bool(owners) and not counted))


def _unknown_target(words: list[str], text: str) -> str | None:
    """The thing that a request looks at and whose direction no word tells; None where there is none."""
    known = vocabulary()
    look = next((place for place, word in enumerate(words) if word in known.words("look")), None)
    if look is None or words[look] == "nod" or not set(words[:look]) <= known.words("look_openings") or sides(text):
        return None
    if any(f" {phrase} " in text for phrase in known.phrases("gaze_words")):
        return None
    place = next(
        (place for place, word in enumerate(words) if place > look and word in ("at", "toward", "towards")), None
    )
    return None if place is None else " ".join(words[place:])


def unbounded(condition: str | None, destination: str | None) -> str | None:
    """Why a motion that only a moment or a place would end is not begun; None where nothing is to end it."""
    if condition is not None:
        return f"{condition!r}: the robot cannot tell when that is"
    return None if destination is None else f"{destination!r}: a place: the robot knows none, and would go on"


def _unmeasured(words: list[str], text: str) -> str | None:
    """Why a walk or a turn has no amount although its words say one ("a lot", "north"); None: they say none."""
    known = vocabulary()
    feet = known.words("paths") | known.words("walk_verbs") | known.words("turn_verbs")
    if words[:1] == [] or words[0] not in feet or text.strip() in taught():
        return None
    if compass := [word for word in words if word in known.words("compass")]:
        return f"{compass[0]!r}: the robot has no compass; say for example 'turn left 90 degrees'"
    for phrase in known.phrases("unmeasured"):
        after = text.partition(f" {phrase} ")[2].split()
        changes = bool(after) and (after[0].endswith(("er", "ly")) or after[0] in ("more", "less", "too"))
        if f" {phrase} " in text and not changes:
            return f"{phrase!r}: how much is that? {SAY_HOW_MUCH}"
    return f"{words[-1]!r}: how much is that? {SAY_HOW_MUCH}" if words[-1] in ("some", "half") else None


def _between_ways(words: list[str]) -> str | None:
    """Why a walk is none that the robot could make: it is ahead or back, and to a side, at once; None: it is not."""
    known = vocabulary()
    walks = known.words("walk_verbs") | known.words("paths")
    if words[:1] == [] or words[0] in known.words("turn_verbs"):
        return None
    if words[0] in walks and (slanted := [word for word in words[1:] if word in known.words("slanted")]):
        return f"{slanted[0]!r}: {ONE_WAY}"
    rest = set(words[1:] if words[0] in walks - known.words("directions") else words)
    straight = (known.words("onward") | known.words("backward")) & rest
    between = straight and len(sides(" ".join(words))) == 1 and rest <= known.words("directions") | _BESIDE_WAYS
    return f"two directions at once: {ONE_WAY}" if between else None


def _walking_refusal(words: list[str], text: str) -> str | None:
    """Why a walk or a turn is none that the robot could make."""
    known = vocabulary()
    first = words[0] if words else ""
    if between := _between_ways(words):
        return between
    if unsaid := _unmeasured(words, text):
        return unsaid
    if (
        words[1:2] in (["over"], ["aside"])
        and first in known.words("aside_verbs")
        and len(words) == 2
        and not sides(text)
    ):
        return f"{words[1]!r}: to the left or to the right?"
    steps = first in ("take", "make", "do") and bool(set(words[1:]) & (known.words("feet_motions") | {"step", "steps"}))
    if first in ("take", "make", "do") and any(f" {first} {phrase} " in text for phrase in known.phrases("in_place")):
        steps = True  # its steps are counted: "make four steps on the spot"
    if (first not in known.words("paths") and not steps) or known.words("limbs") & set(words):
        return None
    one_side = len(sides(text)) == 1
    for phrase in known.phrases("shapes"):
        if f" {phrase} " in text and not one_side:
            return f"{phrase!r}: the robot walks straight or in a curve to a side that is said"
    for word in words[1:]:
        if word in known.words("to_a_side") and not one_side:
            return f"{word!r}: to the left or to the right?"
    for phrase in known.phrases("in_place"):
        if f" {phrase} " in text and first not in known.words("turn_verbs") and not one_side:
            return f"{phrase!r}: the robot has no such motion on one spot"
    onward, back = known.words("onward"), known.words("backward")
    if (onward & set(words[1:]) and back & set(words[1:])) or (len(sides(text)) == 2 and " from " not in text):
        return "two opposite directions at once"
    return None


def needs_head(words: list[str]) -> bool:
    """Whether a request is one of looking, or of moving the head."""
    known = vocabulary()
    verb = next((word for word in words if word in known.verbs), None)
    if verb in known.words("look") or (words and words[0] in known.words("look")):
        return True
    turns, others = known.words("head_motions"), known.words("head_leads")
    if not names_head(" ".join(words)):
        return False
    # "let your eyes wander": the first word moves the head, whatever the head does then.
    leads = words[0] in others and len(words) > 2 and words[2] in known.words("head")
    return leads or verb in turns


def condition_of(words: list[str]) -> str | None:
    """The condition of a request ("until you reach the wall", "if you see me"); of an allowed one the phrase alone."""
    known = vocabulary()
    for place, word in enumerate(words):
        if word in known.words("conditions") and (place or len(words) > 2):
            text = " ".join(words[place:])
            return next((phrase for phrase in known.phrases("allowed_conditions") if text.startswith(phrase)), text)
    return None


def is_no_stand(text: str) -> bool:
    """Whether a request is none to stand, although a listener may hear that: its verb is of a motion."""
    words = [word for word in text.lower().split() if word.isalpha()]
    told = taught().get(plain(tokens_of(text)))
    first = next((stem(word) for word in words if stem(word) in vocabulary().verbs), None)
    if told is None and vocabulary().words("speed_changes") & set(words):
        return True  # "get moving a bit quicker"
    return told != STAND and (told == NOTHING or first in vocabulary().words("unlike_standing"))


def is_no_walk(text: str) -> bool:
    """Whether a request is none to walk or to turn, although a listener may hear that: "lean left", "clap back"."""
    words = [word for word in text.lower().split() if word.isalpha()]
    if not words or taught().get(plain(tokens_of(text)), NOTHING) != NOTHING:
        return False
    if stem(words[0]) in vocabulary().words("unlike_walking"):
        return True
    return is_gesture(words)


def is_unlike(text: str, kind: str) -> bool:
    """Whether the words rule out a kind of motion that a listener may hear in them: "lean forward" is no bow."""
    words = [stem(word) for word in text.lower().split() if word.isalpha()]
    return words[:1] != [] and words[0] in vocabulary().table["unlike"].get(kind, ()) and kind not in words


def moves_feet(text: str) -> bool:
    """Whether the words of a prohibition mean any motion of the feet: "don't move your feet", "no stepping"."""
    words = text.split()
    if [stem(word) for word in words] in (["step"], ["steps"]):
        return True  # a turn on the spot is made of steps as well
    return words[:1] == ["move"] and bool(vocabulary().words("feet_words") & set(words[1:]))


def is_turning(text: str) -> bool:
    """Whether the words of a prohibition name turns to both sides: "no turning", "don't turn around"."""
    words = text.split()
    return bool(words) and stem(words[0]) in vocabulary().words("turn_verbs") and not sides(text)


def in_place(text: str) -> bool:
    """Whether words say that the robot is to stay in its place: "on the spot"."""
    words = " ".join(re.findall(r"[\w']+", text))  # "stay where you are, turn left"
    return any(f" {phrase} " in f" {words} " for phrase in vocabulary().phrases("in_place"))


def goes_ahead(text: str) -> bool:
    """Whether the words of a turn name a way that it goes: "walk in a circle to the left"."""
    return bool({stem(word) for word in text.split()} & (vocabulary().words("walking") | vocabulary().words("curves")))


def names_head(text: str) -> bool:
    """Whether words name someone's head, eyes or face: "keep your eyes on me"."""
    words, owners = text.lower().split(), ("your", "the", "its", "my", "his", "her")
    head = vocabulary().words("head")
    return any(word in head and place and words[place - 1] in owners for place, word in enumerate(words))
