"""`parts_of`: a sentence cut at its joints ("then", "after", "and", commas), in the order in which it is to be done."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from flexmotion.text.amounts import Amount, Token, is_mark
from flexmotion.text.clause import Asks
from flexmotion.text.postures import body_parts
from flexmotion.text.prompt_reader import FORBIDS, FORBIDS_NOTHING, WITHOUT_TURNING
from flexmotion.text.relative import asked_change
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import STAND_IN, begins, opens_by_number, plain, stem, stripped, taught

NEGATES = re.compile(
    r"""\b(?:do|does|did|must|need|should|would|could|may|can|will)\ not\b
    | \b(?:not|never|no|without|neither|nor|none|nobody|cannot|avoid|refrain\ from|stop\ short\ of
        |instead\ of|rather\ than)\b
    | \b(?:do|does|did|ca|wo|must|need|should|would|could|is|are|was)n[^\w\s]?t\b(?:\ you\ dare)?""",
    re.VERBOSE,
)
"""Negations; "stop walking" is none: it asks for standing."""


@dataclass
class Part:
    """Tokens between two joints.

    Attributes:
        joint: what joins it to the part before.
        dropped: words of it that are not done.
        corrects: tokens of a part that it replaces ("turn left, no, right"); None: it replaces none.
        refusal: why it is not done; None: no reason.
    """

    tokens: list[Token]
    joint: str = "then"
    dropped: list[str] = field(default_factory=list)
    corrects: list[Token] | None = None
    refusal: str | None = None


def parts_of(tokens: list[Token]) -> list[Part]:
    """The tokens at every joint, in the order in which the parts are to be done."""
    known = vocabulary()
    then, after, before = known.phrases("then"), known.phrases("after"), known.phrases("before")
    instead = known.phrases("instead")
    together, at_once = known.phrases("together"), known.phrases("at_once")
    parts = [Part([])]
    swap = False  # the part that begins is to be done before the one before it
    place = 0

    def open_part(joint: str) -> None:
        nonlocal swap
        if parts[-1].joint == "before" and parts[-1].tokens:
            parts[-1].joint, swap = "then", True
            parts.append(Part([], joint))
            return
        if swap and len(parts) >= 2 and parts[-1].tokens:
            parts[-2], parts[-1] = parts[-1], parts[-2]
            parts[-2].joint, parts[-1].joint = "after", "then"
            swap = False
        if parts[-1].tokens:
            parts.append(Part([], joint))
        elif joint == "then" or parts[-1].joint == "then":
            parts[-1].joint = "then"

    while place < len(tokens):
        token = tokens[place]
        if (length := _correction(tokens, place)) and (wrong := _last_asked(parts)) is not None:
            parts = [*parts[:wrong], Part([], parts[wrong].joint, corrects=parts[wrong].tokens)]
            place += length
            continue
        if token == "beforehand" and parts[-1].tokens:
            open_part("then")
            swap = True
            place += 1
            continue
        phrase = begins(tokens, place, then)
        # "the next left", "next to you" and "one after another" join nothing.
        beside = tokens[place + 1 : place + 2] == ["to"] or (place and tokens[place - 1] == "the")
        if phrase and (phrase != "next" or (place and not beside)):
            open_part("then")
            place += len(phrase.split())
            continue
        if (phrase := begins(tokens, place, before)) and _names_request(tokens, place + len(phrase.split())):
            # "walk before you wave" is in the order of the words, "before you wave, walk" is not.
            leading = not parts[-1].tokens and len(parts) == 1
            open_part("then")
            parts[-1].joint = "before" if leading else parts[-1].joint
            place += len(phrase.split())
            continue
        # "in five seconds, wave" is "after five seconds wave"
        phrase = "in" if _is_delay(tokens, place, parts[-1].tokens) else begins(tokens, place, after)
        if phrase and parts[-1].tokens and _goes_on(tokens, place, phrase):
            open_part("then")
            place += len(phrase.split())
            continue
        if phrase and _names_request(tokens, place + len(phrase.split())):
            length = len(phrase.split())
            open_part("then")
            if len(parts) == 1:
                # "after five seconds wave", "after waving walk on": in the order of the words.
                parts[-1].joint = "after"
            elif place + length < len(tokens):
                swap = True
            place += length
            continue
        if parts[-1].tokens and (begins(tokens, place, instead) or _excepts(tokens, place)):
            open_part(",")  # "wave instead of walking" asks for the one and forbids the other
        if phrase := begins(tokens, place, at_once):
            parts[-1].dropped.append(phrase)
            place += len(phrase.split())
            continue
        if (phrase := begins(tokens, place, together)) and not (phrase == "while" and not parts[-1].tokens):
            end = _next_joint(tokens, place + len(phrase.split()))
            parts[-1].dropped.append(plain(tokens[place:end]))
            place = end
            continue
        if parts[-1].tokens and _pauses_between(tokens, place):
            end = _next_joint(tokens, place)
            parts[-1].dropped.append(plain(tokens[place:end]))
            place = end
            continue
        if end := _done_beside(tokens, place, parts[-1].tokens):
            parts[-1].dropped.append(plain(tokens[place:end]))
            place = end
            continue
        if token == "while":  # "while walking, wave"
            end = _next_joint(tokens, place + 1)
            parts[-1].dropped.append(plain(tokens[place:end]))
            place = end
            continue
        if is_mark(token):
            if _begins_request(tokens, place + 1, parts[-1].tokens):
                open_part("then" if token in (".", ";", "!", "?") else ",")
            elif asked_change(plain(stripped(parts[-1].tokens)), None, "then") in (Asks.FASTER, Asks.SLOWER):
                end = _next_joint(tokens, place + 1)
                rest = tokens[place + 1 : end]
                if plain(rest) in taught() or plain(stripped(rest)) in taught() or _names_request(rest, 0):
                    open_part(",")  # "slow down, that's enough", "slower, hands up"
                else:  # "hurry up, we are late": the rest asks for nothing
                    parts[-1].dropped += [plain(rest)] if stripped(rest) else []  # "please" is nothing
                    place = end - 1
            place += 1
            continue
        if token == "but" and not parts[-1].tokens:
            parts[-1].joint = "but"
            place += 1
            continue
        if token == "and" and (phrase := begins(tokens, place + 1, at_once)):
            end = place + 1 + len(phrase.split())
            if _begins_request(tokens, end, parts[-1].tokens):  # "walk, and at the same time wave"
                open_part("and")
                parts[-1].dropped.append(phrase)
                place = end
                continue
        if token in ("and", "or", "nor", "but", "plus") and _begins_request(tokens, place + 1, parts[-1].tokens):
            open_part(str(token))
            place += 1
            continue
        waits = parts[-1].joint in ("after", "before") and _names_request(parts[-1].tokens, 0)
        waits = waits and _is_whole(parts[-1].tokens)
        if _runs_on(tokens, place, parts[-1].tokens):
            open_part(",")
        if waits and token not in known.words("directions") and _begins_request(tokens, place, []):
            # "after five seconds wave": no comma tells where the second begins.
            open_part("then")
        parts[-1].tokens.append(token)
        place += 1
    open_part("then")
    found = _first_first([part for part in parts if part.tokens or part.dropped])
    if len(found) == 1 and "both" in found[0].tokens:
        # "wave both hands at the same time"
        found[0].dropped = [words for words in found[0].dropped if words not in at_once]
    return found


def _first_first(parts: list[Part]) -> list[Part]:
    """The parts with "bow, but first wave" and "bow, but wave first" in the order in which they are meant."""
    parts = list(parts)
    for place in range(1, len(parts)):
        words = [token for token in parts[place].tokens if not is_mark(token)]
        leads, ends = words[:1] == ["first"] and parts[place].joint == "but", words[-1:] == ["first"]
        if len(words) > 1 and (leads or ends):
            parts[place].tokens = words[1:] if leads else words[:-1]
            parts[place - 1].joint, parts[place].joint = "then", parts[place - 1].joint
            parts[place - 1 : place + 1] = parts[place], parts[place - 1]
    return parts


def _last_asked(parts: list[Part]) -> int | None:
    """Place of the last part that has tokens."""
    return next((place for place in reversed(range(len(parts))) if parts[place].tokens), None)


def _correction(tokens: list[Token], place: int) -> int:
    """How many tokens say at a place that the part before is not meant ("no wait"); 0: none."""
    known = vocabulary()
    if phrase := begins(tokens, place, known.phrases("sure_corrections")):
        return len(phrase.split())
    alone = (
        place > 0 and is_mark(tokens[place - 1]) and is_mark(tokens[place + 1]) if place + 1 < len(tokens) else False
    )
    return 1 if alone and tokens[place] in known.table["corrections"] else 0


def _excepts(tokens: list[Token], place: int) -> bool:
    """Whether "without waving" begins at a token: the part before is asked for, and waving is forbidden."""
    following = tokens[place + 1] if place + 1 < len(tokens) else ""
    if tokens[place] != "without" or not isinstance(following, str) or not following:
        return False
    said = plain(tokens[place:])
    return WITHOUT_TURNING.match(said) is None and FORBIDS_NOTHING.match(said) is None


def _goes_on(tokens: list[Token], place: int, phrase: str) -> bool:
    """Whether "after" stands for "after that": a joint is in front of it, and a request behind: ", after turn left"."""
    before, end = tokens[place - 1], place + len(phrase.split())
    following = tokens[end] if end < len(tokens) else ""
    known = vocabulary()
    asks = isinstance(following, str) and following in known.verbs - set(known.table["participles"])
    return phrase == "after" and asks and (is_mark(before) or before == "and")


def _pauses_between(tokens: list[Token], place: int) -> bool:
    """Whether a pause between repetitions begins at a token: "with a pause of a second between them"."""
    rest = tokens[place : _next_joint(tokens, place)]
    pauses = vocabulary().words("pauses")
    opens = rest[:1] == ["with"] or (len(rest) > 0 and rest[0] in pauses and stem(str(rest[0])) != rest[0])
    return opens and "between" in rest and any(token in pauses for token in rest)


def _done_beside(tokens: list[Token], place: int, before: list[Token]) -> int:
    """Where what is done beside a motion ends, if it begins at a place ("walk carrying a box to the left"); else 0.

    An amount, a time or a direction behind it belongs to the motion; the direction of a gesture is its own ("walk
    pointing to the left").
    """
    known = vocabulary()
    gesture = begins(tokens, place, known.phrases("gesturing")) is not None and _goes_before(tokens, place)
    moves = any(_moves(one) or (gesture and _is_of_feet(one)) for one in before)  # "90 right nodding"
    if not (gesture or tokens[place] in known.words("doing")) or not moves:
        return 0
    end = _next_joint(tokens, place)
    for index in range(place + 1, end):
        token = tokens[index]
        if gesture:
            ends = _is_of_feet(token) or (isinstance(token, Amount) and token.quantity == "time")
        else:
            named = index + 1 < end and tokens[index + 1] in body_parts()  # "in your left hand"
            ends = isinstance(token, Amount) or (token in known.words("directions") and not named)
        if ends:
            end = index
            while end > place + 1 and tokens[end - 1] in ("for", "to", "the", "by", "your", "toward", "towards"):
                end -= 1
            break
    return end


def _goes_before(tokens: list[Token], place: int) -> bool:
    """Whether who moves is who makes the gesture at a place: "walk on waving", not "walk past the people waving"."""
    known, last = vocabulary(), tokens[place - 1] if place else ""
    if not isinstance(last, str) or is_mark(last):
        return place > 0
    ways = known.words("directions") | known.words("backing") | set(known.table["speeds"]) | {"on", "around", "away"}
    stops = known.words("stop_verbs") & {token for token in tokens[:place] if isinstance(token, str)}
    return not stops and (_moves(last) or last in ways or last.startswith(STAND_IN) or last.endswith("ly"))


def _is_of_feet(token: Token) -> bool:
    """Whether a token is an amount of a walk or a turn."""
    return isinstance(token, Amount) and token.quantity not in ("times", "time")


def _moves(token: Token) -> bool:
    """Whether a word names a motion: "walk", "walking", "a man walks"."""
    known = vocabulary()
    motions = known.words("paths") | known.words("single_motions") | {"stand"}
    return isinstance(token, str) and bool({stem(token), token.removesuffix("s")} & motions)


def _runs_on(tokens: list[Token], place: int, before: list[Token]) -> bool:
    """Whether a request begins without a joint: "walk two steps turn left", "two steps ahead one step back"."""
    known, token = vocabulary(), tokens[place]
    amounts = [one for one in before if isinstance(one, Amount) and one.quantity != "times"]
    if not amounts or not before:
        return False
    last = before[-1]
    closed = isinstance(last, Amount) or last in known.words("directions")
    if isinstance(token, Amount):
        moved = {"steps", "length", "angle"}
        return closed and not isinstance(last, Amount) and token.quantity in moved and amounts[-1].quantity in moved
    # "a 90 degree turn", "a ninety degree left turn" name one.
    said = amounts[-1].said.split()
    noun = said[-1] in known.words("adjectives") and said[0] not in ("one", "1", "a")
    return closed and not noun and isinstance(token, str) and token in known.words("run_on_verbs")


def _is_delay(tokens: list[Token], place: int, before: list[Token]) -> bool:
    """Whether "in five seconds" begins at a token; "two metres in ten seconds" is a speed."""
    following = tokens[place + 1] if place + 1 < len(tokens) else ""
    timed = isinstance(following, Amount) and following.quantity == "time"
    return tokens[place] == "in" and timed and not any(isinstance(token, Amount) for token in before)


def _next_joint(tokens: list[Token], place: int) -> int:
    """Place of the next punctuation mark, or of a phrase that joins; the end without one."""
    then = vocabulary().phrases("then")
    for index in range(place, len(tokens)):
        if is_mark(tokens[index]) or begins(tokens, index, then):
            return index
    return len(tokens)


def _begins_request(tokens: list[Token], place: int, before: list[Token]) -> bool:
    """Whether a request of its own begins at a token, after "and" or a comma.

    Args:
        before: tokens of the part that would end there.
    """
    known = vocabulary()
    rest = tokens[place:]
    while rest and (phrase := begins(rest, 0, known.phrases("fillers") + known.phrases("first"))):
        rest = rest[len(phrase.split()) :]
    rest = stripped(rest[1:]) if opens_by_number(rest) else rest
    own = [token for token in before if token not in known.words("directions")]
    if not rest or (before and not _names_request(own, 0) and not _has_verb(own)):
        return False  # "oh, run along", "left hand, wave", "backward, march": the words before do not ask for anything
    first = rest[0]
    things: dict[str, str] = known.table["things"]
    if isinstance(first, Amount):
        # "two steps forward and one step back", "two waves and three bows"; not "wave for ten seconds, twice".
        counted = bool(rest[1:2]) and rest[1] in things
        counted = counted or bool(known.words("further") & set(first.said.split()))  # "wave twice, and one more"
        return counted or (first.quantity != "times" and any(isinstance(token, Amount) for token in before))
    if not isinstance(first, str):
        return False
    if NEGATES.match(first):
        return FORBIDS_NOTHING.match(plain(rest)) is None  # "no rush"
    if FORBIDS.match(first) or begins(rest, 0, known.phrases("faster") + known.phrases("slower")):
        return True
    if begins(rest, 0, tuple(p for p in known.phrases("again") if p not in ("again", "once again", "once more"))):
        return True
    if place > 0 and tokens[place - 1] == "and" and before[-1:] != ["again"]:
        last = plain(stripped(tokens[place : _next_joint(tokens, place)]))
        if last in known.words("again"):
            return True  # "bow, and again"; "bow again" and "bow, once more" are one request
    if first in known.words("directions"):
        # "walk forward and back" is two walks.
        back = known.words("backward")
        opposite = len(rest) == 1 and (first in back) != bool(back & {t for t in before if isinstance(t, str)})
        there = any(token in known.words("onward") for token in before) if first in back else opposite
        ways = opposite and there and first not in ("left", "right", "sideways")
        return ways or any(isinstance(token, Amount) for token in [*rest[1:3], *before])
    if first in ("a", "one", "another") and rest[1:2] and rest[1] in [thing.split()[-1] for thing in things.values()]:
        return True
    started = tokens[place] in ("start", "begin") and stem(first) in known.verbs  # "bow and start walking"
    return started or first in known.verbs  # "…, facing me" belongs to what is before it


def _has_verb(tokens: list[Token]) -> bool:
    """Whether a word is a verb, wherever it stands: "action run forward", "you go back"."""
    verbs = vocabulary().verbs
    return any(isinstance(token, str) and stem(token) in verbs for token in tokens)


def _is_whole(tokens: list[Token]) -> bool:
    """Whether a part needs no more words: "five seconds", "waving"; "taken" does."""
    last = tokens[-1]
    if isinstance(last, str):
        return len(tokens) == 1 and stem(last) != last and last not in vocabulary().table["participles"]
    return isinstance(last, Amount)


def _names_request(tokens: list[Token], place: int) -> bool:
    """Whether the words from a place on are a request, or name one: a verb, an amount, a direction, "you wave"."""
    known = vocabulary()
    rest = stripped([token for token in tokens[place:] if not is_mark(token)])
    if phrase := begins(rest, 0, known.phrases("instead")):
        rest = rest[len(phrase.split()) :]
    if rest and rest[0] in ("you", "have", "having", "you've"):
        rest = rest[1:] if rest[0] != "you" or rest[1:2] != ["have"] else rest[2:]
    if not rest:
        return False
    first = rest[0]
    if not isinstance(first, str):
        return True
    words = known.verbs | known.words("directions")
    past = {first.removesuffix("ed"), first.removesuffix("d"), first.removesuffix("ed") + "e"}
    said = {token for token in rest if isinstance(token, str)}
    return (
        stem(first) in words
        or bool(said & known.words("limbs") and said & known.words("posed"))
        or bool(past & known.verbs)
        or FORBIDS.match(first) is not None
        or begins(rest, 0, known.phrases("faster") + known.phrases("slower") + known.phrases("again")) is not None
    )
