"""Lists of motions: what they hold, and what is wrong with a bad one."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.human.motion_file import save_motion
from flexmotion.streamer.checks.switching import shipped_clips
from flexmotion.streamer.motion.intents import Clip, Text, Velocity
from flexmotion.streamer.tuning.clip_list import SHIPPED, ClipList, refuse_shared


def listed(tmp_path: Path, text: str, name: str = "list.yaml") -> ClipList:
    (tmp_path / name).write_text(text, encoding="utf-8")
    return ClipList(str(tmp_path / name))


def test_every_second_entry_of_a_kind_is_perturbed(tmp_path: Path) -> None:
    save_motion(shipped_clips()["walk"], tmp_path / "walk.npz")
    (tmp_path / "show.yaml").write_text("- {at: 0, clip: walk.npz}\n- {at: 2, stop: true}\n")
    text = "walking:\n- walk.npz\n- {text: walk forward, seconds: 3}\n- {script: show.yaml}\n"
    clips = listed(tmp_path, text + "turning: [{velocity: [0.4, 0, 0.5], seconds: 2}]\n").clips
    assert [(clip.kind, clip.name, clip.perturbed) for clip in clips] == [
        ("walking", "walk.npz", False),
        ("walking", "walk forward", True),
        ("walking", "show.yaml", False),
        ("turning", "velocity 0.4, 0, 0.5", False),
    ]
    first, words, script, turn = (clip.items[0].intent for clip in clips)
    assert first == script == Clip(str(tmp_path / "walk.npz"))
    assert (words, turn) == (Text("walk forward"), Velocity(0.4, 0.0, 0.5))
    assert [clip.seconds for clip in clips] == [None, 3.0, None, 2.0]


def test_the_shipped_lists_share_no_clip() -> None:
    lists = {name: ClipList(name) for name in SHIPPED}
    refuse_shared(lists["tuning"], lists["reporting"])
    for one in lists.values():
        assert {"walking", "turning", "standing"} == {clip.kind for clip in one.clips}


@pytest.mark.parametrize(
    ("tuned", "reported", "shared"),
    [
        ("{text: walk forward, seconds: 3}", "{text: Walk  forward, seconds: 9}", "Walk  forward"),
        ("{velocity: [0.5, 0, 0], seconds: 3}", "{velocity: [0.5, 0, 0], seconds: 4}", "velocity 0.5, 0, 0"),
        ("a.npz", "{clip: b.npz, seconds: 1}", "b.npz"),
    ],
)
def test_lists_that_share_a_clip_are_refused(tuned: str, reported: str, shared: str, tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        save_motion(shipped_clips()["walk"], tmp_path / name)
    if "npz" in tuned:
        (tmp_path / "b.npz").write_bytes((tmp_path / "a.npz").read_bytes())
    one = listed(tmp_path, f"walking: [{tuned}]", "one.yaml")
    other = listed(tmp_path, f"walking: [{{text: turn left, seconds: 2}}, {reported}]", "other.yaml")
    with pytest.raises(ConfigError, match=f"share {shared}: a robot is reported on other motion"):
        refuse_shared(one, other)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("- walk.npz", "expected a mapping of fields, found list"),
        ("{}", "has no clips"),
        ("walking: walk.npz", "field walking: expected a list of clips, found str"),
        ("walking: []", "field walking: expected a list of clips"),
        ("walking: [3]", "walking, entry 1: expected a file or a mapping, found int"),
        ("walking: [gone.npz]", "walking, entry 1: no such file: "),
        ("walking: [{text: walk}]", "walking, entry 1: field (file): text goes on without an end; give seconds"),
        ("walking: [{seconds: 2}]", "expected one of clip, script, text and velocity, found none"),
        ("walking: [{text: a, velocity: [1, 0, 0], seconds: 2}]", "found text and velocity"),
        ("walking: [{texts: a, seconds: 2}]", "walking, entry 1: field texts: "),
        ("walking: [{velocity: [9, 0, 0], seconds: 2}]", "walking, entry 1: velocity: expected"),
        ("walking: [{text: ' ', seconds: 2}]", "walking, entry 1: text: "),
    ],
)
def test_a_bad_list_names_file_entry_and_what_would_be_valid(text: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        listed(tmp_path, text)
    assert told in str(caught.value) and str(tmp_path / "list.yaml") in str(caught.value)


def test_an_unknown_list_names_the_shipped_ones() -> None:
    with pytest.raises(ConfigError, match="list of clips hal: no such file, and none of: tuning, reporting"):
        ClipList("hal")
