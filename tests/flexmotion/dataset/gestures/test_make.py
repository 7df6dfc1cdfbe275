"""`data gestures`: recordings to a folder that `data build` reads."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.build import build
from flexmotion.dataset.clips import find_clips
from flexmotion.dataset.gestures.bases import Base
from flexmotion.dataset.gestures.make import CAPTIONS, INDEX, make_gestures, motions_of
from flexmotion.dataset.meaning import shown
from flexmotion.dataset.settings import BuildSettings
from flexmotion.dataset.training_set import TrainingSet
from flexmotion.gestures.recipes import recipes
from flexmotion.human.motion_file import load_motion, save_motion
from flexmotion.streamer.cli import app

from ....standing_human import clip, standing

RECIPES = {gesture.kind: gesture for gesture in recipes()}
CHOSEN = [RECIPES["point-right"], RECIPES["nod"]]


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    """Two people of CMU who stand, one of them held out, and one who stands in another style."""
    folder = tmp_path / "cmu"
    folder.mkdir()
    for name in ("07_01", "08_01", "09_01"):
        save_motion(standing(5.0), folder / f"{name}.npz")
    (folder / "cmu_index.csv").write_text("trial,split,style\n07_01,train,normal\n08_01,val,normal\n09_01,train,sad\n")
    return folder


def test_gestures_are_clips_with_kind_manner_split_and_time(recordings: Path, tmp_path: Path) -> None:
    out = tmp_path / "gestures"
    made = make_gestures([recordings], out, CHOSEN, count=8, seed=1)
    assert made == {"point-left": 4, "point-right": 4, "nod": 8}
    clips = find_clips([out], tmp_path / "work")
    assert len(clips) == 16 and {one.collection for one in clips} == {"cmu"} and all(one.licence for one in clips)
    assert {one.labels["style"] for one in clips} == {"normal"}
    assert sum(one.split == "validation" for one in clips) == 2, "one of eight motions is over a held-out base"
    for one in clips:
        assert ("08_01" in one.name) == (one.split == "validation") and "09_01" not in one.name
        motion, span = load_motion(one.path), shown(one.labels)
        assert span is not None and span.around == "stand" and 0.3 < span.start < span.end < motion.duration - 0.4
        assert one.captions and all(("left" in text.text) == ("left" in one.labels["content"]) for text in one.captions)
        assert {(text.start, text.end) for text in one.captions} == {(span.start, span.end)}


def test_equal_seeds_make_equal_files(recordings: Path, tmp_path: Path) -> None:
    for name, seed in (("one", 5), ("same", 5), ("other", 6)):
        make_gestures([recordings], tmp_path / name, CHOSEN[:1], count=2, seed=seed)
    one, same, other = (
        {path.name: load_motion(path) for path in sorted((tmp_path / name).rglob("*.npz"))}
        for name in ("one", "same", "other")
    )
    assert list(one) == list(same)
    for name in one:
        np.testing.assert_array_equal(one[name].joints, same[name].joints)
    assert [len(motion) for motion in one.values()] != [len(motion) for motion in other.values()]


def test_a_set_is_built_from_recordings_and_gestures(recordings: Path, tmp_path: Path) -> None:
    """The labels reach the set, and a set that was built before keeps its finished clips."""
    out, made = tmp_path / "set", tmp_path / "gestures"
    settings = BuildSettings(muscles=False)
    build([recordings], out, settings)
    before = {path.name: path.stat().st_mtime_ns for path in (out / "work" / "parts").iterdir()}
    make_gestures([recordings], made, [RECIPES["salute-right-hand"]], count=2, seed=2)
    build([recordings, made], out, settings)
    after = {path.name: path.stat().st_mtime_ns for path in (out / "work" / "parts").iterdir()}
    assert before.items() <= after.items() and len(after) == len(before) + 2
    found = [one for one in TrainingSet(out).clips if one.name.startswith("gesture_")]
    assert len(found) == 4 and {one.info["labels"]["content"] for one in found} == {
        "salute-left-hand",
        "salute-right-hand",
    }
    assert all({"start_s", "left_s", "end_s", "around"} <= one.info["labels"].keys() for one in found)
    assert min(one.info["good_share"] for one in found) > 0.95


def test_over_walking_the_kind_says_so() -> None:
    """A nod over walking is no nod: a standing robot that is asked to nod would walk off."""
    bases = [Base(clip("07_01"), standing(12.0), "stand"), Base(clip("07_02"), standing(12.0), "walk")]
    found = list(motions_of(RECIPES["look-right"], bases, 24, 0))
    kinds = {one.kind for one in found}
    assert kinds == {"look-left", "look-right", "walk-look-left", "walk-look-right"}
    for one in found:
        assert one.kind.startswith("walk-") == (one.base.ground == "walk")
        assert all(text.endswith("while walking") == (one.base.ground == "walk") for text in one.captions)
    assert {one.base.ground for one in motions_of(RECIPES["salute-right-hand"], bases, 8, 0)} == {"stand"}


def test_the_command_writes_the_folder_and_says_what(recordings: Path, tmp_path: Path) -> None:
    out = tmp_path / "gestures"
    asked = ["data", "gestures", str(recordings), "-o", str(out), "--kind", "shrug", "--count", "3", "--json"]
    result = CliRunner().invoke(app, asked)
    assert result.exit_code == 0 and '"shrug": 3' in result.stdout
    with (out / INDEX).open(newline="") as file:
        assert [row["content"] for row in csv.DictReader(file)] == ["shrug"] * 3
    assert (out / CAPTIONS).read_text().count("shrug") >= 3
    unknown = CliRunner().invoke(app, [*asked[:5], "--kind", "juggle"])
    assert unknown.exit_code == 2


def test_a_folder_in_use_and_recordings_without_a_stand_are_refused(recordings: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="exists and is not empty"):
        make_gestures([recordings], recordings, CHOSEN, count=1)
    (recordings / "cmu_index.csv").write_text("trial,split,style\n07_01,train,sad\n08_01,val,sad\n09_01,train,sad\n")
    with pytest.raises(ConfigError, match="in which somebody stands quietly"):
        make_gestures([recordings], tmp_path / "none", CHOSEN, count=1)
