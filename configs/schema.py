"""`Strict`, the base of all configuration models, and functions to read YAML into them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.problems import one_line


class Strict(BaseModel):
    """Rejects unknown fields, NaN and infinity. Read-only."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Model = TypeVar("Model", bound=Strict)

_LOADER: type[Any] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""libyaml's takes a tenth of the time: a robot is loaded in 10 ms. PyYAML can be built without it."""


def yaml_content(text: str) -> Any:
    """What a YAML document holds. Raises `yaml.YAMLError`, also for a key given twice and for too deep a nest."""
    loader = _LOADER(text)
    try:
        document = loader.get_single_node()
        if document is None:
            return None
        _check_keys(document)
        return loader.construct_document(document)
    except RecursionError as error:
        raise yaml.YAMLError("it is nested too deeply") from error
    finally:
        loader.dispose()


def _check_keys(document: yaml.Node) -> None:
    """Refuse a key that a mapping has twice: YAML forbids it, and PyYAML takes the last one."""
    waiting, seen = [document], set[int]()
    while waiting:
        node = waiting.pop()
        if id(node) in seen or not isinstance(node, yaml.CollectionNode):
            continue
        seen.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            waiting += node.value
            continue
        lines: dict[tuple[str, str], int] = {}
        for key, value in node.value:
            waiting.append(value)
            if not isinstance(key, yaml.ScalarNode):
                continue
            named = (key.tag, key.value)
            if named in lines:
                problem = f"key {key.value!r} is given twice, first in line {lines[named]}"
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
            lines[named] = key.start_mark.line + 1


def read_yaml(file: Path) -> dict[str, Any]:
    """The mapping in a YAML file. Raises `ConfigError` if it is missing, not YAML, or not a mapping."""
    try:
        content = yaml_content(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise not_yaml(file, error) from error
    if not isinstance(content, dict):
        raise ConfigError(f"{file}: expected a mapping of fields, found {type(content).__name__}")
    return content


def not_yaml(file: Path, error: yaml.YAMLError | UnicodeDecodeError) -> ConfigError:
    """The error for a file that is not valid YAML, with the line if known."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return ConfigError(f"{file}, line {error.problem_mark.line + 1}: not valid YAML: {error.problem}")
    return ConfigError(f"{file}: not valid YAML: {' '.join(str(error).split())}")


def parse(model: type[Model], content: dict[str, Any], origin: Path | str) -> Model:
    """`content` of `origin` as a `model`. Raises `ConfigError` with the first wrong field and its valid values."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        field, message = one_line(error, model)
        raise ConfigError(f"{origin}: field {field or '(file)'}: {message}") from error


def load(model: type[Model], file: Path) -> Model:
    """A YAML file as a `model`. Raises `ConfigError` (see `read_yaml` and `parse`)."""
    return parse(model, read_yaml(file), file)


def store(content: Strict, file: Path) -> Path:
    """Write a model as YAML, completely or not at all. Raises `ConfigError` if the file cannot be written."""
    unfinished = file.with_suffix(".unfinished")
    try:
        with unfinished.open("w", encoding="utf-8") as stream:
            yaml.safe_dump(content.model_dump(), stream, sort_keys=False, allow_unicode=True)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(unfinished, file)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise ConfigError(f"{file}: cannot be written: {error.strerror}") from error
    return file
