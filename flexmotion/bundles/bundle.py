"""`Bundle`: a trained model as it is shipped; a folder with a manifest that says what is in it and for what."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import Strict
from flexmotion.features.layout import Layout
from flexmotion.features.statistics import Statistics
from flexmotion.human.body import Body, Segments, Sex
from flexmotion.text.listener import Listener

SCHEMA = "flexmotion.bundle/3"
MANIFEST, ARRAYS, DENOISER, DECODER = "manifest.json", "arrays.npz", "denoiser.onnx", "decoder.onnx"


class BodySize(Strict):
    """The human that a bundle makes move, with the proportions of those that it was trained on (`body.Segments`)."""

    height: float
    mass: float
    sex: Sex
    segments: dict[str, float]


class Manifest(Strict):
    """What a bundle says of itself.

    Attributes:
        name, description: for people.
        layout: hash of the layout that its numbers follow.
        fps, muscles: of that layout.
        history, future: frames that it takes and makes.
        latent: size of the latent.
        steps: default number of steps of a sample.
        times: length of the noise schedule.
        guided: whether the network is told its guidance scale (few steps), or guided from outside (two evaluations).
        guidance: default scale.
        velocity: whether a velocity can be commanded.
        body: whose motion it makes.
        licence: of the weights.
        files: name -> sha256.
    """

    schema_: str
    name: str
    description: str = ""
    layout: str
    fps: float
    muscles: int
    history: int
    future: int
    latent: int
    steps: int
    times: int
    guided: bool
    guidance: float
    velocity: bool
    body: BodySize
    licence: str
    versions: dict[str, str] = {}
    files: dict[str, str] = {}


@dataclass(frozen=True)
class Prompts:
    """Wordings that a bundle knows: kinds by wording, (K,), and their embeddings, (K, D), of unit length."""

    kinds: tuple[str, ...]
    embeddings: np.ndarray


class Bundle:
    """A bundle in a folder; everything is checked when it is opened.

    Args:
        folder: that `write_bundle` made.

    Raises:
        ConfigError: a file is missing or changed, or the bundle is for another version, skeleton or layout.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        path = self.folder / MANIFEST
        try:
            content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise ConfigError(f"{path}: no bundle there ({error.strerror}); 'flexmotion export' makes one") from error
        except ValueError as error:
            raise ConfigError(f"{path}: damaged ({error})") from error
        if content.get("schema_") != SCHEMA:
            raise ConfigError(f"{path}: schema is {content.get('schema_')!r}, expected {SCHEMA!r}; export it anew")
        try:
            self.manifest = Manifest.model_validate(content)
        except ValidationError as error:
            first = error.errors()[0]
            raise ConfigError(f"{path}: field {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
        self.layout = Layout(self.manifest.fps, self.manifest.muscles)
        if self.layout.hash != self.manifest.layout:
            raise ConfigError(
                f"{path}: made for layout {self.manifest.layout}, this version has {self.layout.hash}: "
                "joints, points or blocks are others; export it anew"
            )
        for name, expected in self.manifest.files.items():
            file = self.folder / name
            if not file.is_file():
                raise ConfigError(f"{file}: missing")
            if sha256(file) != expected:
                raise ConfigError(f"{file}: is not what the manifest says (hash)")

    @cached_property
    def arrays(self) -> dict[str, np.ndarray]:
        """All numbers that are no network, as `write_bundle` was given them."""
        with np.load(self.folder / ARRAYS, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}

    @property
    def statistics(self) -> Statistics:
        """By which features are normalised."""
        return Statistics(self.arrays["mean"], self.arrays["spread"])

    @property
    def kept(self) -> np.ndarray:
        """Share of the latent's variance that is left at each time of the noise schedule, (times,)."""
        return self.arrays["kept"]

    @property
    def rest(self) -> np.ndarray:
        """Features of a human who stands, not normalised, (frames, F)."""
        return self.arrays["rest"].astype(np.float32)

    @property
    def prompts(self) -> Prompts:
        """Wordings that it knows."""
        kinds = tuple(str(name) for name in self.arrays["prompt_kinds"])
        return Prompts(kinds, self.arrays["prompt_embeddings"].astype(np.float32))

    @property
    def listener(self) -> Listener:
        """Which kind of motion a sentence asks for."""
        kinds, weights = self.arrays["listener_kinds"], self.arrays["listener_weights"].astype(np.float32)
        return Listener([str(name) for name in kinds], self.arrays["listener_pieces"], weights)

    @property
    def body(self) -> Body:
        """Whose motion it makes."""
        size = self.manifest.body
        return Body(size.height, size.mass, size.sex, Segments(**size.segments))

    @property
    def hash(self) -> str:
        """Of the whole bundle."""
        return sha256(self.folder / MANIFEST)[:16]


def write_bundle(folder: Path, manifest: Manifest, arrays: dict[str, np.ndarray]) -> Bundle:
    """Finish a bundle whose networks are in its folder: arrays, hashes, manifest.

    Args:
        folder: with the exported networks.
        manifest: without `files`.
        arrays: see the properties of `Bundle`.
    """
    np.savez_compressed(folder / ARRAYS, **arrays)  # type: ignore[arg-type]
    # Not of what only people read: figures are added to the card later.
    bound = [path for path in sorted(folder.iterdir()) if path.is_file() and path.suffix in (".onnx", ".npz", ".txt")]
    files = {path.name: sha256(path) for path in bound}
    content = manifest.model_copy(update={"files": files}).model_dump()
    text = json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False)
    (folder / MANIFEST).write_text(text + "\n", encoding="utf-8")
    return Bundle(folder)


def sha256(path: Path) -> str:
    """Of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
