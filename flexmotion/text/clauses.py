"""`clause_of`: one part of a sentence to a request with its amount, as far as words alone tell."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from math import pi

from flexmotion.text.amounts import Amount, Bare, Token, is_mark
from flexmotion.text.phrases import STAND
from flexmotion.text.prompt_reader import FORBIDS_NOTHING, WITHOUT_TURNING
from flexmotion.text.sentence_parts import NEGATES, Part
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import begins, plain, stem, stripped, taught, taught_words

_CHANGE = re.compile(
    r"(?:(?:walk|go|move|turn|run|step|keep|be) )?"
    r"(?:a (?:little )?bit |a little |much |even |slightly |some |somewhat )?"
    r"(?:(?P<faster>faster|quicker|more quickly)|(?P<slower>slower|more slowly|less fast))"
)

NO_KNOWN_WORD = "none of its words is known; the model hears English"
"""Refusal of words that a listener may still take for something."""

LEAST_BARE_DEGREES = 15.0
"""A number without a unit behind "turn" is an angle from here on [degrees]."""


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
        text: its words for the listener, without amounts; empty where `asks` is not MOTION.
        asks: what it asks for.
        amount: how much of it; None: not said.
        times: how often; 1: once, or not said.
        counted: whether `times` was said.
        speed: factor on the speed of the motion.
        forbidden: the clause says what not to do.
        refusal: why it cannot be done, as far as the words alone tell; None: they do not.
        dropped: parts of it that are not done.
        joint: what joins it to the one before: "then" for an order of doing.
        notes: what was taken for rough words.
        manner: the adverbs of `speed`.
        needs_head: whether only a motion of the head or the eyes does it.
        until_told: it says that it goes on until something else is said.
    """

    said: str
    text: str
    asks: Asks = Asks.MOTION
    amount: Amount | None = None
    times: int = 1
    counted: bool = False
    speed: float = 1.0
    forbidden: bool = False
    refusal: str | None = None
    dropped: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    manner: str = ""
    needs_head: bool = False
    until_told: bool = False
    joint: str = "then"


