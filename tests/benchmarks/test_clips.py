"""Lists of clips and the archives that they are read from; runs in processes."""

from __future__ import annotations

import os
import tarfile
from pathlib import Path

import pytest

from benchmarks.robot.clip_run import ClipRun
from benchmarks.robot.clips import CLIPS, equal_bytes
from benchmarks.shared.clips import VARIABLE, ClipList, data_folder, extract, extracted
from benchmarks.shared.processes import in_order
from flexmotion.configs.errors import ConfigError


@pytest.fixture
def archive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Motion data of three clips `a`, `b`, `c` of the collection `cmu`."""
    data = tmp_path / "shared" / "data"
    data.mkdir(parents=True)
    with tarfile.open(data / "cmu_raw.tar.xz", "w:xz") as stream:
        for name in "abc":
            (tmp_path / f"{name}.bvh").write_text(f"clip {name}")
            stream.add(tmp_path / f"{name}.bvh", f"cmu/{name}.bvh")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "shared"))
    return data


def test_named_clips_are_extracted(archive: Path, tmp_path: Path) -> None:
    assert data_folder() == archive
    with extracted({"cmu": ["a", "c"]}) as folder:
        assert sorted(path.name for path in folder.iterdir()) == ["a.bvh", "c.bvh"]
        assert (folder / "c.bvh").read_text() == "clip c"
    assert not folder.exists()
    with pytest.raises(ConfigError, match=r"cmu: no clip d\.bvh"):
        extract("cmu", ["a", "d"], tmp_path)
    with pytest.raises(ConfigError, match=r"no file bandai\.tar\.xz"):
        extract("bandai", ["a"], tmp_path)


def test_without_motion_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    with pytest.raises(ConfigError, match=f"set {VARIABLE}"):
        data_folder()


def test_every_second_clip_of_a_kind_is_perturbed(tmp_path: Path) -> None:
    file = tmp_path / "clips.yaml"
    file.write_text("standing: {cmu: [a], bandai: [b]}\nwalking: {cmu: [c, d]}\n")
    listed = ClipList(file)
    assert [(clip.kind, clip.name, clip.perturbed) for clip in listed.clips] == [
        ("standing", "a", False),
        ("standing", "b", True),
        ("walking", "c", False),
        ("walking", "d", True),
    ]
    assert listed.by_collection == {"cmu": ["a", "c", "d"], "bandai": ["b"]}
    assert [clip.name for clip in ClipList(file, ["walking"]).clips] == ["c", "d"]
    file.write_text("standing: {other: [a]}\n")
    with pytest.raises(ConfigError, match="unknown collections other, expected some of bandai, cmu"):
        ClipList(file)
    with pytest.raises(ConfigError, match="cannot be read"):
        ClipList(tmp_path / "none.yaml")


def test_the_list_of_the_project_has_each_kind() -> None:
    listed = ClipList(CLIPS)
    assert {clip.kind for clip in listed.clips} == {"standing", "walking", "turning"}
    names = [name for own in listed.by_collection.values() for name in own]
    assert len(set(names)) == len(names) == len(listed.clips)


def run_of(**motion: object) -> ClipRun:
    figures = {"fell": False, "net_path_ratio": 0.5, "human_steps": 10, "steps_planned": 9, "steps_inserted": 1}
    joints = {"l_knee": {"rms_share_of_stall": 0.3}, "r_knee": {"rms_share_of_stall": 0.4}, "head": {}}
    return ClipRun("walking", "a", False, {"motion": figures | motion, "limits": {"joints": joints}, "loop": {"x": 1}})


def test_who_walked() -> None:
    assert run_of().walked and run_of().steps == 8 and run_of().knee == 0.4
    assert run_of(net_path_ratio=None).walked
    for other in ({"fell": True}, {"net_path_ratio": 0.39}, {"steps_inserted": 2}):
        assert not run_of(**other).walked


def test_reports_of_two_runs_may_differ_in_their_timing_alone() -> None:
    one, two = run_of(), run_of()
    two.report["loop"]["x"] = 2
    assert equal_bytes(one, two)
    two.report["motion"]["human_steps"] = 11
    assert not equal_bytes(one, two)


def test_runs_in_processes_keep_their_order_and_have_one_thread() -> None:
    assert in_order(os.getenv, ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"], 2) == ["1", "1", "1"]
    found = in_order(abs, range(-5, 0), 2)
    assert found == [5, 4, 3, 2, 1]
