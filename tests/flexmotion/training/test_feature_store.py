"""Features of a set are computed once."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.dataset.training_set import TrainingSet
from flexmotion.training.run import Run


def test_features_are_computed_once(trained: Run, small_set: Path) -> None:
    store = trained.store()
    written = (store.folder / "features.npy").stat().st_mtime_ns
    again = trained.store(small_set)
    assert (again.folder / "features.npy").stat().st_mtime_ns == written
    assert len(store.features) == len(TrainingSet(small_set))
