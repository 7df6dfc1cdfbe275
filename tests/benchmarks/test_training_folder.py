"""A benchmark reads a training folder, or makes one of a weights file and a set."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from benchmarks.shared.linked_run import COPIED, linked_run
from benchmarks.shared.training_folder import training_folder
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import load_model_config


def source(folder: Path) -> SimpleNamespace:
    (folder / "features").mkdir(parents=True)
    for name in COPIED:
        (folder / name).write_bytes(b"{}")
    return SimpleNamespace(folder=folder)


def test_a_run_beside_another_shares_its_data(tmp_path: Path) -> None:
    config, other = load_model_config("stream"), source(tmp_path / "training")
    run = linked_run(other, tmp_path / "beside", config, 3, ["features"])  # type: ignore[arg-type]
    assert (run.folder / "features").resolve() == other.folder / "features" and run.seed == 3
    # Without its origin such a run normalised features by their own statistics, and not by those of the weights.
    assert all((run.folder / name).read_bytes() == b"{}" for name in COPIED)
    assert linked_run(other, tmp_path / "beside", config, 3, ["features"]).config == run.config  # type: ignore[arg-type]


def test_a_run_is_not_continued_with_the_data_of_another(tmp_path: Path) -> None:
    config = load_model_config("stream")
    linked_run(source(tmp_path / "first"), tmp_path / "beside", config, 0, ["features"])  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="its features are those of another training"):
        linked_run(source(tmp_path / "second"), tmp_path / "beside", config, 0, ["features"])  # type: ignore[arg-type]


def test_a_weights_file_has_no_clips(tmp_path: Path) -> None:
    weights = tmp_path / "some.safetensors"
    weights.touch()
    with pytest.raises(ConfigError, match="a weights file has no clips; give --set"):
        training_folder(weights, tmp_path / "made", None, ["evaluator"])
