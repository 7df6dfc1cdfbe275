"""C3D files, written by ezc3d (extra `c3d`): the same human as from a TRC file."""

from __future__ import annotations

import builtins
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError, MotionFormatError
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.importers import read
from flexmotion.importers.c3d import read_c3d

from .surface_markers import Tracks, surface_markers, write_trc


def write_c3d(path: Path, tracks: Tracks, change: Callable[[Any], None] = lambda content: None) -> Path:
    ezc3d = pytest.importorskip("ezc3d", reason="needs the extra 'c3d'")
    table = 1000 * np.stack(list(tracks.values()), axis=1)
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [30.0]
    content["parameters"]["POINT"]["UNITS"]["value"] = ("mm",)
    content["parameters"]["POINT"]["LABELS"]["value"] = tuple(tracks)
    content["data"]["points"] = np.concatenate([table, np.ones((*table.shape[:2], 1))], axis=2).transpose(2, 1, 0)
    change(content)
    content.write(str(path))
    return path


@pytest.fixture(scope="module")
def tracks(clip: Motion) -> Tracks:
    return {name: track[:120] for name, track in surface_markers(clip)["plug_in_gait"].items()}


def test_same_human_as_from_trc(tmp_path: Path, tracks: Tracks) -> None:
    named = {f"Jim:{name}": track for name, track in tracks.items()}
    gappy = named | {"*110": np.full_like(tracks["LASI"], np.nan)}
    gappy["Jim:LKNE"] = named["Jim:LKNE"].copy()
    gappy["Jim:LKNE"][40:44] = np.nan
    found = read(write_c3d(tmp_path / "a.c3d", gappy))
    reference = read(write_trc(tmp_path / "a.trc", tracks, up="z"))
    assert found.mapping == "plug_in_gait"
    assert found.motion.fps == 30.0
    assert np.abs(forward(found.motion).knee - forward(reference.motion).knee).max() < 1e-3


def test_missing_points_are_gaps(tmp_path: Path, tracks: Tracks) -> None:
    tracks = tracks | {"LASI": tracks["LASI"].copy()}
    tracks["LASI"][10:13] = np.nan
    capture = read_c3d(write_c3d(tmp_path / "a.c3d", tracks))
    seen = np.isfinite(capture.positions).all(axis=-1)
    assert np.flatnonzero(~seen[:, capture.names.index("LASI")]).tolist() == [10, 11, 12]
    assert seen.sum() == seen.size - 3


def test_damaged_file(tmp_path: Path) -> None:
    pytest.importorskip("ezc3d", reason="needs the extra 'c3d'")
    path = tmp_path / "a.c3d"
    path.write_bytes(b"no C3D file" * 100)
    with pytest.raises(MotionFormatError, match=r"a\.c3d: not a C3D file"):
        read(path)


def test_unknown_unit(tmp_path: Path, tracks: Tracks) -> None:
    def parsecs(content: Any) -> None:
        content["parameters"]["POINT"]["UNITS"]["value"] = ("pc",)

    with pytest.raises(MotionFormatError, match="POINT:UNITS is 'pc', expected one of m, cm"):
        read(write_c3d(tmp_path / "a.c3d", tracks, parsecs))


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(MotionFormatError, match=r"a\.c3d: cannot be read"):
        read(tmp_path / "a.c3d")


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def without_ezc3d(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "ezc3d":
            raise ImportError(name)
        return original(name, *args, **kwargs)

    (tmp_path / "a.c3d").write_bytes(b"\x02\x50")
    monkeypatch.setattr(builtins, "__import__", without_ezc3d)
    with pytest.raises(ConfigError, match=r"C3D files need the extra 'c3d': in a clone, pip install '\.\[c3d\]'"):
        read(tmp_path / "a.c3d")
