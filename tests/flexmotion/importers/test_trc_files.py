"""Files as laboratories have them: what is missing from them, and how they are written, does not stop the import.

Eleven of 24 files were refused: for gaps in markers that the mapping does not use, and for arms that they do not have.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.importers import Import, read

from .surface_markers import Tracks, joint_centres, surface_markers, write_trc

LEG = ("knee", "ankle")


@pytest.fixture(scope="module")
def centres(clip: Motion) -> Tracks:
    return joint_centres(clip)


@pytest.fixture(scope="module")
def markers(clip: Motion) -> dict[str, Tracks]:
    return surface_markers(clip)


def without(*words: str) -> Callable[[Tracks], Tracks]:
    return lambda tracks: {name: track for name, track in tracks.items() if not any(word in name for word in words)}


def gap(name: str, first: float, last: float, fps: float = 30.0) -> Callable[[Tracks], Tracks]:
    """Marker missing between two times [s]."""

    def cut(tracks: Tracks) -> Tracks:
        track = tracks[name].copy()
        track[round(first * fps) : round(last * fps)] = np.nan
        return tracks | {name: track}

    return cut


def extra(name: str, seen: float) -> Callable[[Tracks], Tracks]:
    """Another marker, seen in this share of the clip."""

    def add(tracks: Tracks) -> Tracks:
        count = len(next(iter(tracks.values())))
        track = np.full((count, 3), np.nan)
        track[: round(seen * count)] = 1.0
        return tracks | {name: track}

    return add


def model_outputs(tracks: Tracks) -> Tracks:
    """Moments and forces of a laboratory's software in columns of points: 80 times the size of a human."""
    time = np.arange(len(next(iter(tracks.values()))))[:, None] / 30
    names = [f"{side}{joint}{kind}" for side in "LR" for joint in ("Hip", "Knee") for kind in ("Moment", "Force")]
    return tracks | {name: 60.0 * np.sin(time + k + np.arange(3)) for k, name in enumerate(names)}


def named(change: Callable[[str], str]) -> Callable[[Tracks], Tracks]:
    return lambda tracks: {change(name): track for name, track in tracks.items()}


def same_legs(found: Import, human: HumanKinematics, tolerance: float, start: int = 0) -> None:
    """Knees and ankles relative to the pelvis' first pose, within a tolerance [m] (root mean square)."""
    mine = forward(found.motion)
    for point in LEG:
        ours, theirs = getattr(mine, point), getattr(human, point)[start : start + len(mine)]
        root = human.pelvis_position[start : start + len(mine), None]
        difference = (ours - mine.pelvis_position[:, None]) - (theirs - root)
        assert np.sqrt((difference**2).sum(axis=-1).mean()) < tolerance, point


READABLE: dict[str, tuple[Callable[[Tracks], Tracks], str]] = {
    "whole": (lambda tracks: tracks, ""),
    "without arms": (without("Elbow", "Wrist"), ""),
    "without arms and shoulders": (without("Elbow", "Wrist", "Shoulder"), "no point for the shoulders"),
    "without neck": (without("Neck"), "no point for the neck"),
    "legs and spine": (without("Elbow", "Wrist", "Shoulder", "Neck"), "no point for neck or shoulders"),
    "legs only": (without("Elbow", "Wrist", "Shoulder", "Neck", "Spine"), "no point for neck or shoulders"),
    "without spine": (without("Spine"), ""),
    "left arm only": (without("RightElbow", "RightWrist"), ""),
    "left shoulder only": (without("RightShoulder", "Neck"), "no point for the neck"),
    "short gap in a knee": (gap("LeftKnee", 2.0, 2.1), "gaps of at most 0.25 s are interpolated: LeftKnee (3 frames)"),
    "gap in an unused marker": (extra("Hat", 0.3), ""),
    "unused marker without a value": (extra("Hat", 0.0), ""),
    "unlabelled markers": (lambda t: extra("*1", 0.1)(extra("*2", 0.4)(t)), ""),
    "gap of .8 s in a wrist": (gap("LeftWrist", 2.0, 2.8), "LeftWrist: gaps up to 0.80 s are interpolated"),
    "wrist missing for 4 s": (gap("LeftWrist", 2.0, 6.0), "LeftWrist: missing for 4.00 s, is not used"),
    "shoulder reconstructed from the trunk": (
        gap("LeftShoulder", 5.0, 7.0),
        "LeftShoulder: gaps are reconstructed from the other markers of its segment (60 frames)",
    ),
    "gap of .8 s in a hip": (gap("LeftHip", 8.5, 9.3), "LeftHip: gaps are approximated"),
    "prefix of a subject": (named(lambda name: f"Subject 01:{name}"), ""),
    "names in capitals": (named(lambda name: name.replace("Left", "L_").replace("Right", "R_").upper()), ""),
}


