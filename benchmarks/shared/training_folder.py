"""`training_folder`: the training that a benchmark reads, from a training folder or from a release."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.progress import Progress

from flexmotion.configs.errors import ConfigError
from flexmotion.training.release import begin_run
from flexmotion.training.run import FEATURES, Run


def training_folder(path: Path, made: Path, data: Path | None, stages: Sequence[str], *, muscles: bool = False) -> Run:
    """A run with features and stages.

    Args:
        path: a training folder, or a weights file.
        made: folder for the training that begins from a weights file; one that is there already is resumed.
        data: training set; needed for a weights file until `made` has its features.
        stages: that are taken over from a weights file and the files beside it.
        muscles: whether muscle torques are fitted as well, for a training that has their loss.

    Raises:
        ConfigError: no set is given for a weights file, or the file lacks a stage.
    """
    if not path.is_file():
        return Run(path)
    if data is None and not (made / FEATURES).is_dir():
        raise ConfigError(f"{path}: a weights file has no clips; give --set")
    run = begin_run(path, made, stages)
    with Progress(transient=True) as progress:
        task = progress.add_task("features", total=1.0)
        run.store(data, lambda done: progress.update(task, completed=done))
    if muscles:
        run.muscles(data)
    return run
