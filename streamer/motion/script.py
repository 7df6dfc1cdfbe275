"""`load_script`: a script, which is a YAML list of what to do at which time.

```yaml
- {at: 0, text: walk forward}
- {at: 4.5, velocity: [0.4, 0, 0.5]}
- {at: 8, text: wave with the right hand}
- {at: 12, stop: true}
```

or of clips, each with `clip: FILE`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import not_yaml
from flexmotion.streamer.motion.intents import WORDS, Clip, Intent, Stop, from_content, word_of
from flexmotion.streamer.motion.part_intents import PARTS, PartIntent

_ITEM = (
    "{at: seconds, text: WORDS | velocity: [vx, vy, wz] | heading: RAD | waypoint: [x, y] | clip: FILE | stop: true}"
)
_WORDS = tuple(word for word in WORDS if word not in PARTS)


class _Loader(yaml.SafeLoader):
    """Reads numbers as YAML 1.2 does: of 1.1, which PyYAML knows, "1e9" and "-.1" are words."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+\.[0-9]*|[0-9]+(?=[eE]))(?:[eE][-+]?[0-9]+)?$"),
    list("-+.0123456789"),
)


@dataclass(frozen=True)
class Item:
    """From `at` [s] on, do as `intent` says; a clip's name is its file."""

    at: float
    intent: Intent


def load_script(file: str | Path) -> list[Item]:
    """The items of a script in order of time; relative paths of clips start at the script's folder.

    Raises:
        ConfigError: names the line, what is wrong in it, and what would be valid.
    """
    file = Path(file)
    try:
        text = file.read_text(encoding="utf-8")
        root = yaml.compose(text, Loader=_Loader)
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise not_yaml(file, error) from error
    if not isinstance(root, yaml.SequenceNode) or not root.value:
        raise ConfigError(f"{file}: expected a list of {_ITEM}")
    items: list[Item] = []
    for node in root.value:
        where = f"{file}, line {node.start_mark.line + 1}"
        item = _item(where, node, file.parent)
        _check_order(where, item, items)
        items.append(item)
    return items


def check_script(items: Sequence[Item]) -> None:
    """Raise `ConfigError` if items do not make a script: empty, not in order of time, or clips mixed with text."""
    if not items:
        raise ConfigError(f"script: has no items, expected {_ITEM}")
    for number, item in enumerate(items):
        _check_order(f"script, item {number + 1}", item, list(items[:number]))


def _check_order(where: str, item: Item, before: list[Item]) -> None:
    """Raise `ConfigError` if an item may not follow the ones before it."""
    if isinstance(item.intent, PartIntent):
        raise ConfigError(f"{where}: {_for_a_run(word_of(item.intent))}")
    if not before:
        if item.at != 0 or isinstance(item.intent, Stop):
            raise ConfigError(f"{where}: a script starts with something to do at: 0, expected {_ITEM}")
        return
    if item.at <= before[-1].at:
        raise ConfigError(f"{where}: at: {item.at:g} does not come after {before[-1].at:g}")
    if isinstance(before[-1].intent, Stop):
        raise ConfigError(f"{where}: nothing may follow stop")
    first = before[0].intent
    if not isinstance(item.intent, Stop) and isinstance(item.intent, Clip) != isinstance(first, Clip):
        raise ConfigError(
            f"{where}: {word_of(item.intent)} after {word_of(first)}: a script is either of clips, or of text and "
            "velocity, which a model follows"
        )


def _for_a_run(word: str) -> str:
    return f"{word} is sent to a run (flexmotion send); expected {_ITEM}"


def _item(where: str, node: yaml.Node, folder: Path) -> Item:
    if not isinstance(node, yaml.MappingNode):
        raise ConfigError(f"{where}: expected {_ITEM}")
    content: dict[str, Any] = {}
    for key, value in node.value:
        line = f"{where.rsplit(' ', 1)[0]} {key.start_mark.line + 1}"
        if key.value in PARTS:
            raise ConfigError(f"{line}: {_for_a_run(key.value)}")
        if key.value not in ("at", *_WORDS):
            raise ConfigError(f"{line}: unknown word {key.value!r}, expected at and one of: {', '.join(_WORDS)}")
        content[str(key.value)] = yaml.load(yaml.serialize(value), Loader=_Loader)
    if len(found := [word for word in _WORDS if word in content]) != 1:
        named = " and ".join(found) or "none"
        raise ConfigError(f"{where}: expected exactly one of: {', '.join(_WORDS)}; found {named}")
    try:
        intent = from_content(content)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
    at = content.get("at")
    if isinstance(at, bool) or not isinstance(at, int | float) or not 0 <= at < float("inf"):
        raise ConfigError(f"{where}: at: expected seconds from the start, found {at!r}")
    if isinstance(intent, Clip):
        intent = Clip(str(folder / Path(intent.name).expanduser()))
    return Item(float(at), intent)