@pytest.mark.parametrize("name", READABLE)
def test_joint_centres(name: str, tmp_path: Path, centres: Tracks, clip_kinematics: HumanKinematics) -> None:
    change, warning = READABLE[name]
    found = read(write_trc(tmp_path / "a.trc", change(centres)))
    assert not warning or any(warning in text for text in found.warnings), found.warnings
    same_legs(found, clip_kinematics, 0.015)


FORMS: dict[str, dict] = {
    "metres": {"units": "m", "per_metre": 1.0},
    "centimetres": {"units": "cm", "per_metre": 100.0},
    "inches": {"units": "in", "per_metre": 1 / 0.0254},
    "wrong unit in the header": {"units": "m", "per_metre": 1000.0},
    "z up": {"up": "z"},
    "lines of Windows": {"end": "\r\n"},
    "trailing tabs": {"trailing": "\t\t"},
    "missing as nan": {"missing": "NaN"},
    "missing as zero": {"missing": "0.000000"},
}


@pytest.mark.parametrize("name", FORMS)
def test_forms_of_the_same_file(name: str, tmp_path: Path, centres: Tracks, clip_kinematics: HumanKinematics) -> None:
    tracks = gap("LeftKnee", 2.0, 2.1)(extra("Hat", 0.5)(centres))
    same_legs(read(write_trc(tmp_path / "a.trc", tracks, **FORMS[name])), clip_kinematics, 0.015)


@pytest.mark.parametrize(
    ("old", "new", "warning"),
    [
        ("\t16\tmm", "\t17\tmm", "16 names of markers, NumMarkers says 17"),
        ("\t361\t16", "\t400\t16", "361 frames, NumFrames says 400"),
        ("PathFileType", "\ufeffPathFileType", ""),
    ],
)
def test_wrong_header(
    old: str, new: str, warning: str, tmp_path: Path, centres: Tracks, clip_kinematics: HumanKinematics
) -> None:
    path = write_trc(tmp_path / "a.trc", centres)
    path.write_text(path.read_text().replace(old, new, 1))
    found = read(path)
    assert not warning or any(warning in text for text in found.warnings)
    same_legs(found, clip_kinematics, 0.015)


@pytest.mark.parametrize(
    ("header", "per_metre", "taken"), [("mm", 1.0, "m"), ("mm", 100.0, "cm"), ("m", 1000.0, "mm"), ("cm", 1.0, "m")]
)
@pytest.mark.parametrize("kind", ["centres", "plug_in_gait"])
def test_header_with_another_unit(
    header: str,
    per_metre: float,
    taken: str,
    kind: str,
    tmp_path: Path,
    centres: Tracks,
    markers: dict[str, Tracks],
    clip_kinematics: HumanKinematics,
) -> None:
    """Metres under a header that says mm were refused: `.00024 between both ASIS, is the mapping right?`."""
    tracks = centres if kind == "centres" else markers[kind]
    found = read(write_trc(tmp_path / "a.trc", tracks, units=header, per_metre=per_metre))
    told = [text for text in found.warnings if f"the header says {header}" in text and f"taken as {taken}" in text]
    assert len(told) == 1, found.warnings
    same_legs(found, clip_kinematics, 0.03)


def test_header_with_the_right_unit(tmp_path: Path, centres: Tracks) -> None:
    found = read(write_trc(tmp_path / "a.trc", centres))
    assert not any("header" in text for text in found.warnings)


def renamed(path: Path, old: str, new: str) -> Path:
    path.write_text(path.read_text().replace(old, new, 1))
    return path


@pytest.mark.parametrize("parts", [False, True], ids=["two copies", "two parts"])
def test_copies_and_parts_of_a_marker(
    parts: bool, tmp_path: Path, markers: dict[str, Tracks], clip_kinematics: HumanKinematics
) -> None:
    """A heel whose trajectory was exported in two columns was not used, and the foot without it refused."""
    tracks = markers["plug_in_gait"]
    tracks = tracks | {"LHEE": tracks["LHEE"].copy(), "Copy": tracks["LHEE"].copy()}
    if parts:
        tracks["LHEE"][150:] = np.nan
        tracks["Copy"][:150] = np.nan
    found = read(renamed(write_trc(tmp_path / "a.trc", tracks), "Copy", "LHEE"))
    assert "LHEE: name of 2 markers, which are copies or parts of one: joined" in found.warnings
    same_legs(found, clip_kinematics, 0.03)


