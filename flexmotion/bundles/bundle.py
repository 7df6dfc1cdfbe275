"""`Bundle`: a trained model as it is shipped, a folder with networks, arrays and a manifest."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from flexmotion.bundles.manifest import MANIFEST, Manifest, equivalent_hashes, read_manifest, write_manifest
from flexmotion.configs.errors import ConfigError
from flexmotion.features.layout import Layout
from flexmotion.features.statistics import Statistics
from flexmotion.human.body import Body, Segments
from flexmotion.text.listener import Listener

ARRAYS, DENOISER, DECODER = "arrays.npz", "denoiser.onnx", "decoder.onnx"

CONTROL = "control.onnx"
"""Optional network: the denoiser with a control branch, whose further inputs are constraints and their mask."""

JACOBIAN = "jacobian"
"""Optional array: derivatives of decoded motion by the latent, (W, columns of `root` and `rotations`, L)."""

HASH_LENGTH = 16
"""Hexadecimal digits of a bundle's hash."""


@dataclass(frozen=True)
class Prompts:
    """Wordings that a bundle knows: their kinds of motion, (K,), and their unit embeddings, (K, D)."""

    kinds: tuple[str, ...]
    embeddings: np.ndarray


@dataclass(frozen=True)
class KnownManners:
    """Manners that a bundle was trained on, (M,), and the unit embedding of each, (M, D)."""

    names: tuple[str, ...]
    embeddings: np.ndarray


class Bundle:
    """A bundle in a folder; every file is checked when it is opened.

    Args:
        folder: written by `write_bundle`.

    Attributes:
        manifest: brought to the present schema.
        layout: of the features.

    Raises:
        ConfigError: a file is missing or changed, or the bundle is for another version, skeleton or layout.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        path = self.folder / MANIFEST
        self.manifest = read_manifest(path)
        self.layout = Layout(self.manifest.fps, self.manifest.muscles, joint_contact=self.manifest.joint_contact)
        if self.layout.hash != self.manifest.layout:
            raise ConfigError(
                f"{path}: made for layout {self.manifest.layout}, this version has {self.layout.hash}: "
                "joints, points or blocks differ; export the bundle anew"
            )
        for name, expected in self.manifest.files.items():
            file = self.folder / name
            if not file.is_file():
                raise ConfigError(f"{file}: missing")
            if sha256(file) != expected:
                raise ConfigError(f"{file}: differs from the manifest (hash)")
        for manner, network in self.manifest.personal.items():
            if network not in self.manifest.files or manner not in self.manners.names:
                raise ConfigError(f"{path}: personal: {manner!r}: its network {network!r} or its embedding is missing")
        corrections = self.manifest.corrections
        if corrections.speeds or corrections.manner_speeds or corrections.guidance:
            known = {*self.prompts.kinds, *self.listener.kinds}
            corrections.require_known(known, self.manners.names, f"{path}: corrections")

    @cached_property
    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays, as given to `write_bundle`."""
        with np.load(self.folder / ARRAYS, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}

    @property
    def statistics(self) -> Statistics:
        """Mean and spread of the features."""
        return Statistics(self.arrays["mean"], self.arrays["spread"])

    @property
    def kept(self) -> np.ndarray:
        """Share of the latent's variance that is left at each time of the noise schedule, (times,)."""
        return self.arrays["kept"]

    @property
    def rest(self) -> np.ndarray:
        """Features of a standing human, not normalised, (frames, F)."""
        return self.arrays["rest"].astype(np.float32)

    @property
    def has_control(self) -> bool:
        """Whether it has a control branch."""
        return CONTROL in self.manifest.files

    @property
    def personal(self) -> dict[str, Path]:
        """The denoiser of each person's manner; other manners are those of `DENOISER`."""
        return {manner: self.folder / name for manner, name in self.manifest.personal.items()}

    def control(self, manner: str) -> Path | None:
        """The network with a control branch for requests in a manner; None where the bundle has none for it.

        That of a person's `NAME.onnx` is `NAME-control.onnx`.
        """
        own = self.manifest.personal.get(manner)
        name = CONTROL if own is None else control_of(own)
        return self.folder / name if name in self.manifest.files else None

    @property
    def jacobian(self) -> np.ndarray | None:
        """Derivatives of the decoder's normalised features by its latent, (W, F, L); None where the bundle lacks them.

        Only those of the blocks `root` and `rotations` are stored, others are zero.
        """
        if JACOBIAN not in self.arrays:
            return None
        stored, blocks = self.arrays[JACOBIAN].astype(np.float32), self.layout.blocks
        found = np.zeros((len(stored), self.layout.size, stored.shape[-1]), np.float32)
        found[:, blocks["root"].start : blocks["rotations"].stop] = stored
        return found

    @property
    def prompts(self) -> Prompts:
        """Known wordings."""
        kinds = tuple(str(name) for name in self.arrays["prompt_kinds"])
        return Prompts(kinds, self.arrays["prompt_embeddings"].astype(np.float32))

    @property
    def listener(self) -> Listener:
        """Classifies sentences by kind of motion."""
        return self._listener("listener")

    @property
    def manner_listener(self) -> Listener | None:
        """Classifies phrases by the manner that they say; None before schema 6."""
        return self._listener("manner_listener") if "manner_listener_kinds" in self.arrays else None

    def _listener(self, name: str) -> Listener:
        kinds, pieces = self.arrays[f"{name}_kinds"], self.arrays[f"{name}_pieces"]
        return Listener([str(kind) for kind in kinds], pieces, self.arrays[f"{name}_weights"].astype(np.float32))

    @property
    def manners(self) -> KnownManners:
        """Manners that it was trained on; none where the manner is no input of its network."""
        if not self.manifest.manner:
            return KnownManners((), np.zeros((0, self.prompts.embeddings.shape[1]), np.float32))
        names = tuple(str(name) for name in self.arrays["manner_names"])
        return KnownManners(names, self.arrays["manner_embeddings"].astype(np.float32))

    @property
    def body(self) -> Body:
        """The generated human."""
        size = self.manifest.body
        return Body(size.height, size.mass, size.sex, Segments(**size.segments))

    @property
    def hash(self) -> str:
        """Hash of the manifest, and so of all files that it names."""
        return sha256(self.folder / MANIFEST)[:HASH_LENGTH]

    @property
    def hashes(self) -> tuple[str, ...]:
        """`hash`, and the hashes of the same bundle with its manifest in another schema."""
        others = (found[:HASH_LENGTH] for found in equivalent_hashes(self.manifest))
        return tuple(dict.fromkeys([self.hash, *others]))


def control_of(network: str) -> str:
    """Name of the network with a control branch, by that of the person's denoiser."""
    return network.replace(".onnx", "-control.onnx")


def write_bundle(folder: Path, manifest: Manifest, arrays: dict[str, np.ndarray]) -> Bundle:
    """Complete a folder of exported networks with arrays, hashes and manifest.

    Args:
        folder: with the exported networks.
        manifest: its `files` are filled in.
        arrays: see the properties of `Bundle`.
    """
    np.savez_compressed(folder / ARRAYS, **arrays)  # type: ignore[arg-type]
    # The model card is left out: figures are added to it later.
    bound = [path for path in sorted(folder.iterdir()) if path.is_file() and path.suffix in (".onnx", ".npz", ".txt")]
    files = {path.name: sha256(path) for path in bound}
    write_manifest(manifest.model_copy(update={"files": files}), folder / MANIFEST)
    return Bundle(folder)


def sha256(path: Path) -> str:
    """Hash of a file's content, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
