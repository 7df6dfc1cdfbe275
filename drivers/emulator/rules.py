"""Rules by which emulated servos refuse packets, from `rules.yaml`, which names the section of the manual for each."""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path

from flexmotion.configs.schema import Strict, parse, read_yaml
from flexmotion.configs.servo import Protocol

FILE = Path(__file__).with_name("rules.yaml")


class Rule(Strict):
    """One rule: what is refused, where that is written, and the error number of the answer (None: no answer).

    `assumption` marks what the manual leaves open.
    """

    text: str
    source: str
    error: str | None = None
    assumption: bool = False


@cache
def rules_of(protocol: Protocol) -> dict[str, Rule]:
    """The rules of a protocol's servos, by name."""
    content = read_yaml(FILE)
    return {name: parse(Rule, fields, f"{FILE}: rule {name}") for name, fields in content[protocol].items()}


class Refusals(Counter[str]):
    """Number of refusals of one device, by the name of the rule."""

    def __init__(self, protocol: Protocol) -> None:
        super().__init__()
        self._known = rules_of(protocol)

    def note(self, name: str) -> Rule:
        """Count a refusal; the rule."""
        self[name] += 1
        return self._known[name]
