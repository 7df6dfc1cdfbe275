"""`unused_limb`: a limb that a sentence names for a motion that is made with another one ("kick with your hand")."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache

from flexmotion.text.phrases import limbs, verbs
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary

_OPENING = r"(?:please|now|ok|okay|hey|robot|just|(?:can|could|would|will) you|you should|i want you to)"
_CLOSING = r"(?:down|again|now|please|slowly|robot|to your side)"
_LOWERED = re.compile(
    rf"(?:{_OPENING}[, ]+)*(?:(?P<lowers>lower|drop|relax|(?:put|take|bring|let|get|pull) down) "
    r"|(?:put|take|bring|let|get|pull|move) )?"
    r"(?:(?:your|the|its) )?(?P<side>left|right|other) (?P<arm>hand|arm)"
    rf"(?P<down>(?: back)? (?:down|hang|sink|fall|drop|rest))?(?:[, ]+{_CLOSING})*\W*"
)
"""Words that ask to lower one arm."""

_PLURAL = {"arm": "arms", "leg": "legs", "head": "head"}


def unused_limb(sentence: str, kind: str) -> str | None:
    """The limb, as named, that a kind of motion does not use; None: there is none.

    A limb is named for a motion as its means ("with your left foot") or as what is moved ("wave your foot"). Limbs of
    a place ("at your feet"), of a posture ("with your arms folded") and of somebody else ("my hand") are not.
    """
    used = limbs(kind)
    if used is None:
        return None
    return next((limb for limb in _named(sentence) if _group(limb) not in used), None)


def limb_refusal(sentence: str, kind: str) -> str | None:
    """Why a motion is not made with the limb that a sentence names for it; None where it may be."""
    one = _one_arm().search(sentence.lower())
    if one is not None and kind in vocabulary().words("limb_pairs") and len(sides(sentence)) == 1:
        return f"{verbs(kind)[0]!r} is a motion of both arms, not of {one[0]!r} alone"
    limb = unused_limb(sentence, kind)
    if limb is None:
        return None
    own = " and ".join(_PLURAL[group] for group in sorted(limbs(kind) or ()))
    return f"{verbs(kind)[0]!r} is a motion of the {own}, not of the {limb}"


def lowered_arm(text: str) -> tuple[str, str] | None:
    """The side and the name of the one arm that words ask to lower ("other", "hand"); None where they ask for none."""
    found = _LOWERED.fullmatch(text.lower())
    if found is None or not (found["lowers"] or found["down"]):
        return None
    return found["side"], found["arm"]


def _named(sentence: str) -> Iterator[str]:
    """Limbs that the first motion of a sentence is to be made with, in their order."""
    noun, joint = _patterns()
    known = vocabulary()
    places, means, postures = (known.words(f"limb_{name}") for name in ("places", "means", "postures"))
    regions = tuple(known.table["limb_regions"])
    motion = joint.split(sentence.lower())[0]
    for found in noun.finditer(motion):
        before, after = found["before"] or "", found["after"] or ""
        if before == "of" and motion[: found.start("before")].rstrip().endswith(regions):
            continue
        made_with = before in means or re.search(r"\bby \w+ing$", motion[: found.end("before")]) is not None
        if made_with:
            named = after not in postures and not after.endswith(("ing", "ed"))
        else:
            meanwhile = before.endswith("ing") and found.start("before") > 0  # "walk swinging your arms"
            named = bool(found["owners"]) and before not in places and not meanwhile and after != "of"
        if named:
            yield from (word for word in re.findall(r"\w+", found["limbs"]) if word in _groups())


@lru_cache
def _patterns() -> tuple[re.Pattern[str], re.Pattern[str]]:
    """Limbs with the words around them; what joins another motion to the first."""
    owner = f"(?:{'|'.join(sorted(vocabulary().words('limb_owners')))})"
    one = rf"(?:{owner}\s+)*(?:{'|'.join(_groups())})\b"
    noun = rf"(?:\b(?P<before>(?!{owner}\b)[a-z'’]+)\s+)?\b(?P<limbs>(?P<owners>{owner}\s+)?{one}"
    noun += rf"(?:\s*(?:,|and|or)\s+{one})*)(?=\s+(?P<after>[a-z'’]+)|)"
    return re.compile(noun), re.compile(rf"\b(?:and|or|then|while|but)\b(?!\s+{one})")


@lru_cache
def _one_arm() -> re.Pattern[str]:
    """One hand or arm of a side that is named: "your left arm"."""
    single = [name for name, group in _groups().items() if group == "arm" and not name.endswith("s")]
    return re.compile(rf"\b(?:left|right) (?:{'|'.join(single)})\b")


@lru_cache
def _groups() -> dict[str, str]:
    """Group of each limb."""
    groups: dict[str, list[str]] = vocabulary().table["limb_groups"]
    return {name: group for group, names in groups.items() for name in names}


def _group(limb: str) -> str:
    return _groups()[limb]
