"""`Run`: a folder in which a model is trained, stage by stage."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from flexmotion.bundles.manifest import CORRECTIONS_OF_3
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import ModelConfig, load_model_config
from flexmotion.configs.schema import Strict, parse, read_yaml
from flexmotion.dataset.collections import only
from flexmotion.dataset.compact_set import open_set
from flexmotion.dataset.fields import MUSCLES
from flexmotion.features.layout import Layout
from flexmotion.training.checkpoints import BEST, LAST, is_trained
from flexmotion.training.feature_store import HELD_OUT, FeatureStore, build_store, require_split
from flexmotion.training.format import CONFIG_VERSIONS, FORMAT, UNVERSIONED
from flexmotion.training.muscle_torques import MuscleTorques, fit_muscle_torques, load_muscle_torques
from flexmotion.training.set_summary import SetSummary, summarise
from flexmotion.training.store_index import INDEX

CONFIG, FEATURES = "config.yaml", "features"
CORRECTIONS_FROM = 2
"""First format of `CONFIG` with corrections."""
PERSONAL = "personal.json"
"""Wordings of a personalised run, beside those that every run has."""
PERSON = "person"
"""Folder of the features of a personalised run's own clips."""
BEFORE = "before"
"""Link of a personalised run to the training whose denoiser it fine-tunes."""
RELEASED = "released"
"""Folder of that training where it is made of a weights file."""
ORIGIN = "origin.json"
"""Release that a run began from."""


class _Saved(Strict):
    """Content of `CONFIG`; before format `CORRECTIONS_FROM` the corrections were constants of the program."""

    format: int = UNVERSIONED
    seed: int
    model: ModelConfig


@dataclass(frozen=True)
class Origin:
    """The release that a run began from: its name and its hash."""

    name: str
    hash: str


