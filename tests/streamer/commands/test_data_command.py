"""`flexmotion data` from files to a set and what it says of it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flexmotion.human.motion_file import load_motion, save_motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer import api
from flexmotion.streamer.cli import execute
from flexmotion.streamer.commands.choice import choose_motion, library_of
from flexmotion.streamer.commands.exit_codes import BAD_USAGE, CHECK_FAILED, OK

from ...flexmotion.importers.surface_markers import joint_centres, write_trc
from ...waiting import wait_until


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    motions = tmp_path / "motions"
    motions.mkdir()
    save_motion(default_clip()[:45], motions / "wave.npz")
    return motions


def test_build_inspect_export(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "set")
    assert execute(["data", "build", str(folder), "-o", out, "--workers", "1", "--no-muscles", "--json"]) == OK
    report = json.loads(capsys.readouterr().out)
    assert report["summary"]["clips_kept"] == 2
    assert execute(["data", "inspect", out, "--verify", "--plots", str(tmp_path / "plots")]) == OK
    assert "root_position" in capsys.readouterr().out
    assert (tmp_path / "plots" / "clip.png").stat().st_size > 10_000
    assert execute(["data", "export", out, "-o", str(tmp_path / "set.fms")]) == OK
    (tmp_path / "set" / "joints.npy").write_bytes(b"torn")
    assert execute(["data", "inspect", out, "--verify"]) == CHECK_FAILED


@pytest.mark.wall_clock
def test_killed_half_way_it_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    """SIGKILL in the middle of a build: what was computed is kept, no process is left, and the set is the same."""
    motions = tmp_path / "motions"
    motions.mkdir()
    for number in range(8):
        save_motion(default_clip()[10 * number : 10 * number + 90 - number], motions / f"wave_{number}.npz")

    def command(out: Path, workers: int) -> list[str]:
        return ["data", "build", str(motions), "-o", str(out), "--workers", str(workers), "--no-muscles"]

    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert execute(command(whole, 1)) == OK
    program = [sys.executable, "-c", "from flexmotion.streamer.__main__ import main; main()", *command(killed, 2)]
    quiet = subprocess.DEVNULL
    parts = killed / "work" / "parts"

    def killed_half_way() -> bool:
        """Start a build and kill it; whether that was before its end."""
        shutil.rmtree(killed, ignore_errors=True)
        process = subprocess.Popen(program, stdout=quiet, stderr=quiet, start_new_session=True)
        wait_until(lambda: len(list(parts.glob("*.npz"))) >= 2, "two clips of the set")
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        wait_until(lambda: not _group_lives(process.pid), "the workers to end")
        return not (killed / "manifest.json").exists() and len(list(parts.glob("*.npz"))) < 8

    wait_until(killed_half_way, "a build that was killed half way")
    done = {path.name: path.stat().st_mtime_ns for path in parts.glob("*.npz")}

    assert execute(command(killed, 1)) == OK
    assert {name: (parts / name).stat().st_mtime_ns for name in done} == done
    files = [path for path in whole.iterdir() if path.is_file()]
    assert len(files) > 5
    for path in files:
        assert (killed / path.name).read_bytes() == path.read_bytes(), path.name


def _group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_import_and_augment(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.npz"
    assert execute(["data", "import", str(folder / "wave.npz"), "-o", str(out), "--fps", "20"]) == OK
    assert load_motion(out).fps == 20.0
    capsys.readouterr()  # with a long path the text about the import has two lines
    assert execute(["data", "augment", str(folder / "wave.npz"), "-o", str(out), "--seed", "3", "--json"]) == OK
    assert load_motion(out).torques is not None
    assert np.max(json.loads(capsys.readouterr().out)["residual_median"]) < 0.02


def test_import_says_what_was_guessed_and_removed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A mass that was off by 29 % and a belt that was taken as ground were nowhere to be seen."""
    tracks = {name: track[:90] for name, track in joint_centres(default_clip()).items() if "Wrist" not in name}
    file, out = write_trc(tmp_path / "a.trc", tracks), tmp_path / "out.npz"
    assert execute(["data", "import", str(file), "-o", str(out)]) == OK
    said = capsys.readouterr()
    assert "mass of" in said.err
    assert "arm hangs" in said.err
    assert "belt" not in said.err
    options = ["--mass", "61.5", "--height", "1.7", "--belt", "0.8", "--json"]
    assert execute(["data", "import", str(file), "-o", str(out), *options]) == OK
    found = json.loads(capsys.readouterr().out)
    assert found["belt"] == pytest.approx([-0.8, 0.0], abs=0.02)
    assert (found["mass_kg"], found["height_m"]) == (61.5, 1.7)
    assert any("belt of 0.80 m/s backwards was removed (given)" in text for text in found["warnings"])
    motion = load_motion(out)
    assert motion.body.mass == 61.5
    assert motion.root_position[-1, 0] > 0.8 * motion.duration - 0.3


