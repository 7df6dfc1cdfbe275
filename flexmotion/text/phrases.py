"""Wordings of kinds of motion: captions for clips that have only labels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import yaml_content
from flexmotion.text.sides import mirrored, sides

STAND, WALK, BACK = "stand", "walk", "walk-back"
"""Kinds of motion: without a request; at a velocity without words, forward or sideways; at one backward."""
TURNS = "walk-turn-left", "walk-turn-right"
"""Kinds of motion at a velocity that turns on the spot, to the left and to the right."""
BOTH_UP = "raise-up-both-hands"
"""Kind of motion in which one arm may be lowered and the other stays up."""


@lru_cache
def _table() -> Mapping[str, Any]:
    text = resources.files("flexmotion").joinpath("data", "phrases.yaml").read_text(encoding="utf-8")
    rows: dict[str, Any] = yaml_content(text)["kinds"]
    table: dict[str, Any] = {}
    for kind, row in rows.items():
        table[kind] = row
        if (image := mirrored(kind)) not in rows:
            table[image] = _image(row)
    return table


def _image(row: Mapping[str, Any]) -> dict[str, Any]:
    """The row of a mirrored kind: wordings that name a side, mirrored; the others mean the kind as it is."""
    said = [mirrored(text) for text in _made(row) if sides(text)]
    patterns = [mirrored(pattern) for pattern in row.get("captions", ())]
    return {**row, "verbs": row["verbs"], "endings": [], "more": said, "captions": patterns}


def _made(row: Mapping[str, Any]) -> list[str]:
    return [*(f"{verb} {ending}".strip() for verb in row["verbs"] for ending in row["endings"]), *row["more"]]


@lru_cache
def kinds() -> tuple[str, ...]:
    """Labels that have wordings."""
    return tuple(_table())


def check_kinds(names: Iterable[str], origin: Path | str) -> None:
    """Refuse names that are no kinds of motion.

    Args:
        names: of a mapping by kind.
        origin: file and field of the mapping, for messages.

    Raises:
        ConfigError: there is none of such a name; it names the nearest ones.
    """
    known = (*kinds(), *ALIASES)
    for name in names:
        if name not in known:
            close = get_close_matches(name, known, n=3, cutoff=0.0)
            raise ConfigError(f"{origin}.{name}: no kind of motion is called so, did you mean: {', '.join(close)}")


@lru_cache
def wordings(kind: str) -> tuple[str, ...]:
    """Wordings of a kind of motion; none for an unknown kind."""
    row = _table().get(ALIASES.get(kind, kind))
    return () if row is None else tuple(dict.fromkeys(_made(row)))


def first_wording(kind: str) -> str:
    """The first wording of a kind of motion; its name where it has none."""
    return next(iter(wordings(kind)), kind.replace("-", " "))


def verbs(kind: str) -> tuple[str, ...]:
    """Verbs of a kind of motion that has wordings."""
    return tuple(_table()[ALIASES.get(kind, kind)]["verbs"])


def moves_head(kind: str) -> bool:
    """Whether a kind of motion is one of the head."""
    return bool(_table().get(kind, {}).get("head", False))


def limbs(kind: str) -> frozenset[str] | None:
    """Groups of limbs that a kind of motion is made with; None: any."""
    row = _table().get(ALIASES.get(kind, kind), {})
    return frozenset(row["limbs"]) if "limbs" in row else None


def seen_parts(kind: str) -> frozenset[str]:
    """Parts that are seen to leave the stand, and to come back, in a kind of motion: of arm, head, trunk, leg."""
    row = _table().get(ALIASES.get(kind, kind), {})
    return frozenset(row.get("seen", row.get("limbs", ("arm", "head", "trunk", "leg"))))


def is_sudden(kind: str) -> bool:
    """Whether a kind of motion startles or hits who stands beside the robot: done on request, and not suggested."""
    return bool(_table().get(kind, {}).get("sudden", False))


def is_in_place(kind: str) -> bool:
    """Whether the whole body makes a kind of motion on feet that stay where they stand."""
    return bool(_table().get(kind, {}).get("in_place", False))


def is_pose(kind: str) -> bool:
    """Whether a kind of motion is held once it is reached, until something else is asked."""
    return bool(_table().get(ALIASES.get(kind, kind), {}).get("pose", False))


def is_brief(kind: str) -> bool:
    """Whether a kind of motion is a pose that people in clips leave as soon as it is reached."""
    return _table().get(ALIASES.get(kind, kind), {}).get("pose") == "brief"


def caption_patterns(kind: str) -> tuple[str, ...]:
    """Regular expressions of captions that tell of a kind of motion."""
    return tuple(_table()[kind].get("captions", ()))


def velocity(kind: str) -> tuple[float, float, float] | None:
    """Forward, left [m/s] and turning left [rad/s] that wordings of a kind mean; None where they mean no velocity."""
    row = _table().get(kind, {})
    return tuple(row["velocity"]) if "velocity" in row else None


ALIASES = {"byebye": "bye"}
"""Label -> the label of the same motion that has wordings."""