def test_two_different_markers_of_one_name_that_is_needed(tmp_path: Path, markers: dict[str, Tracks]) -> None:
    """The message said that a marker is missing, and not that it is there twice."""
    tracks = markers["plug_in_gait"]
    tracks = tracks | {"Copy": tracks["LASI"] + 0.3}
    with pytest.raises(MotionFormatError) as error:
        read(renamed(write_trc(tmp_path / "a.trc", tracks), "Copy", "LASI"))
    assert "no marker for asis_l; mapping 'plug_in_gait' takes asis_l: LASI or LASIS" in str(error.value)
    assert "LASI: name of 2 different markers, none of them is used; the file has CLAV" in str(error.value)


def test_two_unused_markers_of_one_name(tmp_path: Path, centres: Tracks, clip_kinematics: HumanKinematics) -> None:
    path = write_trc(tmp_path / "a.trc", extra("Hat", 0.5)(extra("Cap", 0.5)(centres)))
    found = read(renamed(path, "Cap", "Hat"))
    assert any("Hat: name of 2 markers" in text for text in found.warnings)
    same_legs(found, clip_kinematics, 0.015)


@pytest.mark.parametrize(("name", "first", "last", "start"), [("LeftAnkle", 0.0, 0.5, 15), ("RightToe", 11.0, 13.0, 0)])
def test_frames_before_and_after_a_marker_are_cut_off(
    name: str,
    first: float,
    last: float,
    start: int,
    tmp_path: Path,
    centres: Tracks,
    clip: Motion,
    clip_kinematics: HumanKinematics,
) -> None:
    found = read(write_trc(tmp_path / "a.trc", gap(name, first, last)(centres)))
    assert any("s are used: " + name in text for text in found.warnings)
    assert found.placement.start == pytest.approx(start / 30)
    assert len(found.motion) < len(clip)
    same_legs(found, clip_kinematics, 0.015, start)


MARKER_FILES: dict[str, tuple[str, Callable[[Tracks], Tracks], str]] = {
    "whole": ("plug_in_gait", lambda tracks: tracks, ""),
    "without arms": ("plug_in_gait", without("ELB", "WRA", "WRB"), ""),
    "lower body": ("plug_in_gait", without("ELB", "WR", "SHO", "HD", "C7", "CLAV", "STRN", "T10"), "neck or shoulders"),
    "without wands": ("plug_in_gait", without("THI", "TIB"), ""),
    "gap in a marker of the pelvis": ("plug_in_gait", gap("LASI", 3.0, 4.5), "LASI: gaps are reconstructed"),
    "gap in a wand": ("plug_in_gait", gap("LTHI", 3.0, 9.0), "LTHI: missing for too long, is not used"),
    "unused virtual points": ("plug_in_gait", extra("LHipAngles", 0.5), ""),
    "gap beside model outputs, which set the scale": (
        "plug_in_gait",
        lambda tracks: model_outputs(gap("LASI", 3.0, 4.5)(tracks)),
        "LASI: gaps are reconstructed",
    ),
    "prefix": ("plug_in_gait", named(lambda name: f"Jim:{name}"), ""),
    "short gaps": (
        "plug_in_gait",
        lambda tracks: gap("LKNE", 3.0, 3.1)(gap("RHEE", 4.0, 4.2)(tracks)),
        "gaps of at most 0.25 s are interpolated: LKNE (3 frames), RHEE (6 frames)",
    ),
    "clusters": ("gait2354", lambda tracks: tracks, "left knee: no marker on it"),
    "two markers on a shank": ("gait2354", without("Shank.Rear"), ""),
    "gap of .9 s in a shank": ("gait2354", gap("L.Shank.Rear", 8.5, 9.4), "L.Shank.Rear: gaps are approximated"),
    "gap of .9 s in the sacrum": ("gait2354", gap("V.Sacral", 5.5, 6.4), "V.Sacral: gaps are approximated"),
    "gap of .9 s in a shoulder": ("gait2354", gap("L.Acromium", 5.5, 6.4), "L.Acromium: gaps"),
    "gap in a cluster": ("gait2354", gap("L.Thigh.Rear", 3.0, 5.0), "L.Thigh.Rear: missing for too long"),
}


