"""`vocabulary`: the words of the grammar, as `flexmotion/data/grammar.yaml` lists them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any, Literal

from flexmotion.configs.schema import yaml_content
from flexmotion.text import phrases

Quantity = Literal["angle", "length", "steps", "time", "times"]
"""What an amount measures, in radians, metres, steps, seconds and times."""


@dataclass(frozen=True)
class Vocabulary:
    """The lists of `grammar.yaml`, those of phrases with the longest first.

    Attributes:
        table: the lists by name.
        units: name -> quantity and size.
        verbs: words that begin a request.
    """

    table: dict[str, Any]
    units: dict[str, tuple[Quantity, float]]
    verbs: frozenset[str]
    # Sorted once: every word of a sentence is compared with several lists, in time that a target waits for.
    _phrases: dict[str, tuple[str, ...]]
    _words: dict[str, frozenset[str]]

    def phrases(self, name: str) -> tuple[str, ...]:
        """A list of phrases, the longest first."""
        return self._phrases[name]

    def words(self, name: str) -> frozenset[str]:
        """A list of words."""
        return self._words[name]


@lru_cache
def vocabulary() -> Vocabulary:
    """The shipped words."""
    text = resources.files("flexmotion").joinpath("data", "grammar.yaml").read_text(encoding="utf-8")
    table: dict[str, Any] = yaml_content(text)
    units: dict[str, tuple[Quantity, float]] = {
        name: (quantity, float(size)) for quantity, sizes in table["units"].items() for name, size in sizes.items()
    }
    taught = {wording.split()[0].lower() for kind in phrases.kinds() for wording in phrases.verbs(kind)}
    verbs = frozenset(taught | set(table["verbs"]) | set(table["walk_verbs"]))
    listed = {name: list(words) for name, words in table.items() if isinstance(words, list | dict)}
    ordered = {name: tuple(sorted(words, key=_longest_first)) for name, words in listed.items()}
    return Vocabulary(table, units, verbs, ordered, {name: frozenset(words) for name, words in listed.items()})


def _longest_first(phrase: str) -> tuple[int, str]:
    return -len(str(phrase).split()), str(phrase)
