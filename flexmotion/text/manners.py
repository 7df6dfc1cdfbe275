"""Manners of motion: how a kind of motion is done, and their wordings."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from importlib import resources
from typing import Any

from flexmotion.configs.schema import yaml_content

NORMAL = "normal"
"""The manner of a request that says none."""


@lru_cache
def _file() -> Mapping[str, Any]:
    text = resources.files("flexmotion").joinpath("data", "manners.yaml").read_text(encoding="utf-8")
    content: Mapping[str, Any] = yaml_content(text)
    return content


def _table() -> Mapping[str, Mapping[str, Any]]:
    table: Mapping[str, Mapping[str, Any]] = _file()["manners"]
    return table


@lru_cache
def manners() -> tuple[str, ...]:
    """Every manner that has wordings, `NORMAL` first."""
    return tuple(_table())


def manner_wordings(manner: str) -> tuple[str, ...]:
    """Wordings of a manner, to stand behind those of a kind of motion; none for an unknown manner."""
    return tuple(_table().get(manner, {}).get("wordings", ()))


def manner_sayings(manner: str) -> tuple[str, ...]:
    """Further phrases that ask for a manner, for a listener."""
    return tuple(_table().get(manner, {}).get("said", ()))


def manner_words(manner: str) -> tuple[str, ...]:
    """Single words that say a manner in any place of a sentence: "a proud wave", "march"."""
    return tuple(_table().get(manner, {}).get("words", ()))


def manner_subjects(manner: str) -> tuple[str, ...]:
    """Who moves in a manner, at the beginning of a sentence: "an old man walks"."""
    return tuple(_table().get(manner, {}).get("subjects", ()))


@lru_cache
def neutral_words() -> frozenset[str]:
    """Words and phrases that look like manners and ask for none."""
    return frozenset(_file()["neutral"])


def manner_nouns() -> tuple[str, ...]:
    """What phrases with "with", "in" and "full of" name where they say a manner."""
    return tuple(_file()["nouns"])


def purposes() -> tuple[str, ...]:
    """What a motion may be meant as, which is no manner: "as a greeting"."""
    return tuple(_file()["purposes"])


def unknown_manners() -> tuple[str, ...]:
    """Phrases that say a manner of none of these kinds, for a listener."""
    return tuple(_file()["unknown"])


@lru_cache
def _of_style() -> Mapping[str, str]:
    return {label: manner for manner, row in _table().items() for label in row.get("labels", ())}


def manner_of_style(style: str) -> str | None:
    """The manner that clips with a style show; None for an unknown style."""
    return _of_style().get(style)


def styled(wording: str, manner: str) -> tuple[str, ...]:
    """A wording of a kind with each wording of a manner; unchanged for the normal and for an unknown manner."""
    ways = () if manner == NORMAL else manner_wordings(manner)
    return tuple(f"{wording} {way}" for way in ways) or (wording,)
