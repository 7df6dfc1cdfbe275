"""Wordings of what motions show: captions for clips that only have labels."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from importlib import resources
from typing import Any

import yaml

STAND, WALK, BACK = "stand", "walk", "walk-back"
"""Kinds of motion: what is done where nothing is asked, and where nothing but a velocity is: ahead, aside; back."""


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
    """Of a kind of motion; none for a kind that is not known."""
    row = _table()["kinds"].get(ALIASES.get(kind, kind))
    if row is None:
        return ()
    made = [f"{verb} {ending}".strip() for verb in row["verbs"] for ending in row["endings"]]
    return tuple(dict.fromkeys([*made, *row["more"]]))


def velocity(kind: str) -> tuple[float, float, float] | None:
    """Forward, left [m/s] and turning left [rad/s] that wordings of a kind mean; None where they mean none."""
    return _velocity(kind, "velocity")


def goes(kind: str) -> tuple[float, float, float] | None:
    """Likewise, at which the shipped model goes about, told a kind and nothing else; None where it goes nowhere.

    A model that goes faster of its own accord is not slowed by it where a pace lies between the two.
    """
    return _velocity(kind, "goes")


def _velocity(kind: str, key: str) -> tuple[float, float, float] | None:
    row = _table()["kinds"].get(kind, {})
    return tuple(row[key]) if key in row else None


def styled(wording: str, style: str) -> tuple[str, ...]:
    """A wording in a style, in several ways; as it is where the style is not known."""
    return tuple(f"{wording} {adverb}".strip() for adverb in _table()["styles"].get(style, [""]))


ALIASES = {"byebye": "bye"}
"""Labels of the same motion."""
