"""`with_numbers`: the text of a YAML file with other numbers in it; comments and layout stay as they are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import not_yaml

Place = tuple[str | int, ...]
"""Where a value is in a YAML file: keys of mappings and indices of lists, from the outside."""


def with_numbers(text: str, values: Mapping[Place, float], file: Path) -> str:
    """The text with the number at each place replaced.

    Args:
        text: of a YAML file.
        values: new numbers by place: keys of mappings and indices of lists, from the outside.
        file: that the text is from, for messages.

    Raises:
        ConfigError: it is not YAML, has no number at a place, or one that other places share (an anchor).
    """
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise not_yaml(file, error) from error
    spans = sorted((*_span(root, place, file), value) for place, value in values.items())
    for begin, end, value in reversed(spans):
        text = text[:begin] + written(value) + text[end:]
    return text


def written(value: float) -> str:
    """A number as YAML: without an exponent, which YAML 1.1 reads as text where it has no point ("1e-05")."""
    return np.format_float_positional(value, trim="0")


def _span(root: yaml.Node | None, place: Place, file: Path) -> tuple[int, int]:
    """First and last offset of the number at a place of the text."""
    node, name = root, ".".join(str(key) for key in place)
    for key in place:
        found = None
        if isinstance(node, yaml.MappingNode) and isinstance(key, str):
            found = next((value for own, value in node.value if own.value == key), None)
        elif isinstance(node, yaml.SequenceNode) and isinstance(key, int) and key < len(node.value):
            found = node.value[key]
        if found is None:
            raise ConfigError(f"{file}: field {name}: not in the file, expected a number")
        node = found
    if not isinstance(node, yaml.ScalarNode) or node.tag not in ("tag:yaml.org,2002:float", "tag:yaml.org,2002:int"):
        raise ConfigError(f"{file}: field {name}: expected a number")
    if _uses(root, node) > 1:
        raise ConfigError(f"{file}: field {name}: an anchor shares this number with other fields; write it out")
    return node.start_mark.index, node.end_mark.index


def _uses(node: yaml.Node | None, wanted: yaml.Node) -> int:
    """How often a node occurs in a tree."""
    if node is wanted:
        return 1
    if isinstance(node, yaml.MappingNode):
        return sum(_uses(value, wanted) for _, value in node.value)
    if isinstance(node, yaml.SequenceNode):
        return sum(_uses(value, wanted) for value in node.value)
    return 0
