"""Features of a set are computed once."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.configs.errors import ConfigError, MotionFormatError
from flexmotion.dataset.compact import export_compact
from flexmotion.dataset.compact_set import CompactSet
from flexmotion.dataset.training_set import TrainingSet
from flexmotion.training.feature_store import build_store
from flexmotion.training.run import Run
from flexmotion.training.store_index import INDEX


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


def changed(small_set: Path, folder: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """A copy of the set whose manifest is changed."""
    copytree(small_set, folder)
    path = folder / "manifest.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")
    return folder


def without_a_clip(content: dict[str, Any]) -> None:
    del content["clips"][-2:]  # with its mirror image


def of_another_motion(content: dict[str, Any]) -> None:
    content["sha256"]["joints.npy"] = "0" * 64


@pytest.mark.parametrize("other", [without_a_clip, of_another_motion])
def test_a_training_that_has_begun_keeps_its_set(
    trained: Run, small_set: Path, tmp_path: Path, other: Callable[[dict[str, Any]], None]
) -> None:
    """`train --set OTHER` on a begun training replaced features and statistics, and went on with a loss of 71 for 4."""
    run = Run(copytree(trained.folder, tmp_path / "run"))
    features = run.folder / "features"
    before = {path.name: path.read_bytes() for path in features.iterdir()}
    data = changed(small_set, tmp_path / "other", other)
    with pytest.raises(ConfigError) as told:
        run.store(data)
    for part in (f"is on {small_set} (6 clips, ", f"--set is {data} (", "leave --set away", "another folder", "--from"):
        assert part in str(told.value)
    assert {path.name: path.read_bytes() for path in features.iterdir()} == before
    index = features / INDEX
    index.write_text(json.dumps(json.loads(index.read_text()) | {"set": str(data)}))
    with pytest.raises(ConfigError) as told:
        run.store(data)
    assert (f"--set is {data} (6 clips, 600 frames) with other motion;" in str(told.value)) == (
        other is of_another_motion
    )
    assert run.store(copytree(small_set, tmp_path / "moved")).clips == trained.store().clips


def test_a_set_without_held_out_clips_is_refused_before_features_are_computed(
    small_set: Path, stream_config: Path, tmp_path: Path
) -> None:
    """It was refused after them, without the column to mend, and the features of the set before were gone."""

    def learn_all(content: dict[str, Any]) -> None:
        for clip in content["clips"]:
            clip["split"] = "train"

    run = Run(tmp_path / "run", str(stream_config))
    with pytest.raises(MotionFormatError, match=r"split 'validation', but in 'train'; give .* column 'split'"):
        run.store(changed(small_set, tmp_path / "set", learn_all))
    assert not run.has_features


@pytest.mark.parametrize("begun", [True, False])
def test_corrected_splits_labels_and_captions_of_a_set_are_taken(
    trained: Run, small_set: Path, stream_config: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, begun: bool
) -> None:
    """A set built anew with corrected splits had no effect: the descriptions beside old features were kept silently."""

    def correct(content: dict[str, Any]) -> None:
        for clip in content["clips"]:
            clip["split"] = {"train": "validation", "validation": "train"}[clip["split"]]
        content["clips"][0]["labels"]["style"] = "sad"
        content["clips"][1]["captions"].append({"text": "a person", "start": 0.0, "end": 0.0, "source": "own"})

    data = changed(small_set, tmp_path / "set", correct)
    if begun:
        run = Run(copytree(trained.folder, tmp_path / "run"))
    else:
        run = Run(tmp_path / "run", str(stream_config))
        run.store(small_set)
    features, statistics = (run.folder / "features" / name for name in ("features.npy", "statistics.npz"))
    written, before = features.stat().st_mtime_ns, statistics.read_bytes()
    store = run.store(data)
    assert features.stat().st_mtime_ns == written and (statistics.read_bytes() == before) == begun
    assert "split of 6 clips, labels of 1 clip, captions of 1 clip" in caplog.text
    assert ("statistics stay" in caplog.text) == begun
    for clip, old in zip(store.clips, trained.store().clips, strict=True):
        assert clip.split != old.split and clip.start == old.start
    assert store.clips[0].labels["style"] == "sad" and store.clips[1].captions[-1] == "a person"
    caplog.clear()
    run.store(data)
    assert not caplog.records


def test_a_compact_set_is_known_by_its_motion(trained: Run, small_set: Path, tmp_path: Path) -> None:
    """Its file was told by name and header: one that was renamed, or had other labels, was of another motion."""

    def relabel(content: dict[str, Any]) -> None:
        content["clips"][0]["labels"]["style"] = "sad"

    sets = {"one": small_set, "other": changed(small_set, tmp_path / "relabelled", relabel)}
    sets["cut"] = changed(small_set, tmp_path / "cut", without_a_clip)
    for name, folder in sets.items():
        export_compact(TrainingSet(folder), tmp_path / f"{name}.fmset")
    one, other, cut = (CompactSet(tmp_path / f"{name}.fmset") for name in sets)
    assert one.hashes == other.hashes != cut.hashes
    build_store(one, trained.layout, tmp_path / "features")
    begun = build_store(other, trained.layout, tmp_path / "features", begun=True)
    assert begun.clips[0].labels["style"] == "sad"
    index = tmp_path / "features" / INDEX
    content = json.loads(index.read_text()) | {"key": "of an earlier version"}
    index.write_text(json.dumps({name: value for name, value in content.items() if name != "set"}))
    assert build_store(other, trained.layout, tmp_path / "features", begun=True).clips == begun.clips