def clause_of(part: Part, forbidding: bool) -> Clause | None:
    """The request of one part; None where it asks for nothing."""
    known = vocabulary()
    tokens = [token for token in part.tokens if not is_mark(token)]
    said = plain(tokens)
    dropped, notes = list(part.dropped), list[str]()
    tokens = stripped(tokens)
    words = [token for token in tokens if isinstance(token, str)]
    sentence = " ".join(words)
    rest = FORBIDS_NOTHING.sub(" ", sentence)
    rest = rest if words[:1] and words[0] in known.words("turn_verbs") else WITHOUT_TURNING.sub(" ", rest)
    if forbidding or NEGATES.search(rest):
        rest = plain(stripped([*NEGATES.sub(" ", sentence).split()]))
        return Clause(said, rest, forbidden=True, dropped=tuple(dropped))
    plain_stop = taught().get(plain(tokens)) == STAND
    if (refusal := _refusal(words)) is not None:
        return Clause(said, sentence, refusal=refusal, dropped=tuple(dropped))
    if not tokens:
        return Clause(said, "", dropped=tuple(dropped), refusal="nothing else is asked for") if dropped else None
    if words and not any(word in taught_words() or word in known.verbs for word in words):
        asked = _relative(" ".join(words), None, part.joint) is Asks.MOTION
        if asked and not set(words) <= known.words("directions") | known.words("hedges"):
            return Clause(said, sentence, refusal=NO_KNOWN_WORD)
    needs_head = _needs_head(words)
    condition = _condition(words)
    until_told = condition is not None and not plain_stop and condition in known.words("allowed_conditions")
    if condition is not None and not plain_stop:
        dropped += [] if until_told else [condition]
        tokens = _without_tail(tokens, condition.split()[0])
    uncountable = next((t for t in tokens if isinstance(t, Amount) and not _is_count(t)), None)
    if uncountable is not None:
        return Clause(said, sentence, refusal=f"{uncountable.said!r}: expected a whole number, 1 or more")
    amount, times, counted, tokens, extra = _amounts(tokens)
    dropped += extra
    if amount is None and not counted:
        amount, tokens = _little(tokens)
    if amount is not None and amount.rough:
        notes.append(f"{amount.said!r} is taken as {amount}")
    sentence = plain(tokens)
    if any(isinstance(token, Bare) or token.isdigit() for token in tokens if not isinstance(token, Amount)):
        return Clause(said, sentence, refusal="the number in it has no unit that is known")
    asks = _relative(sentence, amount, part.joint)
    if amount is not None and amount.quantity == "time" and sentence in known.words("hold"):
        asks = Asks.CONTINUE
    if counted and amount is None and sentence in ("", "more"):
        asks = Asks.AGAIN  # "two more times"
    if asks is not Asks.MOTION:
        factor = _change(said, asks) if asks in (Asks.FASTER, Asks.SLOWER) else 1.0
        return Clause(said, "", asks, amount, times, counted, factor, dropped=tuple(dropped), notes=tuple(notes))
    if amount is None and words[:1] and words[0] in known.words("turn_verbs") and "by" in words:
        return Clause(said, sentence, refusal="the amount is not understood")
    speed, manner, tokens = _speed(tokens)
    words = [token for token in tokens if isinstance(token, str)]
    words = [word for word in words if word not in ("again",)] if len(words) > 1 else words
    things: dict[str, str] = known.table["things"]
    words = [part for word in words for part in (things[word].split() if counted and word in things else [word])]
    words, amount, refusal = _shaped(words, amount, times, counted)
    if amount is not None and amount.said.endswith("times around"):
        times, counted = 1, False
    if counted and amount is None and words[:1] in (["step"], ["sidestep"]):
        amount, times, counted = Amount(float(times), "steps", f"{times} times"), 1, False
    dropped += _destinations(words)
    text = " ".join(words)
    return Clause(
        said,
        text,
        Asks.MOTION,
        amount,
        times,
        counted,
        speed,
        refusal=refusal,
        dropped=tuple(dropped),
        notes=tuple(notes),
        manner=manner,
        needs_head=needs_head,
        until_told=until_told,
    )


def _is_count(amount: Amount) -> bool:
    """Whether an amount of times is a whole number from 1 on; other amounts always are fine."""
    return amount.quantity != "times" or (amount.value >= 1 and amount.value == int(amount.value))


def _refusal(words: list[str]) -> str | None:
    """Why the words alone tell that a request cannot be done; None where they do not."""
    known = vocabulary()
    verb = next((word for word in words if word in known.verbs), None)
    text = f" {' '.join(words)} "
    if " where " in text and verb in known.words("walk_verbs") | known.words("turn_verbs"):
        return "a place: the robot knows none"
    for phrase in known.phrases("impossible"):
        if f" {phrase} " in text:
            return f"{phrase!r}: no model and no robot of this project does that"
    return None


def _needs_head(words: list[str]) -> bool:
    """Whether a request is one of looking, or of moving the head."""
    known = vocabulary()
    verb = next((word for word in words if word in known.verbs), None)
    if verb in known.words("look") or (words and words[0] in known.words("look")):
        return True
    owners = ("your", "the", "its", "my", "his", "her")
    named = any(
        word in known.words("head") and place and words[place - 1] in owners for place, word in enumerate(words)
    )
    moves = ("turn", "move", "tilt", "shake", "rotate", "swivel", "nod", "twist", "roll", "close", "open")
    return named and verb in moves


def _condition(words: list[str]) -> str | None:
    """The condition at the end of a request ("until you reach the wall"); of an allowed one the phrase alone."""
    known = vocabulary()
    for place, word in enumerate(words):
        if place and word in known.words("conditions"):
            text = " ".join(words[place:])
            return next((phrase for phrase in known.phrases("allowed_conditions") if text.startswith(phrase)), text)
    return None


def _without_tail(tokens: list[Token], word: str) -> list[Token]:
    return tokens[: tokens.index(word)] if word in tokens else tokens


