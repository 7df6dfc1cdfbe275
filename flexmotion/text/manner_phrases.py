"""`manner_phrases`: the words of a sentence that say how a motion is to be done, and the manner listed for them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

from flexmotion.text import manners
from flexmotion.text.vocabulary import vocabulary

_FOR = r"for\s+(?:\d|an?|one|two|three|four|five|six|seven|eight|nine|ten|some|half)"
_ENDS = "and|then|while|until|for|twice|once|again|please|with|to|towards?|across|down|into|through"
_JOINT = rf"(?=\s*(?:$|[,.;!?]|\b(?:{_ENDS})\b))"

_NOUNS = "|".join(sorted(map(re.escape, manners.manner_nouns()), key=lambda noun: -len(noun)))

_OPEN = re.compile(
    rf"""\b(?P<like>(?:(?:just\s|exactly\s)?like|as(?=\san?\s))\s(?!to\b|you\s(?:to|facing|wave|being)\b)[^,.;!?]+?){_JOINT}
    | \b(?P<unlike>unlike\s[^,.;!?]+?){_JOINT}
    | \b(?P<if>as\s(?:if|though)\s[^,.;!?]+?)(?=\s*(?:$|[,.;!?]|\b(?:and|then|while|twice|once|{_FOR})\b))
    | \b(?P<way>in\san?\s(?:[\w'-]+\s){{1,3}}(?:way|manner|fashion|style|mood|mode))\b
    | \b(?P<noun>(?:with|in|full\sof)\s(?:(?:an?|the|of|[\w'-]+)\s){{0,3}}?(?:{_NOUNS}))\b
    | \b(?P<adverb>\w+ly)\b""",
    re.VERBOSE,
)
"""Phrases that may say a manner, whichever their words are."""

_LIKING = re.compile(r"(?:'d|’d|\b(?:would|i|you|we|do|does|don't|did|to|looks?|sounds?|tastes?|feels?|smells?))\s$")
"""Words before "like" that make it a verb, or a comparison of something else than a motion."""

_ARTICLES = r"an?|the|my|your|his|her|our|their|this|that|some"
_HEAD = re.compile(rf"(?:(?:just|exactly) )?(?:like|as) (?:(?:{_ARTICLES}) )*[\w'-]+")
"""The first words of a comparison, which say a manner whatever they are: "like a ninety"."""
_RELATES = re.compile(r"\b(?:who|whose|that|which|you|he|she|it|they|is|was|has|had|have)\b")
"""From here on a comparison is a sentence of its own, in which no word tells that it ends."""
_HOLDS_ON = re.compile(rf"\b(?:{_ARTICLES}|of|like|as)\s*$")
"""Words behind which none begins what is asked for beside the manner: "a child of five"."""

_ENDS_ITSELF = re.compile(r"\bof \w+$|\b(?:no|nothing|little|any|some) (?:\w+ )?left$")
"""Last words that end a comparison although others like them ask for something: "a child of five"."""

_STOPS = re.compile(
    r"\b(?:stop\w*|halt\w*|freez\w*|frozen|still|emergency|safe\w*|stand\w*|rest\w*|wait\w*|paus\w*|quit\w*)\b"
)
"""Words that may mean the end of a motion: a sentence with one of them never goes on in another manner."""
_BESIDE = frozenset(["now", "please", "and", "but", "then", "robot", "ok", "okay", "instead"])
"""Words that ask for nothing beside a manner of what is under way."""


_SUBJECT = re.compile(r"\s*(?:an?|the|this|that)?\s*(\w+(?: (?:man|woman|lady|person))?)\b")
"""Who does it, at the beginning of a sentence."""


@dataclass(frozen=True)
class MannerPhrase:
    """Words that say how a motion is to be done.

    Attributes:
        text: the words, in lower case.
        manner: that they are known to mean; None: they are not known.
        start, end: place in the sentence.
        doubtful: whether words of it may ask for something beside the manner, or deny it: nobody may guess its manner.
        cut: whether another request may begin right behind it, without a comma.
    """

    text: str
    manner: str | None
    start: int
    end: int
    doubtful: bool = False
    cut: bool = False


@lru_cache(maxsize=256)
def manner_phrases(sentence: str) -> tuple[MannerPhrase, ...]:
    """Every phrase of a sentence that says a manner, in order; words that ask for no manner ("politely") are none."""
    text = sentence.lower().replace("’", "'")
    known, lexicon = _lexicon()
    found: list[MannerPhrase] = []
    subject = _SUBJECT.match(text)
    if subject and (manner := _subjects().get(subject[1])):
        found.append(MannerPhrase(subject[1], manner, subject.start(1), subject.end(1)))
    for match in known.finditer(text):
        found.append(MannerPhrase(match[0], lexicon[match[0]], match.start(), match.end()))
    for match in _OPEN.finditer(text):
        if match["like"] and _LIKING.search(text[: match.start()]):
            continue
        if match[0].startswith("as ") and match["like"] and _purpose().match(match[0]):
            continue  # "as a greeting"
        start, end = match.span()
        cut = False
        if match["like"] or match["if"]:
            end, cut = _end(text, start, end, [one for one in found if start <= one.start and one.end <= end])
        over = [one for one in found if start < one.end and one.start < end]
        said = text[start:end].strip()
        doubtful = bool(match["unlike"]) or (bool(match["like"] or match["if"]) and _ends_otherwise(said, over))
        if not over:
            found.append(MannerPhrase(said, lexicon.get(said), start, end, doubtful, cut))
        elif all(start <= one.start and one.end <= end for one in over):
            # "as if you were drunk": the listed word tells what the whole phrase means.
            found = [one for one in found if one not in over]
            manner = None if doubtful else over[0].manner
            found.append(MannerPhrase(said, manner, start, end, doubtful, cut))
    asking = (one for one in found if one.text not in manners.neutral_words() and one.manner != manners.NORMAL)
    return tuple(sorted(asking, key=lambda one: one.start))


def manner_alone(sentence: str) -> str | None:
    """The words that say a manner, in a sentence that says nothing else ("now like an old man"); None for others."""
    phrases = manner_phrases(sentence)
    if not phrases or not all(" " in phrase.text or phrase.text.endswith("ly") for phrase in phrases):
        return None  # "sneak" asks for a motion
    if _STOPS.search(sentence.lower()):
        return None  # "like a man who stops"
    rest = [word for word in re.findall(r"[\w']+", without_phrases(sentence, phrases).lower()) if word not in _BESIDE]
    goes_on = not rest or " ".join(rest) in vocabulary().words("continue")
    return " ".join(phrase.text for phrase in phrases) if goes_on else None


def without_phrases(sentence: str, phrases: tuple[MannerPhrase, ...]) -> str:
    """The sentence without some of its phrases."""
    for phrase in sorted(phrases, key=lambda one: -one.start):
        sentence = f"{sentence[: phrase.start]} {sentence[phrase.end :]}"
    return " ".join(sentence.split())


def _end(text: str, start: int, end: int, known: list[MannerPhrase]) -> tuple[int, bool]:
    """Where a comparison ends, in front of the first word that asks for something else; whether a request may be that.

    Args:
        text: the sentence.
        start, end: of the comparison with all words up to the next joint.
        known: listed phrases in it.
    """
    head = _HEAD.match(text, start, end)
    listed = max((one.end for one in known if one.start == start), default=start)
    first = max(listed, head.end() if head else start)
    for match in _asking().finditer(text, first, end):
        # "like someone who is tired": behind its listed words.
        relative = None if head is None else _RELATES.search(text, max(head.end(), listed), match.start())
        begins = relative.end() if relative else first
        whole = head is not None and relative is None
        clear = whole or any(begins <= one.end <= match.start() for one in known)
        if clear and not _HOLDS_ON.search(text[start : match.start()]):
            return len(text[: match.start()].rstrip()), match["request"] is not None
    return end, False


def _ends_otherwise(said: str, known: list[MannerPhrase]) -> bool:
    """Whether a phrase ends with words, not listed with it, that may ask for something else: "as if you fell back"."""
    last = max(_asking().finditer(said), key=lambda match: match.end(), default=None)
    if last is None or last.end() < len(said) or any(one.text.endswith(last[0]) for one in known):
        return False
    return _ENDS_ITSELF.search(said) is None


@lru_cache
def _purpose() -> re.Pattern[str]:
    """What a motion is meant as: it says no manner."""
    return re.compile(rf"as an? (?:[\w'-]+ )?(?:{_any(manners.purposes())})\b")


@lru_cache
def _asking() -> re.Pattern[str]:
    """What is asked for beside a manner: an amount, a direction, a speed, a prohibition, another motion."""
    known = vocabulary()
    table = known.table
    units = _any(unit for names in table["units"].values() for unit in names)
    counts = [word for name in ("numbers", "fractions", "counts", "multiples") for word in table[name]]
    numbers = rf"\d[\d.,]*\w*|{_any(counts)}|an? (?:{units}|few|couple|bit|little|lot)|several"
    amount = rf"(?:(?:about|by|at|in|within|around|at least|at most) )*(?:{numbers})"
    speed = rf"(?:{_any(known.words('faster') | known.words('slower') | known.words('speeds'))}|\w+ly(?=\s*$))"
    speed = rf"(?:(?:{_any([*known.phrases('amplifiers'), 'more', 'less', 'so', 'too'])}) )*{speed}"
    pace = rf"at an? (?:{_any(table['rates'])})|{_any(known.phrases('flat_out'))}"
    verbs = known.words("single_motions")
    moves = [form for verb in verbs for form in (verb, f"{verb}ing", f"{verb.removesuffix('e')}ing")]
    denied = r"not|never|no|without|nor|neither|don't|do not|but|or|before|after|instead|except|rather than"
    request = rf"{denied}|{_any([*moves, *known.words('run_on_verbs'), *known.words('stop_verbs')])}"
    curve = r"in an? (?:\w+ )?(?:turn|curve|arc)"
    limb = rf"(?:(?:your|both|the) )*(?:{_any(known.words('limbs'))})"
    other = [
        *(word for name in ("directions", "destinations", "conditions") for word in known.words(name)),
        *(word for name in ("in_place", "impossible", "little") for word in known.phrases(name)),
        *(f"in {shape}" for shape in known.phrases("shapes")),
        *("now", "again", "clockwise", "counterclockwise", "anticlockwise", "every", "each"),
    ]
    other_words = rf"{amount}|{curve}|{limb}|{_any(other)}"
    alone = r"(?!left (?:alone|behind|out|over))"  # "a man left alone" goes nowhere
    words = rf"{pace}|{speed}|(?P<request>{request})|{other_words}"
    return re.compile(rf"(?<![\w'-]){alone}(?:{words})(?![\w'-])")


def _any(words: Iterable[str]) -> str:
    """A pattern of any of some words, the longest first."""
    return "|".join(sorted(map(re.escape, words), key=lambda word: (-len(word), word)))


@lru_cache
def _lexicon() -> tuple[re.Pattern[str], dict[str, str]]:
    """A pattern of all known phrases, the longest first, and their manners."""
    lexicon = {
        said.lower(): manner
        for manner in manners.manners()
        for said in (
            *manners.manner_wordings(manner),
            *manners.manner_sayings(manner),
            *manners.manner_words(manner),
            *(f"like {'an' if who[0] in 'aeiou' else 'a'} {who}" for who in manners.manner_subjects(manner)),
        )
    }
    lexicon |= {
        f"as {said.removeprefix('like ')}": manner
        for said, manner in lexicon.items()
        if said[:7] in ("like a ", "like an")
    }
    longest = sorted(lexicon, key=lambda said: (-len(said), said))
    return re.compile(r"(?<![\w'-])(?:" + "|".join(map(re.escape, longest)) + r")(?![\w'-])"), lexicon


@lru_cache
def _subjects() -> dict[str, str]:
    return {said: manner for manner in manners.manners() for said in manners.manner_subjects(manner)}
