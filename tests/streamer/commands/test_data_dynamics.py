"""`flexmotion data dynamics`: what it writes and says, and what it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.human_model import human_model
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.motion_file import load_motion, save_motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.cli import execute
from flexmotion.streamer.commands.exit_codes import BAD_USAGE, CHECK_FAILED, OK

Write = Callable[[Motion], Path]

QUICK = "--no-muscles"
OPENSIM = ("", "_external_loads.xml", "_coordinates.sto", "_moments.sto", "_quality.sto", "_model.osim")


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(motion: Motion) -> Path:
        save_motion(motion, tmp_path / "clip.npz")
        return tmp_path / "clip.npz"

    return write


@pytest.fixture
def clip_file(write: Write) -> str:
    return str(write(replace(default_clip()[:45], mass_given=True)))


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_text_and_files(clip_file: str, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["data", "dynamics", clip_file, "-o", str(out / "walk.npz"), "--mass", "61.5", QUICK]) == OK
    printed = capsys.readouterr()
    assert "45 frames at 30 Hz" in printed.out and "61.5 kg" in printed.out
    assert names(out) == {"walk.npz"} and "walk.npz" in printed.err
    assert load_motion(out / "walk.npz").body.mass == 61.5


def test_json(clip_file: str, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["data", "dynamics", clip_file, "-o", str(out / "walk.csv"), "--fps", "60", "--cutoff", "8", "--json"]
    assert execute([*command, QUICK]) == OK
    content = json.loads(capsys.readouterr().out)
    assert content["fps"] == 60.0 and content["cutoff_hz"] == 8.0
    assert content["frames"] == pytest.approx(89, abs=1)
    assert content["files"] == [str(out / "walk.csv")]
    assert 0.5 < content["peak_vertical_force_bw"]["left"] < 2.0
    assert content["good_share"] == 1.0


def test_files_for_opensim(clip_file: str, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["data", "dynamics", clip_file, "-o", str(out / "walk.sto"), QUICK]) == OK
    assert names(out) == {f"walk{part or '.sto'}" for part in OPENSIM}


def test_muscles(clip_file: str, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("myo_sim", reason="extra biomech")
    assert execute(["data", "dynamics", clip_file, "-o", str(out / "walk.sto")]) == OK
    assert {"walk_activations.sto", "walk_joint_contact.sto"} <= names(out)
    assert "knee compression" in capsys.readouterr().out


@pytest.mark.parametrize(("suffix", "start"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_plots(suffix: str, start: bytes, clip_file: str, out: Path) -> None:
    page = out / f"page.{suffix}"
    assert execute(["data", "dynamics", clip_file, "-o", str(out / "w.npz"), "--plots", str(page), QUICK]) == OK
    assert page.read_bytes().startswith(start) and page.stat().st_size > 20_000


def test_page_in_html_holds_figures_and_picture(clip_file: str, out: Path) -> None:
    page = out / "page.html"
    assert execute(["data", "dynamics", clip_file, "-o", str(out / "w.npz"), "--plots", str(page), QUICK]) == OK
    text = page.read_text()
    assert "data:image/png;base64," in text and "vertical force" in text
    # Not "http": the letters of a picture in base64 may spell it.
    assert "://" not in text


def test_page_with_muscles_and_flags(out: Path, write: Write, make_bad: Motion) -> None:
    """Muscles, shaded frames, and a belt of bad frames up to the clip's end are drawn."""
    pytest.importorskip("myo_sim", reason="extra biomech")
    page = out / "page.png"
    execute(["data", "dynamics", str(write(make_bad)), "-o", str(out / "w.npz"), "--plots", str(page)])
    assert page.stat().st_size > 50_000


@pytest.fixture
def make_bad() -> Motion:
    """A human who rises from the floor at a constant .6 m/s, held by nothing."""
    clip = default_clip()[:40]
    path = clip.root_position.copy()
    path[:, 2] += np.maximum(np.arange(40) - 6, 0) / clip.fps * 0.6
    return replace(clip, root_position=path)