@pytest.mark.parametrize("name", MARKER_FILES)
def test_surface_markers(
    name: str, tmp_path: Path, markers: dict[str, Tracks], clip_kinematics: HumanKinematics
) -> None:
    kind, change, warning = MARKER_FILES[name]
    found = read(write_trc(tmp_path / "a.trc", change(markers[kind])))
    assert found.mapping == kind
    assert not warning or any(warning in text for text in found.warnings), found.warnings
    same_legs(found, clip_kinematics, 0.03)


REFUSED: dict[str, tuple[str, Callable[[Tracks], Tracks], str]] = {
    "no hips": ("centres", without("Hip"), "no joint found for hip_l, hip_r (names such as LeftHip, RightHip); joints"),
    "no toes": ("centres", without("Toe"), "no joint found for toe_l, toe_r"),
    "one leg": ("centres", without("RightHip", "RightKnee", "RightAnkle", "RightToe"), "no joint found for hip_r"),
    "no marker": ("centres", lambda tracks: {"Hat": tracks["Neck"]}, "no legs found"),
    "knee missing in the middle": (
        "centres",
        gap("LeftKnee", 3.0, 9.0),
        "'LeftKnee' is missing for 6.00 s from 3.00 s on",
    ),
    "ankle never seen": ("centres", gap("LeftAnkle", 0.0, 99.0), "LeftAnkle: missing in every frame"),
    "one spine": (
        "plug_in_gait",
        without("RASI"),
        "no marker for asis_r; mapping 'plug_in_gait' takes asis_r: RASI or RASIS; the file has CLAV, C7",
    ),
    "no back of the pelvis": ("plug_in_gait", without("PSI"), "no marker for sacrum, or psis_l and psis_r"),
    "no knee": ("plug_in_gait", without("LKNE", "LTHI"), "no marker for the left knee"),
    "no foot": (
        "plug_in_gait",
        without("TOE", "HEE"),
        "no marker for the left toe joint: it needs toe, metatarsal_1, or toe_tip and heel; mapping ",
    ),
    "heel and ankle": (
        "plug_in_gait",
        without("RHEE", "RANK"),
        "no marker behind the right foot, on heel or ankle; mapping 'plug_in_gait' takes heel_r: RHEE or RHEEL; "
        "ankle_lateral_r: RANK or RANL; the file has CLAV, C7",
    ),
    "spine of the pelvis lost": ("gait2354", gap("L.ASIS", 2.0, 10.0), "L.ASIS"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_what_is_missing(name: str, tmp_path: Path, centres: Tracks, markers: dict[str, Tracks]) -> None:
    kind, change, message = REFUSED[name]
    path = write_trc(tmp_path / "a.trc", change(centres if kind == "centres" else markers[kind]))
    with pytest.raises(MotionFormatError) as error:
        read(path)
    assert message in str(error.value)
    assert "a.trc" in str(error.value)


@pytest.mark.parametrize("kind", ["plug_in_gait", "gait2354"])
def test_one_frame_of_surface_markers(kind: str, tmp_path: Path, markers: dict[str, Tracks]) -> None:
    """A static trial of one frame ended in an IndexError."""
    path = write_trc(tmp_path / "a.trc", {name: track[:1] for name, track in markers[kind].items()})
    with pytest.raises(MotionFormatError, match=r"a.trc: has 1 frame.*expected at least 2"):
        read(path)


def test_two_frames_of_surface_markers(tmp_path: Path, markers: dict[str, Tracks]) -> None:
    tracks = {name: track[:2] for name, track in markers["plug_in_gait"].items()}
    assert len(read(write_trc(tmp_path / "a.trc", tracks)).motion) == 2


def test_decimal_comma(tmp_path: Path, centres: Tracks) -> None:
    path = write_trc(tmp_path / "a.trc", centres)
    head, body = path.read_text().split("\n\n")
    path.write_text(head + "\n\n" + body.replace(".", ","))
    with pytest.raises(MotionFormatError, match=r"line 7: '0,0000' has a decimal comma, expected a point"):
        read(path)


def test_header_without_frames(tmp_path: Path, centres: Tracks) -> None:
    path = write_trc(tmp_path / "a.trc", centres)
    path.write_text(path.read_text().split("\n\n")[0] + "\n\n")
    with pytest.raises(MotionFormatError, match="no frames"):
        read(path)
