"""Scripts: a YAML list of what to do at which time.

```yaml
- {at: 0, clip: wave.bvh}
- {at: 4.5, clip: walk.bvh}
- {at: 12, stop: true}
```
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from configs.errors import ConfigError

ACTIONS = ("clip", "text", "velocity", "stop")
NEED_MODEL = ("text", "velocity")


@dataclass(frozen=True)
class Item:
    """From `at` [s] on, follow `clip`, or come to a stop where it is None."""

    at: float
    clip: Path | None


def load_script(file: Path) -> list[Item]:
    """The items of a script in order of time; clips are sought beside the script.

    Raises:
        ConfigError: with the line, the word that is wrong and what it may be.
    """
    try:
        text = file.read_text(encoding="utf-8")
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{file}: not valid YAML: {' '.join(str(error).split())}") from error
    if not isinstance(root, yaml.SequenceNode) or not root.value:
        raise ConfigError(f"{file}: expected a list of {{at: seconds, clip: FILE | stop: true}}")
    items: list[Item] = []
    for node in root.value:
        where = f"{file}, line {node.start_mark.line + 1}"
        item = _item(where, node, file.parent)
        if items and item.at <= items[-1].at:
            raise ConfigError(f"{where}: at: {item.at:g} does not come after {items[-1].at:g}")
        if items and items[-1].clip is None:
            raise ConfigError(f"{where}: nothing may follow stop")
        items.append(item)
    if items[0].at != 0 or items[0].clip is None:
        first = root.value[0].start_mark.line + 1
        raise ConfigError(f"{file}, line {first}: a script starts with {{at: 0, clip: FILE}}")
    return items


def _item(where: str, node: yaml.Node, folder: Path) -> Item:
    if not isinstance(node, yaml.MappingNode):
        raise ConfigError(f"{where}: expected {{at: seconds, clip: FILE | stop: true}}")
    content: dict[str, Any] = {}
    for key, value in node.value:
        content[str(key.value)] = yaml.safe_load(yaml.serialize(value))
        if key.value not in ("at", *ACTIONS):
            raise ConfigError(
                f"{where.rsplit(' ', 1)[0]} {key.start_mark.line + 1}: unknown word {key.value!r}, "
                f"expected at and one of: {', '.join(ACTIONS)}"
            )
    actions = [word for word in ACTIONS if word in content]
    if len(actions) != 1:
        found = " and ".join(actions) or "none"
        raise ConfigError(f"{where}: expected exactly one of: {', '.join(ACTIONS)}; found {found}")
    at = content.get("at")
    if isinstance(at, bool) or not isinstance(at, int | float) or not 0 <= at < float("inf"):
        raise ConfigError(f"{where}: at: expected seconds from the start, found {at!r}")
    action, value = actions[0], content[actions[0]]
    if action in NEED_MODEL:
        raise ConfigError(f"{where}: {action} needs a model bundle, which this version lacks; use clip or stop")
    if action == "stop":
        if value is not True:
            raise ConfigError(f"{where}: stop: expected true, found {value!r}")
        return Item(float(at), None)
    if not isinstance(value, str):
        raise ConfigError(f"{where}: clip: expected a file, found {value!r}")
    return Item(float(at), folder / Path(value).expanduser())
