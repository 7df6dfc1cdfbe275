"""Prompts in wordings that no model was trained on, and what their motion is judged by."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

FILE = Path(__file__).with_name("prompts.yaml")
GESTURES = Path(__file__).with_name("gesture_prompts.yaml")
LOCOMOTION = {"walks", "sideways", "turns"}
"""Checks of prompts that move the body over the ground or turn it."""


@dataclass(frozen=True)
class PromptKind:
    """A kind of prompt.

    Attributes:
        kind: its name.
        wordings: sentences that ask for it.
        check: name of a check -> the limit that the motion must reach, as `prompts.yaml` explains.
        seconds: length of a sample [s]; None for the benchmark's.
        of: kind of motion of a bundle that it asks for; None: of none.
    """

    kind: str
    wordings: tuple[str, ...]
    check: dict[str, Any]
    seconds: float | None = None
    of: str | None = None

    @property
    def moves(self) -> bool:
        """Whether it asks for locomotion or a turn."""
        return bool(LOCOMOTION & set(self.check))


@lru_cache
def prompt_kinds() -> tuple[PromptKind, ...]:
    """All kinds, as `prompts.yaml` lists them."""
    rows = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    return tuple(PromptKind(row["kind"], tuple(row["wordings"]), row["check"], of=row.get("of")) for row in rows)


@lru_cache
def gesture_kinds() -> tuple[PromptKind, ...]:
    """Gestures, as `gesture_prompts.yaml` lists them; `kind` is that of a bundle, which may lack it."""
    rows = yaml.safe_load(GESTURES.read_text(encoding="utf-8"))
    return tuple(
        PromptKind(row["kind"], tuple(row["wordings"]), row["check"], row.get("seconds"), row["kind"]) for row in rows
    )
