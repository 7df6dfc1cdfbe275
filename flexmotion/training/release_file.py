"""`ReleaseFile`: a trained model's weights in one file that a training can begin from.

A safetensors file: weights in half precision, statistics and the sentence encoder as tensors, everything else as JSON
in its metadata. Reading it runs no code, unlike a pickled checkpoint. The state of the optimiser is not in it.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import safetensors.torch
import torch
from pydantic import Field
from safetensors import SafetensorError, safe_open
from torch import Tensor

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import ModelConfig
from flexmotion.configs.schema import Strict, parse
from flexmotion.configs.versions import FormatVersions
from flexmotion.training.half_weights import LEAST

METADATA = "flexmotion"
"""Key of the JSON in the metadata of the file."""

RELEASE_VERSIONS = FormatVersions(
    kind="weights file",
    oldest=1,
    newest=1,
    migration="write it anew from its training folder ('flexmotion export --weights')",
    field="schema_",
)
SCHEMA = f"flexmotion.weights/{RELEASE_VERSIONS.newest}"
"""Schema that is written."""

HASH_LENGTH = 16
"""Hexadecimal digits of a release's hash."""

HALF_MAX = float(torch.finfo(torch.float16).max)


class StageRecord(Strict):
    """How far a stage was trained: see `flexmotion.bundles.card.Trained`; `step` is that of the weights."""

    step: int
    steps: int
    processes: int
    batch: int
    figures: dict[str, float]


class SetFigures(Strict):
    """The training set: see `flexmotion.training.set_summary.SetSummary`."""

    segments: dict[str, float]
    licences: list[str]
    kinds: list[str]
    manners: list[str]
    hours: float
    clips: int


class ReleaseHeader(Strict):
    """Description of a release.

    Attributes:
        schema_: version of the file, `SCHEMA`.
        name, description: for people.
        config, seed: of the training.
        layout: hash of the feature layout.
        stages: trained stages by name; their weights are the tensors `STAGE.PARAMETER`.
        set_: the training set.
        text: SHA-256 of the sentence encoder's files by name; they lie in this file or in a bundle; empty for none.
        begun: hash of the release that this training began from; empty for none.
        built_on: digest of the weights that a stage was trained on, by the stage; by it the stage is found in a file of
            its own. Files of earlier versions have none.
        personal: wordings of the manner that the training was personalised to.
        versions: of the libraries that made it.
        sha256: of all the above and of the tensors.
    """

    schema_: str
    name: str
    description: str = ""
    config: ModelConfig
    seed: int
    layout: str
    stages: dict[str, StageRecord]
    set_: SetFigures = Field(alias="set")
    text: dict[str, str] = {}
    begun: str = ""
    built_on: dict[str, str] = {}
    personal: list[str] = []
    versions: dict[str, str] = {}
    sha256: str = ""


class ReleaseFile:
    """A release on disk, checked when it is opened.

    Args:
        path: written by `write_release_file`.

    Attributes:
        header: description.

    Raises:
        ConfigError: the file is missing, damaged, changed, no release, or of another schema.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise ConfigError(f"{path}: no weights file there; 'flexmotion export TRAINING --weights' writes one")
        try:
            with safe_open(str(path), framework="pt") as file:
                content = (file.metadata() or {}).get(METADATA)
        except SafetensorError as error:
            raise ConfigError(f"{path}: damaged, or no weights file ({error})") from error
        if content is None:
            raise ConfigError(f"{path}: a safetensors file of another program, expected one of {SCHEMA!r}")
        parsed: dict[str, Any] = json.loads(content)
        RELEASE_VERSIONS.check(_version(parsed.get("schema_"), path), path)
        self.header = parse(ReleaseHeader, parsed, path)
        found = _digest(parsed, self.tensors)
        if found != self.header.sha256:
            raise ConfigError(f"{path}: changed: its content has SHA-256 {found}, the file names {self.header.sha256}")

    @cached_property
    def tensors(self) -> dict[str, Tensor]:
        """Every tensor as it is stored."""
        return safetensors.torch.load_file(self.path)

    @property
    def hash(self) -> str:
        """Hash of everything in it."""
        return self.header.sha256[:HASH_LENGTH]

    def weights(self, stage: str) -> dict[str, Tensor]:
        """Weights of a stage by parameter, in single precision.

        Raises:
            ConfigError: the release lacks the stage.
        """
        if stage not in self.header.stages:
            raise ConfigError(f"{self.path}: has no stage {stage!r}, expected one of: {', '.join(self.header.stages)}")
        begin = f"{stage}."
        own = {name.removeprefix(begin): value for name, value in self.tensors.items() if name.startswith(begin)}
        return {name: value.float() if value.dtype == torch.float16 else value for name, value in own.items()}


def write_release_file(header: ReleaseHeader, tensors: Mapping[str, Tensor], path: Path) -> ReleaseFile:
    """Write a release in one step; an existing file there is replaced.

    Args:
        header: its `sha256` is filled in.
        tensors: by name; those in half precision are made so by `halved`.
        path: of the file.
    """
    stored = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    content = header.model_dump(by_alias=True)
    content["sha256"] = _digest(content, stored)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(".tmp")
    # Not `save_file`, whose files only their owner can read.
    temporary.write_bytes(safetensors.torch.save(stored, metadata={METADATA: _json(content)}))
    os.replace(temporary, path)
    return ReleaseFile(path)


def halved(value: Tensor) -> Tensor:
    """A weight in half precision; small ones, and those beyond its range, as they are."""
    fits = value.is_floating_point() and value.numel() >= LEAST and float(value.abs().max()) <= HALF_MAX
    return value.half() if fits else value


def _json(content: Mapping[str, Any]) -> str:
    return json.dumps(content, sort_keys=True, ensure_ascii=False)


def _digest(content: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> str:
    # Of the text as it was written: a later version may know more fields.
    written = {name: value for name, value in json.loads(_json(content)).items() if name != "sha256"}
    found = hashlib.sha256(_json(written).encode())
    for name in sorted(tensors):
        value = tensors[name]
        found.update(f"{name} {value.dtype} {tuple(value.shape)}".encode())
        found.update(value.numpy().tobytes())
    return found.hexdigest()


def _version(schema: Any, path: Path) -> int:
    found = re.fullmatch(r"flexmotion\.weights/(\d+)", schema) if isinstance(schema, str) else None
    if found is None:
        raise ConfigError(f"{path}: no weights file: schema is {schema!r}, expected {SCHEMA!r}")
    return int(found[1])