def _amounts(tokens: list[Token]) -> tuple[Amount | None, int, bool, list[Token], list[str]]:
    """The amount that ends the motion, how often, whether that was said, the other tokens, amounts that are dropped."""
    hedges = vocabulary().words("hedges")
    first_word = next((token for token in tokens if isinstance(token, str)), "")
    turns = first_word in vocabulary().words("turn_verbs") or first_word in ("do", "make")
    amount: Amount | None = None
    times, counted = 1, False
    rest: list[Token] = []
    extra: list[str] = []
    for token in tokens:
        if isinstance(token, Bare) and turns and abs(token.value) >= LEAST_BARE_DEGREES:
            token = Amount(token.value * pi / 180.0, "angle", token.said)
            rest = rest[:-1] if rest[-1:] == ["a"] else rest
        if not isinstance(token, Amount):
            rest.append(token)
            continue
        while (
            rest
            and rest[-1] in hedges
            and (token.quantity != "times" or rest[-1] not in ("around", "through"))
            and len(rest) > (1 if amount is None and rest[-1] == "only" else 0)
        ):
            rest.pop()
        if token.quantity == "times":
            extra += [token.said] if counted else []
            times, counted = (times, counted) if counted else (int(token.value), True)
        elif amount is None or (turns and token.quantity == "angle" and amount.quantity != "angle"):
            extra += [] if amount is None else [amount.said]
            amount = token
        else:
            extra.append(token.said)
    return amount, times, counted, rest, extra


def _little(tokens: list[Token]) -> tuple[Amount | None, list[Token]]:
    """The amount of a walk or a turn "a bit" and the other tokens; None where there is none, or it is no amount.

    "A little faster" is a change of speed, "wave a little" a manner.
    """
    known = vocabulary()
    first = next((token for token in tokens if isinstance(token, str)), "")
    turns, walks = first in known.words("turn_verbs"), first in known.words("walk_verbs")
    for place in range(1, len(tokens)):
        phrase = begins(tokens, place, known.phrases("little"))
        if phrase is None:
            continue
        end = place + len(phrase.split())
        following = tokens[end] if end < len(tokens) else ""
        changes = isinstance(following, str) and (following in known.table["speeds"] or following[-2:] in ("er", "ly"))
        if not (turns or walks) or changes or following in ("more", "less"):
            return None, tokens
        rest = [*tokens[:place], *tokens[end:]]
        if turns:
            degrees = float(known.table["little_turn"])
            return Amount(degrees * pi / 180.0, "angle", phrase, rough=True), rest
        return Amount(float(known.table["little_walk"]), "length", phrase, rough=True), rest
    return None, tokens


def _speed(tokens: list[Token]) -> tuple[float, str, list[Token]]:
    """The factor that adverbs put on the speed, these adverbs, and the tokens without them."""
    known = vocabulary()
    speeds: dict[str, float] = known.table["speeds"]
    words = [token for token in tokens if isinstance(token, str)]
    if not any(word in speeds for word in words) or " ".join(words) in taught() or words[:1] == ["run"]:
        return 1.0, "", tokens
    factor, manner = 1.0, list[str]()
    rest: list[Token] = []
    for token in tokens:
        if isinstance(token, str) and token in speeds:
            factor *= speeds[token]
            manner.append(token)
            while rest and rest[-1] in known.words("amplifiers"):
                rest.pop()
        else:
            rest.append(token)
    return factor, " ".join(manner), rest


def _relative(sentence: str, amount: Amount | None, joint: str) -> Asks:
    known = vocabulary()
    if change := _CHANGE.fullmatch(sentence):
        return Asks.FASTER if change["faster"] else Asks.SLOWER
    for phrase in known.phrases("amplifiers"):
        sentence = sentence.removesuffix(f" {phrase}").removeprefix(f"{phrase} ")
    for asks in (Asks.FASTER, Asks.SLOWER, Asks.AGAIN):
        if sentence in known.words(asks.value):
            return asks
    if sentence in known.words("continue") and (sentence or amount is not None):
        # "two steps", "one metre" alone are a walk; "for five seconds" is more of what is under way.
        alone = not sentence and amount is not None and amount.quantity in ("steps", "length", "angle")
        return Asks.MOTION if alone and joint != "after" else Asks.CONTINUE
    return Asks.MOTION


