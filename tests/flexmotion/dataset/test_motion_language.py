"""Motion-language sets in the layout of HumanML3D and KIT-ML."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import MotionFormatError
from flexmotion.dataset.captions import Caption
from flexmotion.dataset.clips import find_clips
from flexmotion.dataset.motion_language import read_texts

LINES = """a man walks forward.#a/DET man/NOUN walk/VERB forward/ADV#0.0#0.0
he waves#he/PRON wave/VERB#1.5#3.25
someone stops#someone/PRON stop/VERB#nan#nan
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A set of three clips and one mirror image."""
    root = tmp_path / "HumanML3D"
    for name in ("new_joints", "texts"):
        (root / name).mkdir(parents=True)
    for name in ("000001", "M000001", "000002", "000003"):
        np.save(root / "new_joints" / f"{name}.npy", np.zeros((40, 22, 3), np.float32))
        (root / "texts" / f"{name}.txt").write_text(LINES, encoding="utf-8")
    for name, members in (("train", "000001\nM000001"), ("val", "000002"), ("test", "000003"), ("all", "000003")):
        (root / f"{name}.txt").write_text(members, encoding="utf-8")
    return root


def test_texts_times_and_splits_are_read(folder: Path, tmp_path: Path) -> None:
    """Regression: only the joints of such a set were read, so that no sentence was learnt from it."""
    clips = {clip.name: clip for clip in find_clips([folder], tmp_path / "work")}
    assert {name: clip.split for name, clip in clips.items()} == {
        "000001": "train",
        "000002": "validation",
        "000003": "test",
    }
    assert clips["000001"].captions == (
        Caption(0.0, 0.0, "a man walks forward.", "HumanML3D"),
        Caption(1.5, 3.25, "he waves", "HumanML3D"),
        Caption(0.0, 0.0, "someone stops", "HumanML3D"),
    )


def test_a_mirror_image_without_its_original_is_a_clip(folder: Path, tmp_path: Path) -> None:
    (folder / "new_joints" / "000001.npy").unlink()
    assert "M000001" in {clip.name for clip in find_clips([folder], tmp_path / "work")}


@pytest.mark.parametrize("line", ["walks#walk/VERB#2.0#1.0", "walks#walk/VERB#soon#1.0", "#walk/VERB#0.0#0.0"])
def test_invalid_lines_are_named(folder: Path, line: str) -> None:
    path = folder / "texts" / "000002.txt"
    path.write_text(f"{LINES}{line}\n", encoding="utf-8")
    with pytest.raises(MotionFormatError, match="000002.txt, line 4"):
        read_texts(path)
