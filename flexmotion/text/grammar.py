"""`parse`: a sentence to the requests in it, in their order, each with its amount; before any model hears it.

The grammar separates what a listener cannot: several requests in one sentence, how much of each, requests about the
motion that is under way ("faster", "again"), and looking, for which there is no motion. The words of each request are
left to the listener. A sentence in which the grammar finds nothing is one request with the words as given.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache
from math import pi

from flexmotion.text.amounts import Amount, Bare, Token, is_mark, tokens_of
from flexmotion.text.phrases import STAND
from flexmotion.text.prompt_reader import FORBIDS, FORBIDS_NOTHING, WITHOUT_TURNING
from flexmotion.text.sayings import sayings
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary

_NEGATES = re.compile(
    r"""\b(?:not|never|no|without|neither|nor|none|nobody|cannot|avoid|refrain\ from|stop\ short\ of)\b
    | \b(?:do|does|did|ca|wo|must|need|should|would|could|is|are|was)n[^\w\s]?t\b(?:\ you\ dare)?""",
    re.VERBOSE,
)
"""Negations; "stop walking" is none: it asks for standing."""

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
    joint: str = "then"


@dataclass
class _Part:
    """Tokens between two joints, and how it is joined to the part before."""

    tokens: list[Token]
    joint: str = "then"
    dropped: list[str] = field(default_factory=list)


def parse(sentence: str) -> tuple[Clause, ...]:
    """The requests of a sentence, at least one, in the order in which they are to be done."""
    tokens = tokens_of(sentence)
    words = _plain(tokens)
    kind = _taught().get(words)
    if kind == STAND:
        return (Clause(sentence, sentence),)  # "look out", "never mind the walking, quit it"
    parts = [_Part(tokens)] if kind is not None else _parts(tokens)
    clauses: list[Clause] = []
    forbidding = False
    for number, part in enumerate(parts):
        # "don't walk or wave" and "don't walk, turn or wave" forbid all; "don't walk, wave" and "don't walk then wave"
        # only the first.
        joint = next((later.joint for later in parts[number:] if later.joint != ","), "then")
        forbidding = forbidding and (part.joint == "and" or joint in ("or", "nor"))
        clause = _clause(part, forbidding)
        if clause is None:
            continue
        forbidding = clause.forbidden
        clauses.append(replace(clause, joint=part.joint if clauses else ","))
    if not clauses:
        return (Clause(sentence, sentence),)
    if len(clauses) == 1 and clauses[0].said == words and _is_plain(clauses[0]):
        # The listener gets the sentence as it was given.
        return (replace(clauses[0], said=sentence, text=sentence),)
    return tuple(clauses)


def _is_plain(clause: Clause) -> bool:
    """Whether the grammar has nothing to add to what a listener hears in the whole sentence."""
    return clause.asks is Asks.MOTION and clause.amount is None and clause.speed == 1.0 and not clause.counted


def whole(sentence: str) -> Clause | None:
    """The sentence as one request, joints or not; None where it asks for nothing."""
    tokens = tokens_of(sentence)
    clause = _clause(_Part(tokens), False)
    if clause is not None and _is_plain(clause) and not clause.dropped:
        return replace(clause, said=sentence, text=sentence)
    return clause


@lru_cache
def _taught() -> dict[str, str]:
    """Kind of motion by taught sentence."""
    return {_plain(tokens_of(sentence)): kind for kind, sentence in sayings()}


@lru_cache
def _taught_words() -> frozenset[str]:
    """Words of the taught sentences."""
    return frozenset(word for sentence in _taught() for word in sentence.split())


def _plain(tokens: list[Token]) -> str:
    return " ".join(_said(token) for token in tokens if not is_mark(token))


def _said(token: Token) -> str:
    return token if isinstance(token, str) else token.said


# ---------------------------------------------------------------- from a sentence to its parts


def _parts(tokens: list[Token]) -> list[_Part]:
    """The tokens at every joint, in the order in which the parts are to be done."""
    known = vocabulary()
    then, after, before = known.phrases("then"), known.phrases("after"), known.phrases("before")
    together, at_once = known.phrases("together"), known.phrases("at_once")
    parts = [_Part([])]
    swap = False  # the part that begins is to be done before the one before it
    place = 0

    def open_part(joint: str) -> None:
        nonlocal swap
        if parts[-1].joint == "before" and parts[-1].tokens:
            parts[-1].joint, swap = "then", True
            parts.append(_Part([], joint))
            return
        if swap and len(parts) >= 2 and parts[-1].tokens:
            parts[-2], parts[-1] = parts[-1], parts[-2]
            parts[-2].joint, parts[-1].joint = "after", "then"
            swap = False
        if parts[-1].tokens:
            parts.append(_Part([], joint))
        elif joint == "then" or parts[-1].joint == "then":
            parts[-1].joint = "then"

    while place < len(tokens):
        token = tokens[place]
        phrase = _begins(tokens, place, then)
        # "the next left" and "one after another" join nothing.
        if phrase and (phrase != "next" or (place and tokens[place - 1] != "the")):
            open_part("then")
            place += len(phrase.split())
            continue
        if (phrase := _begins(tokens, place, before)) and _names_request(tokens, place + len(phrase.split())):
            # "walk before you wave" is in the order of the words, "before you wave, walk" is not.
            leading = not parts[-1].tokens and len(parts) == 1
            open_part("then")
            parts[-1].joint = "before" if leading else parts[-1].joint
            place += len(phrase.split())
            continue
        if (phrase := _begins(tokens, place, after)) and _names_request(tokens, place + len(phrase.split())):
            length = len(phrase.split())
            open_part("then")
            if len(parts) == 1:
                # "after five seconds wave", "after waving walk on": in the order of the words.
                parts[-1].joint = "after"
            elif place + length < len(tokens):
                swap = True
            place += length
            continue
        if phrase := _begins(tokens, place, at_once):
            parts[-1].dropped.append(phrase)
            place += len(phrase.split())
            continue
        if (phrase := _begins(tokens, place, together)) and not (phrase == "while" and not parts[-1].tokens):
            end = _next_joint(tokens, place + len(phrase.split()))
            parts[-1].dropped.append(_plain(tokens[place:end]))
            place = end
            continue
        if token == "while":  # "while walking, wave"
            end = _next_joint(tokens, place + 1)
            parts[-1].dropped.append(_plain(tokens[place:end]))
            place = end
            continue
        if is_mark(token):
            if _begins_request(tokens, place + 1, parts[-1].tokens):
                open_part("then" if token in (".", ";", "!", "?") else ",")
            place += 1
            continue
        if token in ("and", "or", "nor", "but", "plus") and _begins_request(tokens, place + 1, parts[-1].tokens):
            open_part(str(token))
            place += 1
            continue
        waits = parts[-1].joint in ("after", "before") and _names_request(parts[-1].tokens, 0)
        if waits and _begins_request(tokens, place, []):
            # "after five seconds wave": no comma tells where the second begins.
            open_part("then")
        parts[-1].tokens.append(token)
        place += 1
    open_part("then")
    return [part for part in parts if part.tokens or part.dropped]


def _begins(tokens: list[Token], place: int, phrases: tuple[str, ...]) -> str | None:
    """The phrase that begins at a token; the longest one."""
    for phrase in phrases:
        words = phrase.split()
        if words and tokens[place : place + len(words)] == words:
            return phrase
    return None


def _next_joint(tokens: list[Token], place: int) -> int:
    """Place of the next punctuation mark, or of a phrase that joins; the end without one."""
    then = vocabulary().phrases("then")
    for index in range(place, len(tokens)):
        if is_mark(tokens[index]) or _begins(tokens, index, then):
            return index
    return len(tokens)


def _begins_request(tokens: list[Token], place: int, before: list[Token]) -> bool:
    """Whether a request of its own begins at a token, after "and" or a comma.

    Args:
        before: tokens of the part that would end there.
    """
    known = vocabulary()
    rest = tokens[place:]
    while rest and (phrase := _begins(rest, 0, known.phrases("fillers"))):
        rest = rest[len(phrase.split()) :]
    own = [token for token in before if token not in known.words("directions")]
    if not rest or (before and not _names_request(own, 0)):
        return False  # "oh, run along", "left hand, wave", "backward, march": what comes before is no request
    first = rest[0]
    if isinstance(first, Amount):
        # "two steps forward and one step back"; not "wave for ten seconds, twice".
        return first.quantity != "times" and any(isinstance(token, Amount) for token in before)
    if not isinstance(first, str):
        return False
    if _NEGATES.match(first):
        return FORBIDS_NOTHING.match(_plain(rest)) is None  # "no rush"
    if FORBIDS.match(first) or _begins(rest, 0, known.phrases("faster") + known.phrases("slower")):
        return True
    if _begins(rest, 0, tuple(p for p in known.phrases("again") if p not in ("again", "once again", "once more"))):
        return True
    if first in known.words("directions"):
        return any(isinstance(token, Amount) for token in [*rest[1:3], *before])
    things = [thing.split()[-1] for thing in known.table["things"].values()]
    if first in ("a", "another") and rest[1:2] and rest[1] in things:
        return True
    return first in known.verbs  # "…, facing me" belongs to what is before it


def _names_request(tokens: list[Token], place: int) -> bool:
    """Whether the words from a place on are a request, or name one: a verb, an amount, a direction, "you wave"."""
    known = vocabulary()
    rest = _stripped([token for token in tokens[place:] if not is_mark(token)])
    if rest and rest[0] in ("you", "have", "having", "you've"):
        rest = rest[1:] if rest[0] != "you" or rest[1:2] != ["have"] else rest[2:]
    if not rest:
        return False
    first = rest[0]
    if not isinstance(first, str):
        return True
    words = known.verbs | known.words("directions")
    past = {first.removesuffix("ed"), first.removesuffix("d"), first.removesuffix("ed") + "e"}
    return (
        _stem(first) in words
        or bool(past & known.verbs)
        or FORBIDS.match(first) is not None
        or _begins(rest, 0, known.phrases("faster") + known.phrases("slower") + known.phrases("again")) is not None
    )


def _stem(word: str) -> str:
    """A verb without "-ing": "waving" -> "wave"; the word itself where none fits."""
    verbs = vocabulary().verbs
    if not word.endswith("ing") or len(word) < 6:
        return word
    root = word[:-3]
    tries = (root, root + "e", root[:-1] if root[-1:] == root[-2:-1] else root)
    return next((found for found in tries if found in verbs), word)


# ---------------------------------------------------------------- from a part to a clause


def _clause(part: _Part, forbidding: bool) -> Clause | None:
    """The request of one part; None where it asks for nothing."""
    known = vocabulary()
    tokens = [token for token in part.tokens if not is_mark(token)]
    said = _plain(tokens)
    dropped, notes = list(part.dropped), list[str]()
    tokens = _stripped(tokens)
    words = [token for token in tokens if isinstance(token, str)]
    sentence = " ".join(words)
    rest = FORBIDS_NOTHING.sub(" ", sentence)
    rest = rest if words[:1] and words[0] in known.words("turn_verbs") else WITHOUT_TURNING.sub(" ", rest)
    if forbidding or _NEGATES.search(rest):
        rest = _plain(_stripped([*_NEGATES.sub(" ", sentence).split()]))
        return Clause(said, rest, forbidden=True, dropped=tuple(dropped))
    plain_stop = _taught().get(_plain(tokens)) == STAND
    if (refusal := _refusal(words)) is not None:
        return Clause(said, sentence, refusal=refusal, dropped=tuple(dropped))
    if not tokens:
        return Clause(said, "", dropped=tuple(dropped), refusal="nothing else is asked for") if dropped else None
    if words and not any(word in _taught_words() or word in known.verbs for word in words):
        asked = _relative(" ".join(words), None, part.joint) is Asks.MOTION
        if asked and not set(words) <= known.words("directions") | known.words("hedges"):
            return Clause(said, sentence, refusal=NO_KNOWN_WORD)
    condition = _condition(words)
    if condition is not None and not plain_stop:
        dropped += [condition] if condition not in known.words("allowed_conditions") else []
        tokens = _without_tail(tokens, condition.split()[0])
    uncountable = next((t for t in tokens if isinstance(t, Amount) and not _is_count(t)), None)
    if uncountable is not None:
        return Clause(said, sentence, refusal=f"{uncountable.said!r} is no number of times")
    amount, times, counted, tokens, extra = _amounts(tokens)
    dropped += extra
    if amount is not None and amount.rough:
        notes.append(f"{amount.said!r} is taken as {amount}")
    sentence = _plain(tokens)
    if any(isinstance(token, Bare) or token.isdigit() for token in tokens if not isinstance(token, Amount)):
        return Clause(said, sentence, refusal="a number without a unit that is known")
    asks = _relative(sentence, amount, part.joint)
    if asks is not Asks.MOTION:
        factor = _change(said, asks) if asks in (Asks.FASTER, Asks.SLOWER) else 1.0
        return Clause(said, "", asks, amount, times, counted, factor, dropped=tuple(dropped), notes=tuple(notes))
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
        said, text, Asks.MOTION, amount, times, counted, speed, False, refusal, tuple(dropped), tuple(notes), manner
    )


def _is_count(amount: Amount) -> bool:
    """Whether an amount of times is a whole number from 1 on; other amounts always are fine."""
    return amount.quantity != "times" or (amount.value >= 1 and amount.value == int(amount.value))


def _stripped(tokens: list[Token]) -> list[Token]:
    """Without fillers at both ends."""
    fillers = vocabulary().phrases("fillers")
    changed = True
    while changed and tokens:
        changed = False
        for phrase in fillers:
            words = phrase.split()
            if tokens[: len(words)] == words and len(tokens) > 0:
                tokens, changed = tokens[len(words) :], True
            if tokens and tokens[-len(words) :] == words:
                tokens, changed = tokens[: -len(words)], True
    first = vocabulary().phrases("first")
    while tokens and (opening := _begins(tokens, 0, first)):
        tokens = tokens[len(opening.split()) :]
    if tokens and isinstance(tokens[0], str):
        tokens = [_stem(tokens[0]), *tokens[1:]]
    return tokens


def _refusal(words: list[str]) -> str | None:
    """Why the words alone tell that a request cannot be done; None where they do not."""
    known = vocabulary()
    verb = next((word for word in words if word in known.verbs), None)
    if verb in known.words("look") or (words and words[0] in known.words("look")):
        return "looking: this model has no motion of the head or the eyes"
    owners = ("your", "the", "its", "my", "his", "her")
    named = any(
        word in known.words("head") and place and words[place - 1] in owners for place, word in enumerate(words)
    )
    if named and verb in ("turn", "move", "tilt", "shake", "rotate", "swivel", "nod", "twist", "roll", "close", "open"):
        return "moving the head: this model has no motion of the head or the eyes"
    text = f" {' '.join(words)} "
    if " where " in text and verb in known.words("walk_verbs") | known.words("turn_verbs"):
        return "a place: the robot knows none"
    for phrase in known.phrases("impossible"):
        if f" {phrase} " in text:
            return f"{phrase!r}: no model and no robot of this project does that"
    return None


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


def _speed(tokens: list[Token]) -> tuple[float, str, list[Token]]:
    """The factor that adverbs put on the speed, these adverbs, and the tokens without them."""
    known = vocabulary()
    speeds: dict[str, float] = known.table["speeds"]
    words = [token for token in tokens if isinstance(token, str)]
    if not any(word in speeds for word in words) or " ".join(words) in _taught() or words[:1] == ["run"]:
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
    spins = words[:1] in (["spin"], ["rotate"], ["turn"], ["revolve"]) and {"around", "round"} & set(words)
    if counted and amount is None and spins:
        side = sides(text)  # "spin around once" is a whole turn
        given = Amount(2 * pi * times, "angle", f"{times} times around")
        return ["turn", *(["to", "the", min(side)] if len(side) == 1 else ["around"])], given, None
    if any(text == phrase or text.startswith(phrase + " ") for phrase in known.phrases("around")):
        side = sides(text)
        wanted = amount if quantity in ("angle", "time") else Amount(pi, "angle", "around")
        return ["turn", *(["to", "the", min(side)] if len(side) == 1 else ["around"])], wanted, None
    verb = words[0] if words and words[0] in known.verbs else None
    if quantity == "angle" and (verb is None or verb in known.words("walk_verbs") | known.words("turn_verbs")):
        side = sides(text)
        full = amount is not None and abs(amount.value) % pi < 1e-6
        if len(side) != 1 and not full:
            return words, amount, "turning: to the left or to the right?"
        return ["turn", *(["to", "the", min(side)] if len(side) == 1 else ["around"])], amount, None
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
    return any({word, word.removesuffix("s"), word.removesuffix("es"), _stem(word)} & verbs for word in words)


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
