"""Files of one clip: what is written is read back, described, and complete or not there."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from flexmotion.biomechanics.analysis import ClipAnalysis, Recording, analyse
from flexmotion.biomechanics.dynamics_files import WRITERS, dynamics_writer, quantities, write_files
from flexmotion.configs.errors import ConfigError
from flexmotion.human.motion import Motion
from flexmotion.human.motion_file import load_motion


@pytest.fixture(scope="module")
def analysed(clip: Motion) -> ClipAnalysis:
    return analyse(clip[:45], muscles=False, recording=Recording(start=2.5))


@pytest.fixture(scope="module")
def with_muscles(clip: Motion) -> ClipAnalysis:
    pytest.importorskip("myo_sim", reason="extra biomech")
    return analyse(clip[:30])


def test_npz_is_a_motion_file_with_more_arrays(analysed: ClipAnalysis, tmp_path: Path) -> None:
    file = tmp_path / "walk.npz"
    write_files(dynamics_writer(file)(file, analysed))
    motion, original = load_motion(file), analysed.dynamics.motion
    assert motion.fps == original.fps and motion.body == original.body
    assert np.array_equal(motion.joints, original.joints)
    assert motion.torques is not None and np.array_equal(motion.torques, original.torques)
    with np.load(file, allow_pickle=False) as archive:
        fields = json.loads(str(archive["header"]))["dynamics"]["fields"]
        for name, item in quantities(analysed).items():
            assert np.array_equal(archive[name], item.values), name
            assert fields[name]["columns"] == list(item.columns)
        # Every array is described, with a name for every value of a frame.
        assert set(archive.files) == {"header", *fields}
        assert all(len(field["columns"]) * len(motion) == archive[name].size for name, field in fields.items())


def test_csv_is_read_back(analysed: ClipAnalysis, tmp_path: Path) -> None:
    file = tmp_path / "walk.csv"
    write_files(dynamics_writer(file)(file, analysed))
    lines = file.read_text().splitlines()
    comments = [line for line in lines if line.startswith("#")]
    assert any("30 Hz" in line for line in comments) and any("z up" in line for line in comments)
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert len(rows) == len(analysed)
    assert float(rows[0]["time_s"]) == 2.5
    for item in quantities(analysed).values():
        values = item.values.reshape(len(analysed), -1).astype(np.float64)
        for column, name in enumerate(item.columns):
            assert [float(row[name]) for row in rows] == pytest.approx(values[:, column], rel=1e-7, abs=1e-7), name


def test_columns_have_names_of_their_own(with_muscles: ClipAnalysis, tmp_path: Path) -> None:
    columns = [name for item in quantities(with_muscles).values() for name in item.columns]
    assert len(set(columns)) == len(columns)
    assert {"activation_soleus_l", "joint_contact_knee_r_z_n", "infeasible_hip_flexion_l"} <= set(columns)


def test_unknown_kind_of_file() -> None:
    with pytest.raises(ConfigError, match=r"expected \.npz, \.csv, \.sto"):
        dynamics_writer(Path("walk.xlsx"))


def test_nothing_is_half_written(tmp_path: Path) -> None:
    """The second of two files cannot be written: the first keeps its old content, and no part is left."""
    first = tmp_path / "first"
    first.write_bytes(b"old")
    with pytest.raises(OSError, match="nowhere") as raised:
        write_files({first: b"new", tmp_path / "nowhere" / "second": b"new"})
    assert raised.value.filename == str(tmp_path / "nowhere" / "second")
    assert [path.name for path in tmp_path.iterdir()] == ["first"]
    assert first.read_bytes() == b"old"


@pytest.mark.parametrize("suffix", WRITERS)
def test_equal_clips_give_equal_bytes(suffix: str, analysed: ClipAnalysis, tmp_path: Path) -> None:
    path = tmp_path / f"walk{suffix}"
    assert WRITERS[suffix](path, analysed) == WRITERS[suffix](path, analysed)