def _change(said: str, asks: Asks) -> float:
    """Factor of a relative speed."""
    much, little = " much " in f" {said} ", any(word in said for word in (" bit ", "a bit", "little", "slightly"))
    if asks is Asks.FASTER:
        return 1.6 if much else 1.15 if little else 1.3
    return 0.5 if much else 0.85 if little else 0.7


def _turning(text: str) -> list[str]:
    """A turn to the side that is named; to the right without one, as after half or whole turns it does not matter."""
    side = sides(text)
    return ["turn", "to", "the", min(side) if len(side) == 1 else "right"]


def _shaped(
    words: list[str], amount: Amount | None, times: int, counted: bool
) -> tuple[list[str], Amount | None, str | None]:
    """Words as a listener knows them: verbless requests get their verb, "turn around" its angle.

    Returns:
        Words, amount, and why the request cannot be done (None: no reason).
    """
    known = vocabulary()
    text = " ".join(words)
    quantity = None if amount is None else amount.quantity
    whirls = words[:1] in (["spin"], ["revolve"], ["whirl"])
    spins = whirls or words[:1] in (["rotate"], ["turn"]) and bool({"around", "round"} & set(words))
    if counted and amount is None and spins:
        # "spin around once" is a whole turn
        given = Amount(2 * pi * times, "angle", f"{times} times around")
        return _turning(text), given, None
    if any(text == phrase or text.startswith(phrase + " ") for phrase in known.phrases("around")):
        wanted = amount if quantity in ("angle", "time") else Amount(pi, "angle", "around")
        return _turning(text), wanted, None
    verb = words[0] if words and words[0] in known.verbs else None
    if quantity == "angle" and (verb is None or verb in known.words("walk_verbs") | known.words("turn_verbs")):
        full = amount is not None and abs(amount.value) % pi < 1e-6
        if len(sides(text)) != 1 and not full:
            return words, amount, "turning: to the left or to the right?"
        return _turning(text), amount, None
    direction = [word for word in words if word in known.words("directions")]
    if verb == "back" and quantity in ("steps", "length"):
        words = ["step", *words]
    elif not _has_verb(words) and (amount is not None or text in known.words("directions")):
        start = "step" if quantity == "steps" else "walk"
        words = [start, *(words or ["forward"])]
    elif verb in ("take", "make", "do") and quantity in ("steps", "length"):
        words = ["step", *words[1:]]
    if words[:1] and words[0] in known.words("walk_verbs") and quantity in ("steps", "length") and not direction:
        named = _destinations(words)
        if len(words) == 1 and words[0] not in ("back", "retreat", "reverse"):
            words = [words[0], "forward"]
        elif named and " ".join(words[1:]) == named[0]:
            words = [words[0], "forward", *words[1:]]
    return words, amount, None


def _has_verb(words: list[str]) -> bool:
    """Whether a word is a verb, also in the third person ("the subject advances")."""
    verbs = vocabulary().verbs
    return any({word, word.removesuffix("s"), word.removesuffix("es"), stem(word)} & verbs for word in words)


def _destinations(words: list[str]) -> list[str]:
    """Places that a request of walking names; the robot knows none."""
    known = vocabulary()
    feet = known.words("walk_verbs") | known.words("turn_verbs")
    if not words or words[0] not in feet or words[0] in ("take", "make", "do"):
        return []
    prepositions = sorted(known.words("destinations"), key=lambda phrase: -len(phrase.split()))
    for place in range(1, len(words)):
        for phrase in prepositions:
            length = len(phrase.split())
            if words[place : place + length] != phrase.split():
                continue
            rest = [
                w for w in words[place + length :] if w not in ("the", "a", "an", "my", "your", "that", "this", "of")
            ]
            own = known.words("undestined") | known.words("directions") | known.words("look")
            if rest and not any(word in own for word in rest):
                return [" ".join(words[place:])]
    return []
