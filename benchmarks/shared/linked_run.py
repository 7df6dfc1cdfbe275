"""`linked_run`: a training folder of a benchmark that shares data and stages with another one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from shutil import copyfile

import yaml

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import ModelConfig
from flexmotion.training.run import Run

COPIED = ("muscle_torques.npz", "origin.json", "summary.npz")
"""Files of a training folder that belong to its data: with the origin features are normalised as the release's are."""


def linked_run(source: Run, folder: Path, config: ModelConfig, seed: int, parts: Sequence[str]) -> Run:
    """A run with links to parts of another one: a new one, or one that continues.

    Args:
        source: the other run.
        folder: of the new one.
        config: of the new one.
        seed: of the new one.
        parts: folders of `source` that are linked, such as `features`.

    Raises:
        ConfigError: a part of the folder is that of another training, or the folder has another configuration.
    """
    folder.mkdir(parents=True, exist_ok=True)
    wanted = folder / "wanted.yaml"
    wanted.write_text(yaml.safe_dump(config.model_dump(), sort_keys=False), encoding="utf-8")
    for part in parts:
        link, there = folder / part, (source.folder / part).resolve()
        if link.exists() and link.resolve() != there:
            raise ConfigError(
                f"{folder}: its {part} are those of another training, {link.resolve()}; use another folder"
            )
        if not link.exists():
            link.symlink_to(there, target_is_directory=True)
    for name in COPIED:
        if (source.folder / name).is_file():
            copyfile(source.folder / name, folder / name)
    return Run(folder, str(wanted), seed)
