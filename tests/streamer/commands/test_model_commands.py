"""`train`, `personalize`, `evaluate` and `export` as a shell sees them."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.configs.model import FOLDER
from flexmotion.dataset.build import build
from flexmotion.dataset.settings import BuildSettings
from flexmotion.human.motion_file import save_motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.cli import execute
from flexmotion.training.checkpoints import LAST, read_checkpoint

LONGEST_S = 300.0
"""A training that does not hear its signal is ended after this [s]."""

COMMANDS = ["train autoencoder", "train text", "train diffusion", "train distill", "train evaluator"]


@pytest.mark.parametrize("command", [*COMMANDS, "personalize", "evaluate", "export"])
def test_help_has_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute([*command.split(), "--help"]) == 0
    assert f"flexmotion {command}" in capsys.readouterr().out.split("Examples")[1]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_missing_configuration_is_one_line(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute([*command.split(), "--out", str(tmp_path / "new")]) == 2
    error = capsys.readouterr().err.strip()
    assert "\n" not in error and "name a configuration" in error


def test_unknown_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["train", "autoencoder", "-o", str(tmp_path / "new"), "--config", "huge"]) == 2
    assert "paper, stream" in capsys.readouterr().err


def test_stages_name_what_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "new")
    assert execute(["train", "autoencoder", "-o", out, "--config", "stream"]) == 2
    assert "name the training set" in capsys.readouterr().err
    assert execute(["train", "diffusion", "-o", out]) == 2
    assert "train autoencoder" in capsys.readouterr().err
    assert execute(["export", out, "-o", str(tmp_path / "bundle")]) == 2
    assert "train autoencoder" in capsys.readouterr().err
    assert execute(["evaluate", out, "--bundle", str(tmp_path / "none")]) == 2
    assert "no bundle there" in capsys.readouterr().err
    assert execute(["personalize", out, "--set", out, "--manner", "like Ada", "-o", str(tmp_path / "ada")]) == 2
    assert "not trained" in capsys.readouterr().err


def _trained(folder: Path, capsys: pytest.CaptureFixture[str], *, muscles: bool) -> dict:
    """Output of `train autoencoder --json` after two steps on two short clips."""
    motions = folder / "bandai"
    motions.mkdir()
    clip = default_clip()
    save_motion(clip[240:330], motions / "walk_normal_001.npz")
    save_motion(clip[240:300], motions / "walk_happy_001.npz")
    (motions / "bandai_index.csv").write_text(
        "file,content,style\nwalk_normal_001.npz,walk,normal\nwalk_happy_001.npz,walk,happy\n"
    )
    build([motions], folder / "set", BuildSettings(muscles=muscles, mirrored=False))
    config = folder / "small.yaml"
    text = (
        (FOLDER / "stream.yaml")
        .read_text()
        .replace("joint_contact: true", f"muscles: {str(muscles).lower()}, joint_contact: {str(muscles).lower()}")
    )
    config.write_text(text.replace("batch: 64", "batch: 4").replace("width: 192, heads: 6", "width: 24, heads: 2"))
    arguments = ["train", "autoencoder", "--set", str(folder / "set"), "--config", str(config)]
    assert execute([*arguments, "-o", str(folder / "run"), "--steps", "2", "--threads", "1", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_train_writes_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = _trained(tmp_path, capsys, muscles=False)
    assert found["step"] == found["steps"] == 2
    assert found["validation"]["points_mm"] > 0


def test_training_on_muscles_compares_their_torques(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Regression: the command did not use the loss of the muscles' torques."""
    pytest.importorskip("myo_sim", reason="muscles need the extra 'biomech'")
    assert _trained(tmp_path, capsys, muscles=True)["validation"]["muscle_torques"] > 0


@pytest.mark.usefixtures("hears_interrupt")
def test_ctrl_c_saves_and_says_from_where_a_training_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """SIGINT after half a minute left the folder of the stage empty, and nothing was said."""
    _trained(tmp_path, capsys, muscles=False)
    arguments = ["train", "autoencoder", "-o", str(tmp_path / "run"), "--threads", "1", "--steps"]
    command = [sys.executable, "-m", "flexmotion.streamer", "-v", *arguments, "100000"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None and process.stdout is not None
        too_long = threading.Timer(LONGEST_S, process.kill)
        too_long.start()
        told = []
        for line in process.stderr:
            told.append(line)
            if "resumes at step 2" in line:
                process.send_signal(signal.SIGINT)
        output = process.stdout.read()
        too_long.cancel()
    assert process.returncode == 130 and not output
    found = re.search(r"autoencoder: interrupted and saved; resumes from step (\d+) of 100000", "".join(told))
    assert found is not None and "Traceback" not in "".join(told)
    step = int(found[1])
    assert read_checkpoint(tmp_path / "run" / "autoencoder" / LAST)["step"] == step >= 2
    assert execute([*arguments, str(step + 1), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["step"] == step + 1
