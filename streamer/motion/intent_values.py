"""What words and numbers of intents have to be."""

from __future__ import annotations

import math
from typing import Any

from flexmotion.configs.errors import ConfigError


def require_words(word: str, value: Any, expected: str) -> None:
    """Raise `ConfigError` where a value is no words."""
    # In shared memory a NUL ends a text.
    if not isinstance(value, str) or not value.strip() or "\0" in value:
        raise ConfigError(f"{word}: expected {expected}, found {value!r}")


def require_numbers(expected: str, values: tuple[Any, ...], bound: float, least: float | None = None) -> None:
    """Raise `ConfigError` where a value is not a finite number from `least` (None: -`bound`) to `bound`."""
    # In Python a bool is an int, but it is no measure.
    for value in values:
        number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if not number or abs(value) > bound or (least is not None and value < least):
            within = f"±{bound:g}" if least is None else f"{least:g} to {bound:g}"
            raise ConfigError(f"{expected}, finite and within {within}; found {value!r}")