class Run:
    """Configuration, seed and data of a training, and the folders of its stages.

    Args:
        folder: of the training; a new one, or one to resume.
        config: name or file of the configuration; None for the one in the folder.
        seed: of everything drawn; None for the one in the folder, 0 in a new folder.

    Raises:
        ConfigError: no configuration is given and the folder has none, the folder has another one (the message names
            the fields), or its format is too old or too new.
    """

    def __init__(self, folder: Path, config: str | None = None, seed: int | None = None) -> None:
        self.folder = folder
        path = folder / CONFIG
        if path.is_file():
            content = read_yaml(path)
            CONFIG_VERSIONS.check(content.get("format", UNVERSIONED), path)
            saved = _read_saved(content, path)
            asked = saved.model if config is None else load_model_config(config)
            if "corrections" not in asked.model_fields_set:
                asked = asked.model_copy(update={"corrections": saved.model.corrections})
            if found := different_settings(saved.model, asked):
                raise ConfigError(f"{path}: the training there has other settings; use another folder: {found}")
            if seed not in (None, saved.seed):
                raise ConfigError(f"{path}: the training there has seed {saved.seed}; use another folder")
            self.config, self.seed = asked, saved.seed
        elif config is None:
            raise ConfigError(f"{path}: not found; name a configuration to start with")
        else:
            self.config, self.seed = load_model_config(config), seed or 0
        _write_config(folder, self.config, self.seed)

    @classmethod
    def begin(cls, folder: Path, config: ModelConfig, seed: int, origin: Origin) -> Run:
        """A run that begins from a release; an existing one that began from the same release is resumed.

        Raises:
            ConfigError: the folder holds another training.
        """
        if (folder / CONFIG).is_file():
            run = cls(folder)
            if run.origin != origin:
                raise ConfigError(f"{folder}: holds a training that did not begin from this file; use another folder")
            if found := different_settings(run.config, config):
                raise ConfigError(f"{folder}: holds a training with other settings: {found}")
            return run
        _write_config(folder, config, seed)
        (folder / ORIGIN).write_text(json.dumps(asdict(origin)), encoding="utf-8")
        return cls(folder)

    @property
    def origin(self) -> Origin | None:
        """The release that it began from; None for a run from the beginning."""
        path = self.folder / ORIGIN
        return Origin(**json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else None

    @property
    def layout(self) -> Layout:
        """Layout of the features."""
        return layout_of(self.config)

    def stage(self, name: str) -> Path:
        """Folder of a stage."""
        return self.folder / name

    def store(
        self,
        data: Path | None = None,
        progress: Callable[[float], None] = lambda done: None,
        collections: Sequence[str] = (),
    ) -> FeatureStore:
        """Features of a set, computed on first use; without a set, those computed before.

        A run that began from a release keeps the statistics by which the release's networks see features. A training
        that has begun keeps its set.

        Args:
            data: training set; None to open the features in the folder.
            progress: called with the share done, 0 to 1.
            collections: of the set, as `flexmotion.dataset.collections.only` takes them; none: all.

        Raises:
            ConfigError: the features have not been computed, or their format is too old or too new, or the set lacks
                one of the collections, or the training that has begun is on another set.
            MotionFormatError: there is no set, or it lacks a field, or clips to train on.
        """
        folder = self.folder / FEATURES
        if data is not None:
            source = only(open_set(data), collections)
            require_split(source, HELD_OUT, "to validate on")
            store = build_store(source, self.layout, folder, progress, begun=self.is_begun)
        elif self.has_features:
            store = FeatureStore(folder)
        else:
            raise ConfigError(f"{folder}: no features; name the training set once")
        if self.origin is not None:
            store.statistics = SetSummary.read(self.folder).statistics
        return store

    @property
    def is_begun(self) -> bool:
        """Whether a stage has been trained here; weights of a release have statistics of their own, and no set yet."""
        names = (LAST,) if self.origin is not None else (LAST, BEST)
        return any(next(self.folder.glob(f"*/{name}"), None) is not None for name in names)

    @property
    def has_features(self) -> bool:
        """Whether the features of a set have been computed."""
        return (self.folder / FEATURES / INDEX).is_file()

    def summary(self) -> SetSummary:
        """What a bundle needs of the training set; of a run from a release without a set of its own, the release's.

        The licences are those of all clips that the weights depend on.

        Raises:
            ConfigError: there is neither a set nor a release.
        """
        begun = None if self.origin is None else SetSummary.read(self.folder)
        if begun is not None and not self.has_features:
            found = begun
        else:
            found = summarise(self.store(), self.config.window, self.seed)
        licences = {*found.licences, *(begun.licences if begun else ())}
        if (self.folder / PERSON / INDEX).is_file():
            licences |= set(FeatureStore(self.folder / PERSON).licences)
        return replace(found, licences=tuple(sorted(licences)))

    def begun(self, stage: str) -> Path | None:
        """Folder of the weights that a stage goes on from; None for a run from the beginning, or a new stage."""
        return self.stage(stage) if self.origin is not None and is_trained(self.stage(stage)) else None

    def muscles(self, data: Path | None = None) -> MuscleTorques | None:
        """Muscle torques for their loss, fitted on first use; None where the configuration has no such loss.

        Args:
            data: training set to fit to; None to read the fit in the folder.

        Raises:
            ConfigError: they have not been fitted and no set is named, or `myo-sim` is not installed.
        """
        if not self.config.window.muscles or not self.config.losses.muscle_torques:
            return None
        path = self.folder / "muscle_torques.npz"
        if data is not None and not path.is_file():
            fit_muscle_torques(open_set(data), path, self.seed)
        if not path.is_file():
            raise ConfigError(f"{path}: not found; name the training set once")
        return load_muscle_torques(path)

    def personal_wordings(self) -> tuple[str, ...]:
        """Prompts for the manner that a run was personalised to; none for other runs."""
        path = self.folder / PERSONAL
        return tuple(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else ()

    @property
    def has_before(self) -> bool:
        """Whether the training that a personalised run began from is known and there."""
        return (self.folder / BEFORE / CONFIG).is_file()

    def before(self) -> Run:
        """The training that a personalised run began from; it may be that of another person.

        Raises:
            ConfigError: it is not where it was, or is not known.
        """
        link = self.folder / BEFORE
        if not self.has_before:
            where = f"{link.readlink()} is not there" if link.is_symlink() else f"{link}: not found"
            raise ConfigError(
                f"{self.folder}: the training that it began from: {where}; run 'flexmotion personalize' again with it,"
                " or export with --onto BUNDLE"
            )
        return Run(link.resolve())

    def link_before(self, trained: Run) -> None:
        """Remember the training that a personalised run begins from.

        Raises:
            ConfigError: it began from another one.
        """
        link = self.folder / BEFORE
        if not link.is_symlink():  # relative: both folders may be moved together
            target = os.path.relpath(trained.folder.resolve(), self.folder.resolve())
            link.symlink_to(target, target_is_directory=True)
        elif link.resolve() != trained.folder.resolve():
            raise ConfigError(f"{self.folder}: holds a personalisation of {link.readlink()}; use another folder")

    def fingerprint(self) -> str:
        """SHA-256 of what the weights depend on: networks, windows, seed."""
        content = json.dumps([_fixed(self.config), self.seed, self.layout.hash], sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()


def layout_of(config: ModelConfig) -> Layout:
    """Layout of a configuration's features."""
    window = config.window
    return Layout(window.fps, MUSCLES if window.muscles else 0, joint_contact=window.joint_contact)


def different_settings(first: ModelConfig, second: ModelConfig) -> str:
    """Settings of networks and windows in which two configurations differ, as text; empty where they are the same."""
    ours, theirs = _flat(_fixed(first)), _flat(_fixed(second))
    names = [name for name in ours | theirs if ours.get(name) != theirs.get(name)]
    return "; ".join(f"{name} is {ours.get(name)}, asked for {theirs.get(name)}" for name in names)


def _flat(content: dict[str, Any], begin: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in content.items():
        found |= _flat(value, f"{begin}{name}.") if isinstance(value, dict) else {begin + name: value}
    return found


def _write_config(folder: Path, config: ModelConfig, seed: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / CONFIG
    # Replaced in one step: the processes of one training open the folder at the same time.
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    content = _Saved(format=FORMAT, seed=seed, model=config).model_dump()
    temporary.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    os.replace(temporary, path)


def _read_saved(content: dict[str, Any], path: Path) -> _Saved:
    saved = parse(_Saved, content, path)
    if saved.format >= CORRECTIONS_FROM or "corrections" in saved.model.model_fields_set:
        return saved
    return saved.model_copy(update={"model": saved.model.model_copy(update={"corrections": CORRECTIONS_OF_3})})


def _fixed(config: ModelConfig) -> dict[str, Any]:
    """Settings that must stay the same while a training is resumed: all but durations, rates and loss weights."""
    content = config.model_dump(exclude={"stages", "losses", "corrections", "control"})
    free = set(type(config.diffusion).model_fields) - {"denoiser", "steps", "text", "velocity"}
    content["diffusion"] = {name: value for name, value in content["diffusion"].items() if name not in free}
    # Trainings from before these settings existed resume as without them.
    for part, name in (("window", "joint_contact"), ("autoencoder", "loads")):
        if not content[part][name]:
            del content[part][name]
    return content
