"""Clips of some collections of a set: by name, or those whose terms allow products."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.build import build
from flexmotion.dataset.collections import only
from flexmotion.dataset.compact_set import open_set
from flexmotion.dataset.settings import BuildSettings
from flexmotion.features.layout import Layout
from flexmotion.human.motion import Motion
from flexmotion.streamer.cli import execute


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory, clip: Motion, write_bvh: Callable[..., Path]) -> Path:
    """A set of one clip of each of two collections."""
    folder = tmp_path_factory.mktemp("mixed")
    for name, motion in (("cmu/01_01.bvh", clip[240:330]), ("bandai/walk_normal_001.bvh", clip[240:330])):
        (folder / name).parent.mkdir()
        write_bvh(folder / name, motion)
    build([folder / "cmu", folder / "bandai"], folder / "set", BuildSettings(muscles=False))
    return folder / "set"


def test_a_selection_is_a_set_of_its_own(mixed: Path) -> None:
    """It has its own hash: features of the whole set are not taken for those of the selection."""
    whole = open_set(mixed)
    free = only(whole, ["commercial"])
    assert {clip.info["collection"] for clip in free.clips} == {"cmu"} and 0 < len(free.clips) < len(whole.clips)
    assert {clip.info["licence"].partition(",")[0] for clip in free.clips} == {
        "CMU Graphics Lab Motion Capture Database"
    }
    assert free.hashes != whole.hashes and only(whole, ["cmu"]).hashes not in (free.hashes, whole.hashes)
    assert [clip.name for clip in free.select(variant="original")] == ["01_01"]
    assert len(free.motion(free.clips[0])) == free.clips[0].frames
    assert only(whole, []) is whole


def test_captions_for_research_are_left_out_of_what_is_free(mixed: Path) -> None:
    """Regression: a model for products was taught sentences of a motion-language set, which are for research."""
    whole = open_set(mixed)
    said = [{"start": 0.0, "end": 0.0, "text": source, "source": source} for source in ("kit_ml", "cmu_index", "")]
    for clip in whole.clips:
        clip.info["captions"] = said
    texts = {
        names: {caption["text"] for clip in only(whole, names.split(",")).clips for caption in clip.info["captions"]}
        for names in ("commercial", "commercial,cmu", "cmu", "commercial,bandai")
    }
    every = {"kit_ml", "cmu_index", ""}
    assert texts == {
        "commercial": {"cmu_index"},
        "commercial,cmu": {"cmu_index"},
        "cmu": every,
        "commercial,bandai": every,
    }


def test_a_collection_that_is_not_there_is_named(mixed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ConfigError, match=r"--only amass: the set has no such collection, expected bandai, cmu"):
        only(open_set(mixed), ["amass"])
    pytest.importorskip("torch", reason="training needs the extra 'train'")
    out = ["-o", str(mixed.parent / "run"), "--config", "stream"]
    assert execute(["train", "autoencoder", "--set", str(mixed), "--only", "amass", *out]) == 2
    assert "expected bandai, cmu" in capsys.readouterr().err


def test_features_of_a_selection_have_its_licence_alone(mixed: Path, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="training needs the extra 'train'")
    from flexmotion.training.feature_store import build_store

    store = build_store(only(open_set(mixed), ["commercial"]), Layout(30.0, 0), tmp_path / "features")
    assert [licence.partition(" ")[0] for licence in store.licences] == ["CMU"]
    assert {clip.name for clip in store.clips} == {"01_01", "01_01~mirror"}
