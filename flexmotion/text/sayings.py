"""Sentences that ask for each kind of motion: the training data of the listener."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from importlib import resources
from pathlib import Path

import yaml

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import yaml_content
from flexmotion.text.phrases import kinds, wordings
from flexmotion.text.sides import mirrored, sides

NOTHING = "none"
"""Label of sentences that mean no known kind of motion."""


@lru_cache
def sayings() -> tuple[tuple[str, str], ...]:
    """Kind of motion, or `NOTHING`, and sentence, of all shipped sentences and all wordings of motions.

    A sentence that names a side comes with its mirror image, in which left and right are swapped.
    """
    text = resources.files("flexmotion").joinpath("data", "sayings.yaml").read_text(encoding="utf-8")
    return _with_mirror_images([*_rows(yaml_content(text)), *((kind, w) for kind in kinds() for w in wordings(kind))])


def read_sayings(path: Path) -> tuple[tuple[str, str], ...]:
    """The same pairs from a YAML file: kinds of motion, each with a list of sentences.

    Raises:
        ConfigError: the file cannot be read or has other content.
    """
    try:
        # BaseLoader: YAML would turn "no", "yes" and 2024-01-01 into other types than strings.
        table = yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.BaseLoader)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except (UnicodeDecodeError, RecursionError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: not valid YAML ({' '.join(str(error).split())})") from error
    if not isinstance(table, dict) or not table:
        raise ConfigError(f"{path}: expected kinds of motion, each with a list of sentences (walk: [patrol, ...])")
    for kind, said in table.items():
        if not isinstance(said, list) or not said or not all(isinstance(one, str) and one.strip() for one in said):
            raise ConfigError(f"{path}: {kind}: expected a list of sentences, found {said!r}")
    return _with_mirror_images(_rows(table))


def _rows(table: Mapping[str, list[str]]) -> list[tuple[str, str]]:
    return [(kind, sentence) for kind, sentences in table.items() for sentence in sentences]


def _with_mirror_images(said: list[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    # A sentence that names no side ("wave") has no mirror image: it means the right hand only.
    images = ((mirrored(kind), mirrored(sentence)) for kind, sentence in said if sides(sentence))
    return tuple(dict.fromkeys([*said, *images]))
