"""`Run`: a folder in which a model is trained, stage by stage."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import ModelConfig, load_model_config
from flexmotion.configs.schema import parse
from flexmotion.dataset.compact_set import open_set
from flexmotion.dataset.fields import MUSCLES
from flexmotion.features.layout import Layout
from flexmotion.training.feature_store import FeatureStore, build_store
from flexmotion.training.muscle_torques import MuscleTorques, fit_muscle_torques, load_muscle_torques

CONFIG = "config.yaml"
PERSONAL = "personal.json"
"""Wordings that a personalised run has beside those that all have."""


class Run:
    """Configuration, seed and data of a training, and the folders of its stages.

    Args:
        folder: a new one, or one in which training goes on.
        config: name or file of the configuration; None for the one that the folder holds.
        seed: of everything; as `config`.

    Raises:
        ConfigError: no configuration is given and none is there, or another one is.
    """

    def __init__(self, folder: Path, config: str | None = None, seed: int | None = None) -> None:
        self.folder = folder
        path = folder / CONFIG
        if path.is_file():
            content: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
            self.config, self.seed = parse(ModelConfig, content["model"], path), int(content["seed"])
            asked = self.config if config is None else load_model_config(config)
            if _lasting(asked) != _lasting(self.config) or seed not in (None, self.seed):
                raise ConfigError(f"{path}: training there has other settings or another seed; take another folder")
            self.config = asked
        elif config is None:
            raise ConfigError(f"{path}: not there; name a configuration to begin with")
        else:
            self.config, self.seed = load_model_config(config), seed or 0
        folder.mkdir(parents=True, exist_ok=True)
        content = {"seed": self.seed, "model": self.config.model_dump()}
        path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")

    @property
    def layout(self) -> Layout:
        """Of the features."""
        window = self.config.window
        return Layout(window.fps, MUSCLES if window.muscles else 0)

    def stage(self, name: str) -> Path:
        """Folder of a stage."""
        return self.folder / name

    def store(self, data: Path | None = None, progress: Callable[[float], None] = lambda done: None) -> FeatureStore:
        """Features of a set; without one those that were computed before.

        Raises:
            ConfigError: they have not been computed.
            MotionFormatError: there is no set, or it lacks a field.
        """
        folder = self.folder / "features"
        if data is not None:
            return build_store(open_set(data), self.layout, folder, progress)
        if not (folder / "index.json").is_file():
            raise ConfigError(f"{folder}: no features there; name the training set once")
        return FeatureStore(folder)

    def muscles(self, data: Path | None = None) -> MuscleTorques | None:
        """Torques of the muscles, for their loss; None where the configuration wants none.

        Raises:
            ConfigError: they have not been fitted and no set is named, or `myo-sim` is not installed.
        """
        if not self.config.window.muscles or not self.config.losses.muscle_torques:
            return None
        path = self.folder / "muscle_torques.npz"
        if data is not None and not path.is_file():
            fit_muscle_torques(open_set(data), path, self.seed)
        if not path.is_file():
            raise ConfigError(f"{path}: not there; name the training set once")
        return load_muscle_torques(path)

    def personal_wordings(self) -> tuple[str, ...]:
        """Sentences that ask for the manner a run was personalised to; none for others."""
        path = self.folder / PERSONAL
        return tuple(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else ()

    def fingerprint(self) -> str:
        """Of what weights depend on: networks, windows, seed."""
        content = json.dumps([_lasting(self.config), self.seed, self.layout.hash], sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()


def _lasting(config: ModelConfig) -> dict[str, Any]:
    """What may not change between the starts of one training: all but how long, how fast and weighed how."""
    content = config.model_dump(exclude={"stages", "losses", "corrections"})
    free = set(type(config.diffusion).model_fields) - {"denoiser", "steps", "text", "velocity"}
    content["diffusion"] = {name: value for name, value in content["diffusion"].items() if name not in free}
    return content
