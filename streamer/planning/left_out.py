"""`left_out`: parts that a motion would move while a target of their own holds them."""

from __future__ import annotations

from collections.abc import Iterable

from flexmotion.text.phrases import limbs, seen_parts
from flexmotion.text.sides import sides
from flexmotion.text.vocabulary import vocabulary

_GROUPS = {"left_arm": "arm", "right_arm": "arm", "head": "head"}
"""What `phrases.yaml` calls the limbs of `tension.LIMBS`."""


def left_out(kind: str, held: Iterable[tuple[str, str]]) -> tuple[list[str], list[str]]:
    """Parts that do not take part in a motion.

    Args:
        kind: of motion; one that may move any limb leaves none out.
        held: limbs (of `tension.LIMBS`) and the names of the parts that hold them, as `Relax` takes them.

    Returns:
        The parts without which the motion is not made whole; those that it may have done without: a kind that names no
        side ("bye") is made with either arm.
    """
    seen, named = seen_parts(kind), sides(kind)
    if limbs(kind) is None or "leg" in seen:  # a crouch is named for the head too, and made without it
        return [], []
    missing, perhaps = list[str](), list[str]()
    for limb, part in held:
        group = _GROUPS[limb]
        if group not in seen or (group == "arm" and len(named) == 1 and not named & sides(limb.replace("_", " "))):
            continue
        known = group == "head" or len(named) == 1 or kind in vocabulary().words("limb_pairs")
        (missing if known else perhaps).append(part)
    return missing, perhaps
