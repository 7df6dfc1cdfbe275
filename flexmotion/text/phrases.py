"""Wordings of kinds of motion: captions for clips that have only labels."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from importlib import resources
from typing import Any

import yaml

STAND, WALK, BACK = "stand", "walk", "walk-back"
"""Kinds of motion: without a request; at a velocity without words, forward or sideways; at one backward."""


@lru_cache
def _table() -> Mapping[str, Any]:
    text = resources.files("flexmotion").joinpath("data", "phrases.yaml").read_text(encoding="utf-8")
    table: Mapping[str, Any] = yaml.safe_load(text)
    return table


@lru_cache
def kinds() -> tuple[str, ...]:
    """Labels that have wordings."""
    return tuple(_table()["kinds"])


@lru_cache
def wordings(kind: str) -> tuple[str, ...]:
    """Wordings of a kind of motion; none for an unknown kind."""
    row = _table()["kinds"].get(ALIASES.get(kind, kind))
    if row is None:
        return ()
    made = [f"{verb} {ending}".strip() for verb in row["verbs"] for ending in row["endings"]]
    return tuple(dict.fromkeys([*made, *row["more"]]))


def verbs(kind: str) -> tuple[str, ...]:
    """Verbs of a kind of motion that has wordings."""
    return tuple(_table()["kinds"][kind]["verbs"])


def velocity(kind: str) -> tuple[float, float, float] | None:
    """Forward, left [m/s] and turning left [rad/s] that wordings of a kind mean; None where they mean no velocity."""
    row = _table()["kinds"].get(kind, {})
    return tuple(row["velocity"]) if "velocity" in row else None


def styled(wording: str, style: str) -> tuple[str, ...]:
    """A wording in each phrase of a style; unchanged for an unknown style."""
    return tuple(f"{wording} {adverb}".strip() for adverb in _table()["styles"].get(style, [""]))


ALIASES = {"byebye": "bye"}
"""Label -> the label of the same motion that has wordings."""
