"""`asked_change`: requests about the motion that is under way: "faster", "again", "keep going"."""

from __future__ import annotations

import re

from flexmotion.text.amounts import Amount
from flexmotion.text.clause import Asks
from flexmotion.text.vocabulary import vocabulary
from flexmotion.text.wording import stem

_CHANGE = re.compile(
    r"(?:(?:walk|go|move|turn|run|step|be|continue|carry on|go on|keep(?: going| walking| moving| turning| on)?) )?"
    r"(?:a (?:little )?bit |a little |much |even |slightly |some |somewhat )?"
    r"(?:(?P<faster>faster|quicker|brisker|swifter|more (?:quickly|briskly|swiftly|rapidly))"
    r"|(?P<slower>slower|more slowly|less fast))"
)


def asked_change(sentence: str, amount: Amount | None, joint: str) -> Asks:
    """What a request without a motion of its own asks for; MOTION where it is none.

    Args:
        sentence: its words, without amounts.
        amount: how much of it; None: not said.
        joint: what joins it to the one before.
    """
    known = vocabulary()
    shorter = sentence
    for phrase in known.phrases("amplifiers"):
        shorter = shorter.removesuffix(f" {phrase}").removeprefix(f"{phrase} ")
    if change := _CHANGE.fullmatch(sentence) or _CHANGE.fullmatch(shorter):
        return Asks.FASTER if change["faster"] else Asks.SLOWER
    for asks in (Asks.FASTER, Asks.SLOWER, Asks.AGAIN):
        if {sentence, shorter} & known.words(asks.value):
            return asks
    if sentence in known.words("continue") and (sentence or amount is not None):
        # "two steps", "one metre" alone are a walk; "for five seconds" is more of what is under way.
        alone = not sentence and amount is not None and amount.quantity in ("steps", "length", "angle")
        return Asks.MOTION if alone and joint != "after" else Asks.CONTINUE
    return Asks.MOTION


def repeated_motion(sentence: str) -> str | None:
    """The motion that a request names to be done once more ("repeat the turn"); None where it asks for no such thing.

    Args:
        sentence: its words, without amounts.
    """
    known = vocabulary()
    words, said_again = sentence.split(), False
    for phrase in known.phrases("again"):
        if f" {sentence}".endswith(f" {phrase}") and phrase not in known.words("repeat_verbs"):
            words, said_again = words[: len(words) - len(phrase.split())], True
            break
    if words[:1] and words[0] in known.words("repeat_verbs"):
        rest = words[1:]
    else:
        text = f"{' '.join(words)} "
        opening = next((one for one in known.phrases("repeat_openings") if text.startswith(f"{one} ")), None)
        turns = said_again and len(words) == 1 and words[0] in known.words("turn_verbs")
        if turns:
            return words[0]
        if opening is None or not (said_again or opening.endswith("same")):
            return None
        rest = words[len(opening.split()) :]
    while rest and rest[0] in known.words("repeat_words"):
        rest = rest[1:]
    return rest[0] if len(rest) == 1 and stem(rest[0]) in known.verbs else None


def change_factor(said: str, asks: Asks) -> float:
    """Factor of a relative speed."""
    much = any(f" {word} " in f" {said} " for word in ("much", "a lot", "far", "considerably", "a great deal"))
    little = any(word in said for word in (" bit ", "a bit", "little", "slightly"))
    if asks is Asks.FASTER:
        return 1.6 if much else 1.15 if little else 1.3
    return 0.5 if much else 0.85 if little else 0.7