def test_augment_says_what_was_guessed_and_takes_the_mass(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`data augment` guessed the mass and removed belts without a word, and took no options to say better."""
    tracks = {name: track[:60] for name, track in joint_centres(default_clip()).items()}
    file, out = write_trc(tmp_path / "a.trc", tracks), tmp_path / "out.npz"
    command = ["data", "augment", str(file), "-o", str(out), "--mirror"]
    assert execute(command) == OK
    assert "mass of" in capsys.readouterr().err
    assert load_motion(out).mass_given is False
    assert execute([*command, "--mass", "61.5", "--belt", "0.8", "--json"]) == OK
    notes = json.loads(capsys.readouterr().out)["warnings"]
    # The clip is over ground, which is said too.
    assert ["both feet rest" in notes[0], "belt of 0.80 m/s" in notes[1], len(notes)] == [True, True, 2]
    assert (load_motion(out).body.mass, load_motion(out).mass_given) == (61.5, True)


def test_a_clip_that_a_robot_follows_says_how_it_was_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """A belt was removed from clips of `--clip`, and nothing said so."""
    tracks = {name: track[:60] for name, track in joint_centres(default_clip()).items() if "Wrist" not in name}
    file = write_trc(tmp_path / "a.trc", tracks)
    library_of([file, write_trc(tmp_path / "b.trc", tracks)])
    said = capsys.readouterr().err
    assert ("a.trc: no point for the left wrist" in said, "b.trc: no point for the left wrist" in said) == (True, True)
    assert choose_motion(file).source == "a.trc"
    assert "arm hangs" in capsys.readouterr().err
    assert choose_motion().source == "default"
    assert capsys.readouterr().err == ""
    api.load_motion(file)
    assert "a.trc: no point for the left wrist" in caplog.text


def test_a_clip_that_a_robot_follows_needs_no_mass(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """`dry-run` and `run` warned that the mass is guessed and asked for `--mass`, which they do not have."""
    file = write_trc(tmp_path / "a.trc", {name: track[:60] for name, track in joint_centres(default_clip()).items()})
    choose_motion(file)
    motion = api.load_motion(file)
    assert "mass" not in capsys.readouterr().err + caplog.text
    assert motion.mass_given is False
    assert execute(["data", "import", str(file), "-o", str(tmp_path / "a.npz")]) == OK
    assert "mass of" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["import", "a.trc", "-o", "b.npz", "--belt", "fast"], "'fast', expected a speed in m/s, none or detect"),
        (["import", "a.trc", "-o", "b.npz", "--mass", "0"], "mass is 0 kg, expected 10 to 300 kg"),
        (["build", "nowhere", "-o", "set"], "no such folder"),
        (["inspect", "nowhere"], "no set there"),
        (["build", "nowhere", "-o", "set", "--engine", "cloud"], "expected process or ray"),
    ],
)
def test_faults(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert execute(["data", *arguments]) == BAD_USAGE
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["dynamics", "-o", "a.npz", "--cutoff", "-1"], "cut-off is -1 Hz, expected more than 0"),
        (["dynamics", "-o", "a.npz", "--cutoff", "20", "--fps", "30"], "less than half the frame rate of 30 Hz"),
        (["dynamics", "-o", "a.npz", "--mass", "-70"], "mass is -70 kg"),
        (["dynamics", "-o", "a.npz", "--height", "180"], "height is 180 m"),
        (["import", "-o", "nowhere/a.npz"], "nowhere: no such folder to write a.npz into"),
        (["import", "-o", "."], ".: a folder, expected a file"),
        (["import", "-o", "a.trc"], "a.trc: unknown kind of file, expected .npz"),
        (["import", "-o", "a.npz", "--fps", "0"], "--fps"),
        (["augment", "-o", "nowhere/a.npz"], "nowhere: no such folder"),
        (["augment", "-o", "a.npz", "--push", "0.1", "--plot", "nowhere/a.png"], "nowhere: no such folder"),
    ],
)
def test_options_are_checked_before_anything_is_read(
    arguments: list[str], message: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """A wrong cut-off or folder was told after the whole import, which takes half a minute for a long clip."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("flexmotion.importers.read", lambda *_, **__: pytest.fail("the file was read"))
    (tmp_path / "a.bvh").write_text("HIERARCHY")
    assert execute(["data", arguments[0], "a.bvh", *arguments[1:]]) == BAD_USAGE
    assert message in capsys.readouterr().err


def test_augment_simulates_a_push_and_draws_it(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, picture = tmp_path / "pushed.npz", tmp_path / "pushed.png"
    command = ["data", "augment", str(folder / "wave.npz"), "-o", str(out), "--push", "0.04", "--push-at", "0.4"]
    assert execute([*command, "--load", "2", "--plot", str(picture), "--json"]) == OK
    report = json.loads(capsys.readouterr().out)
    assert report["push"]["peak_bw"] == 0.04
    assert report["carried_kg"] == {"hand_l": 1.0, "hand_r": 1.0}
    assert 0 < report["assistance"]["force_max_bw"] <= 0.05
    assert picture.stat().st_size > 20_000
    assert load_motion(out).wrenches is not None


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--mirror", "--push", "0.1"], "--mirror"),
        (["--perturbed", "--slope", "2"], "--slope"),
        (["--plot", "x.png"], "--plot"),
    ],
)
def test_augment_refuses_options_that_contradict(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], named: str
) -> None:
    out = tmp_path / "out.npz"
    assert execute(["data", "augment", str(folder / "wave.npz"), "-o", str(out), *options]) == BAD_USAGE
    assert named in capsys.readouterr().err
    assert not out.exists()
