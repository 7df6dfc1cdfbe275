"""Features of a set are computed once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.configs.errors import MotionFormatError
from flexmotion.dataset.training_set import TrainingSet
from flexmotion.training.feature_store import build_store
from flexmotion.training.run import Run


def test_features_are_computed_once(trained: Run, small_set: Path) -> None:
    store = trained.store()
    written = (store.folder / "features.npy").stat().st_mtime_ns
    again = trained.store(small_set)
    assert (again.folder / "features.npy").stat().st_mtime_ns == written
    assert len(store.features) == len(TrainingSet(small_set))


def test_a_set_of_held_out_clips_alone_is_refused(trained: Run, small_set: Path, tmp_path: Path) -> None:
    """Personalising a model on clips of a style that is held out ended with a traceback of NumPy."""

    class HeldOut(TrainingSet):
        @property
        def clips(self):  # type: ignore[no-untyped-def]
            return tuple(replace(clip, split="validation") for clip in super().clips)

    with pytest.raises(MotionFormatError, match=r"split 'train', but in 'validation'; give .* column 'split'"):
        build_store(HeldOut(small_set), trained.layout, tmp_path)
