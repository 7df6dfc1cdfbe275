"""What all intents for a part of the body have in common: sides, names of joints, and how logs hold their fields."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.motion.intent_values import require_words

Side = Literal["left", "right"]
SIDES: tuple[Side, ...] = get_args(Side)

LONGEST_JOINT = 64
"""Of a joint's name, in characters."""


@dataclass(frozen=True)
class Logged:
    """An intent whose fields logs hold."""

    def content(self) -> dict[str, Any]:
        """The intent as logs hold it."""
        return asdict(self)


def require_choice(what: str, value: Any, choices: tuple[str, ...]) -> None:
    """Raise `ConfigError` where a value is none of the choices."""
    if value not in choices:
        raise ConfigError(f"{what}: expected one of: {', '.join(choices)}; found {value!r}")


def require_joint(word: str, name: Any) -> None:
    """Raise `ConfigError` where a value is no name of a joint."""
    require_words(word, name, "the name of a joint")
    if len(name) > LONGEST_JOINT or not name.isprintable():
        raise ConfigError(f"{word}: expected a name of {LONGEST_JOINT} characters at most, found {name[:80]!r}")