def test_clip_that_ground_forces_do_not_explain(
    write: Write, make_bad: Motion, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["data", "dynamics", str(write(make_bad)), "-o", str(out / "w.npz"), QUICK]) == CHECK_FAILED
    assert "ground forces explain" in capsys.readouterr().err
    assert names(out) == {"w.npz"}


def test_clip_without_ground_contact(write: Write, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A flight from take-off to landing has no force and no residual; it is written, with a note."""
    pose = default_clip()[:1]
    times = np.arange(24) / 30.0
    rise = 4.5 * times - 0.5 * 9.81 * times**2
    flight = Motion(
        fps=30.0,
        root_position=pose.root_position + np.outer(rise, [0.0, 0.0, 1.0]),
        root_quaternion=np.repeat(pose.root_quaternion, 24, axis=0),
        joints=np.repeat(pose.joints, 24, axis=0),
        body=pose.body,
    )
    code = execute(["data", "dynamics", str(write(flight)), "-o", str(out / "w.npz"), QUICK])
    assert code == OK and names(out) == {"w.npz"}
    assert "no foot carries load" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "{out}/walk.xlsx"], "expected .npz, .csv, .sto"),
        (["-o", "{out}/nowhere/walk.npz"], "no such folder"),
        (["-o", "{out}"], "unknown kind of file"),
        (["-o", "{out}/w.npz", "--plots", "{out}/page.bmp"], "expected .png or .pdf or .svg or .html"),
        (["-o", "{out}/w.npz", "--plots", "{out}/nowhere/page.png"], "no such folder"),
        (["-o", "{out}/w.npz", "--cutoff", "15"], "less than half the frame rate of 30 Hz"),
        (["-o", "{out}/w.npz", "--cutoff", "-1"], "more than 0"),
        (["-o", "{out}/w.npz", "--mass", "-70"], "mass"),
        (["-o", "{out}/w.npz", "--mass", "nan"], "mass"),
        (["-o", "{out}/w.npz", "--height", "0"], "height"),
        (["-o", "{out}/w.npz", "--belt", "fast"], "belt"),
        (["-o", "{out}/w.npz", "--fps", "0"], "fps"),
    ],
)
def test_refused(
    arguments: list[str], message: str, clip_file: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = execute(["data", "dynamics", clip_file, *(part.format(out=out) for part in arguments), QUICK])
    printed = capsys.readouterr().err
    assert code == BAD_USAGE
    assert message in printed and printed.count("\n") == 1
    assert not names(out)


def test_short_and_missing_clips(write: Write, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = str(write(default_clip()[:10]))
    assert execute(["data", "dynamics", short, "-o", str(out / "w.npz"), QUICK]) == BAD_USAGE
    assert "expected at least 0.6 s" in capsys.readouterr().err
    assert execute(["data", "dynamics", "nowhere.bvh", "-o", str(out / "w.npz"), QUICK]) == BAD_USAGE
    assert "nowhere.bvh" in capsys.readouterr().err
    assert not names(out)


def test_folder_that_refuses_the_file(clip_file: str, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The name of one of several files is taken by a folder: one line says which, and nothing is left."""
    (out / "walk_moments.sto").mkdir()
    assert execute(["data", "dynamics", clip_file, "-o", str(out / "walk.sto"), QUICK]) == BAD_USAGE
    assert "walk_moments.sto" in capsys.readouterr().err
    assert names(out) == {"walk_moments.sto"}


def test_files_for_opensim_are_in_the_axes_of_the_recording(tmp_path: Path, out: Path) -> None:
    """Forces were given in the axes of the pelvis in the first frame: 10° off the plates for a walk that starts turned.

    A clip turned by 40° and moved is written as joint centres, y up, from 1.5 s on; the pelvis is where the file says.
    """
    clip = default_clip()[:60]
    turn = Rotation.from_euler("z", 40, degrees=True)
    quaternions = (turn * Rotation.from_quat(clip.root_quaternion, scalar_first=True)).as_quat(scalar_first=True)
    moved = replace(clip, root_position=turn.apply(clip.root_position) + [1.0, -2.0, 0.0], root_quaternion=quaternions)
    file = tmp_path / "walk.trc"
    hips = _write_trc(file, moved, start=1.5)
    assert execute(["data", "dynamics", str(file), "-o", str(out / "w.sto"), "--mass", "70", QUICK]) == OK
    at = _storage(out / "w_coordinates.sto")
    assert at["time"][0] == pytest.approx(1.5)
    found = np.stack([at["pelvis_tx"], at["pelvis_tz"]], axis=1)
    assert np.abs(found - hips[:, [0, 2]]).max() < 0.03


def _storage(file: Path) -> dict[str, np.ndarray]:
    """Columns of a storage."""
    lines = file.read_text().splitlines()
    end = lines.index("endheader")
    values = np.array([[float(value) for value in line.split("\t")] for line in lines[end + 2 :]])
    return dict(zip(lines[end + 1].split("\t"), values.T, strict=True))


def _write_trc(file: Path, motion: Motion, start: float) -> np.ndarray:
    """Joint centres in metres, y up, x forward; returns the midpoints of the hips, (T, 3)."""
    human = forward(motion)
    neck = _origin(motion, "head")
    centres = {"Spine": _origin(motion, "torso"), "Neck": neck}
    for side, name in enumerate(("Left", "Right")):
        for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist"):
            centres[name + joint.capitalize()] = getattr(human, joint)[:, side]
        centres[name + "Toe"] = human.toe[:, side] + [0.0, 0.0, 0.03]
    y_up = {name: np.stack([at[:, 0], at[:, 2], -at[:, 1]], axis=1) for name, at in centres.items()}
    table = np.concatenate(list(y_up.values()), axis=1)
    head = [
        "PathFileType\t4\t(X/Y/Z)\twalk.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{motion.fps}\t{motion.fps}\t{len(motion)}\t{len(y_up)}\tm\t{motion.fps}\t1\t{len(motion)}",
        "Frame#\tTime\t" + "\t\t\t".join(y_up),
        "\t\t" + "\t".join(f"{axis}{number}" for number in range(1, len(y_up) + 1) for axis in "XYZ"),
    ]
    rows = [
        f"{frame + 1}\t{start + frame / motion.fps:.6f}\t" + "\t".join(f"{value:.6f}" for value in row)
        for frame, row in enumerate(table)
    ]
    file.write_text("\n".join([*head, *rows]) + "\n")
    return (y_up["LeftHip"] + y_up["RightHip"]) / 2


def _origin(motion: Motion, segment: str) -> np.ndarray:
    from flexmotion.biomechanics.segment_motion import segment_motion

    return segment_motion(motion).position[:, human_model(motion.body).body_index[segment]]


def test_trial_of_a_laboratory(shared_data: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Surface markers as recorded on a belt, as they are.

    Centres of pressure were over ground, up to a metre from those of the plates under the belt.
    """
    file = shared_data / "gait2354_markers.trc"
    command = ["data", "dynamics", str(file), "--mass", "72.6", "-o", str(out / "w.sto"), "--json", QUICK]
    assert execute(command) == OK
    content = json.loads(capsys.readouterr().out)
    assert 0.9 < content["belt_m_s"] < 1.3
    assert 1.0 < content["peak_vertical_force_bw"]["left"] < 1.4
    assert content["good_share"] > 0.95
    ours = _storage(out / "w.sto")
    plates = np.load(shared_data / "gait2354_walk.npz")
    for side, name in (("l", "left"), ("r", "right")):
        measured = plates[f"grf_{name}"]
        loaded = measured[:, 1] > 200.0
        for column, axis in ((3, "x"), (5, "z")):
            found = np.interp(plates["time_s"], ours["time"], ours[f"ground_force_{side}_p{axis}"])
            assert abs(np.median((found - measured[:, column])[loaded])) < 0.03
