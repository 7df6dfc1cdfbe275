"""Left and right markers that the software exchanged are found, put right and told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmotion.human.motion import Motion
from flexmotion.importers import read
from flexmotion.importers.capture import Capture
from flexmotion.importers.joint_gaps import complete_joints
from flexmotion.importers.mapping import find_mapping
from flexmotion.importers.marker_capture import joint_capture
from flexmotion.importers.packed import read_packed
from flexmotion.importers.swapped_sides import without_swaps
from flexmotion.importers.trc import read_trc

from .surface_markers import Tracks, joint_centres, surface_markers, write_trc

FPS = 30.0


@pytest.fixture(scope="module")
def tracks(clip: Motion) -> dict[str, Tracks]:
    """Five seconds in which the human walks, as joint centres and markers."""
    kinds = {"centres": joint_centres(clip), **surface_markers(clip)}
    return {kind: {name: track[150:300] for name, track in found.items()} for kind, found in kinds.items()}


def exchanged(tracks: Tracks, pair: tuple[str, str], first: float, last: float) -> Tracks:
    """Two points exchanged between two times [s]."""
    frames = slice(round(first * FPS), round(last * FPS))
    changed = {name: tracks[name].copy() for name in pair}
    for name, other in (pair, pair[::-1]):
        changed[name][frames] = tracks[other][frames]
    return tracks | changed


@pytest.mark.parametrize(
    ("kind", "pair", "first", "last", "told"),
    [
        ("plug_in_gait", ("LHEE", "RHEE"), 1.0, 9.0, "from 1.00 to 5.00 s"),
        ("plug_in_gait", ("LHEE", "RHEE"), 3.0, 4.0, "from 3.00 to 4.00 s"),
        ("plug_in_gait", ("LHEE", "RHEE"), 0.0, 9.0, "throughout"),
        ("plug_in_gait", ("LASI", "RASI"), 1.0, 9.0, "from 1.00 to 5.00 s"),
        ("plug_in_gait", ("LKNE", "RKNE"), 2.0, 9.0, "from 2.00 to 5.00 s"),
        ("plug_in_gait", ("LWRA", "RWRA"), 3.0, 9.0, "from 3.00 to 5.00 s"),
        ("gait2354", ("L.Shank.Rear", "R.Shank.Rear"), 1.0, 9.0, "from 1.00 to 5.00 s"),
        ("gait2354", ("L.Heel", "R.Heel"), 1.0, 9.0, "from 1.00 to 5.00 s"),
        ("centres", ("LeftAnkle", "RightAnkle"), 1.0, 9.0, "from 1.00 to 5.00 s"),
        ("plug_in_gait", ("LTOE", "RTOE"), 0.0, 9.0, "throughout"),
        ("centres", ("LeftAnkle", "RightAnkle"), 0.0, 9.0, "throughout"),
        ("centres", ("LeftHip", "RightHip"), 1.0, 9.0, "from 1.00 to 5.00 s"),
    ],
)
def test_exchanged_pair(
    kind: str, pair: tuple[str, str], first: float, last: float, told: str, tmp_path: Path, tracks: dict[str, Tracks]
) -> None:
    """Heels that were exchanged from some frame on gave twisted feet and forces without a word."""
    right = joints(write_trc(tmp_path / "a.trc", tracks[kind]))
    found = joints(write_trc(tmp_path / "b.trc", exchanged(tracks[kind], pair, first, last)))
    exchanges = [text for text in found.warnings if "exchanged" in text]
    assert exchanges == [f"{pair[0]} and {pair[1]} are exchanged {told}: put right"]
    np.testing.assert_allclose(found.positions, right.positions, atol=1e-9)


def joints(path: Path) -> Capture:
    """Joint centres of a file."""
    capture = read_trc(path)
    mapping = find_mapping(capture.names, capture.path)
    return joint_capture(capture, mapping) if mapping.markers else complete_joints(capture, mapping)[0]


def test_import_says_what_was_exchanged(tmp_path: Path, tracks: dict[str, Tracks]) -> None:
    file = write_trc(tmp_path / "a.trc", exchanged(tracks["plug_in_gait"], ("LHEE", "RHEE"), 1.0, 9.0))
    assert "LHEE and RHEE are exchanged from 1.00 to 5.00 s: put right" in read(file).warnings


def test_pair_exchanged_within_a_gap(tmp_path: Path, tracks: dict[str, Tracks]) -> None:
    own = exchanged(tracks["plug_in_gait"], ("LHEE", "RHEE"), 2.0, 9.0)
    own["LHEE"][round(1.9 * FPS) : round(2.05 * FPS)] = np.nan
    found = joints(write_trc(tmp_path / "a.trc", own))
    assert any("LHEE and RHEE are exchanged" in text for text in found.warnings), found.warnings


@pytest.mark.parametrize("kind", ["centres", "plug_in_gait", "gait2354"])
def test_nothing_is_exchanged_in_a_sound_file(kind: str, tmp_path: Path, tracks: dict[str, Tracks]) -> None:
    found = joints(write_trc(tmp_path / "a.trc", tracks[kind]))
    assert not any("exchanged" in text for text in found.warnings)


@pytest.mark.parametrize("fps", [30.0, 120.0])
def test_hands_that_clap_are_not_exchanged(fps: float) -> None:
    """Hands that meet at 3 m/s and part were predicted to pass through each other."""
    time = np.arange(round(2 * fps)) / fps
    apart = 0.03 + 0.5 * np.abs(np.sin(2 * np.pi * time))
    still = np.zeros_like(time)
    left, right = (np.stack([still, sign * apart, 1.2 + still], axis=1) for sign in (1, -1))
    elbows = [np.stack([still - 0.2, sign * 0.25 + still, 1.0 + still], axis=1) for sign in (1, -1)]
    capture = Capture("clap", fps, ("L", "R", "EL", "ER"), np.stack([left, right, *elbows], axis=1))
    assert without_swaps(capture, [("L", "R")], {"L": ["EL"], "R": ["ER"]}, 1.0) is capture


def test_recorded_clips_have_no_exchanged_joints(shared_data: Path) -> None:
    path = shared_data / "cmu_joints22_30fps_mm.npz"
    told = []
    with np.load(path) as content:
        for name in content.files[::16]:
            capture = read_packed(str(path), {name: content[name]}, name)
            found, _ = complete_joints(capture, find_mapping(capture.names, capture.path))
            told += [f"{name}: {note}" for note in found.warnings]
    assert told == []
