"""`flexmotion robots tune`, and `flexmotion robots` beside it."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.tunable import tunable_numbers
from flexmotion.human.motion_file import save_motion
from flexmotion.streamer.checks.switching import shipped_clips
from flexmotion.streamer.cli import execute
from flexmotion.streamer.tuning import measurer
from flexmotion.streamer.tuning.result import TuningResult

from ..tuning.formula import FormulaMeasurer

TWO = "gait.clearance,gait.double_support_min_s"


@pytest.fixture
def lists(tmp_path: Path) -> list[str]:
    """Options with a list of one short clip each."""
    clip = shipped_clips()["walk"]
    save_motion(clip[:50], tmp_path / "walk.npz")
    save_motion(clip[40:90], tmp_path / "other.npz")
    (tmp_path / "tuned.yaml").write_text("walking: [walk.npz]\n")
    (tmp_path / "reported.yaml").write_text("walking: [other.npz]\n")
    return ["--clips", str(tmp_path / "tuned.yaml"), "--report", str(tmp_path / "reported.yaml")]


def tune(out: Path, lists: list[str], *more: str) -> int:
    command = ["robots", "tune", "op3", "-o", str(out), "--numbers", TWO, "--jobs", "1"]
    return execute([*command, *lists, "--population", "3", *more])


def test_a_tiny_campaign(lists: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two numbers of OP3 are tuned on a short clip; the robot that comes out runs, and the figures stand beside it."""
    out = tmp_path / "tuned"
    assert tune(out, lists, "-g", "2", "--json") == 0
    told = capsys.readouterr()
    result = TuningResult.model_validate_json(told.out)
    assert told.out == (out / "tuning.json").read_text()
    assert (result.finished, result.generations, result.candidates, result.failed) == (True, 2, 6, 0)
    assert result.tuning.after.cost <= result.tuning.before.cost < 1.0
    assert result.reporting is not None
    assert [run.clip for run in result.reporting.before.runs] == ["other.npz"]
    assert "generation 2: cost" in told.err
    page = (out / "tuning.md").read_text()
    assert "| walking | walk.npz |" in page and "| walking | other.npz |" in page

    found = load_robot(out / "robot")
    assert found.gait.clearance == result.numbers["gait.clearance"].after
    assert found.gait.double_support_min_s == result.numbers["gait.double_support_min_s"].after
    assert "# the 8 ms cycle of the robot's own firmware" in found.file.read_text()
    assert execute(["robots", str(out / "robot"), "--json"]) == 0

    # Once more, all of it is known.
    capsys.readouterr()
    before = (out / "state.json").read_bytes()
    assert tune(out, lists, "-g", "2") == 0
    assert (out / "state.json").read_bytes() == before
    assert "generation" not in capsys.readouterr().err

    assert tune(out, lists, "-g", "2", "--seed", "1") == 2
    assert "was begun with another seed (0; here 1). Give the same command" in capsys.readouterr().err


@pytest.fixture
def formula(monkeypatch: pytest.MonkeyPatch) -> Callable[[int | None], None]:
    """Sets the batch at which a campaign, which measures by a formula, is interrupted."""

    def interrupt(batch: int | None) -> None:
        monkeypatch.setattr(measurer, "ProcessMeasurer", lambda workers, done: FormulaMeasurer(batch, done))

    return interrupt


def test_an_interrupt_leaves_what_was_found_and_the_same_command_goes_on(
    lists: list[str],
    formula: Callable[[int | None], None],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "tuned"
    formula(3)
    assert tune(out, lists, "-g", "5") == 130
    assert "Not finished: start the same command again" in capsys.readouterr().err
    result = TuningResult.model_validate_json((out / "tuning.json").read_bytes())
    assert (result.finished, result.generations, result.reporting) == (False, 2, None)
    assert load_robot(out / "robot").gait.clearance == result.numbers["gait.clearance"].after

    formula(None)
    assert tune(out, lists, "-g", "5") == 0
    assert tune(tmp_path / "whole", lists, "-g", "5") == 0
    assert (out / "tuning.json").read_bytes() == (tmp_path / "whole" / "tuning.json").read_bytes()


def test_an_interrupt_before_anything_is_measured_leaves_nothing(
    lists: list[str], formula: Callable[[int | None], None], tmp_path: Path
) -> None:
    formula(0)
    assert tune(tmp_path / "tuned", lists) == 130
    assert not (tmp_path / "tuned").exists()


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (["--numbers", "gait.pace.turning"], "gait.pace.turning is not tuned: the heading is judged"),
        (["--report", "tuned.yaml"], "share walk.npz: a robot is reported on other motion"),
        (["--clips", "hal"], "list of clips hal: no such file, and none of: tuning, reporting"),
        (["--clips", "bad.yaml"], "bad.yaml: walking, entry 1: no such file"),
    ],
)
def test_bad_usage_is_told_in_a_line_before_anything_is_measured(
    more: list[str], told: str, lists: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.yaml").write_text("walking: [gone.npz]\n")
    named = [str(tmp_path / word) if word.endswith(".yaml") else word for word in more]
    assert tune(tmp_path / "tuned", lists, *named) == 2
    error = capsys.readouterr().err
    assert told in error and len(error.splitlines()) == 1
    assert not (tmp_path / "tuned").exists()


def test_a_missing_library_names_the_extra(
    lists: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "cma" else real(name))
    assert tune(tmp_path / "tuned", lists) == 2
    assert "tuning needs the extra 'tune': in a clone, pip install '.[tune]'" in capsys.readouterr().err


def test_the_numbers_that_may_be_tuned_are_listed_with_bounds_and_reasons(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["robots", "tune", "--list-numbers"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    known = tunable_numbers()
    for name, number in known.numbers.items():
        assert f"{name} [{number.unit}]: {number.bounds[0]:g} to {number.bounds[1]:g}" in told
        assert number.reason in told
    assert all(f"not {name}: {reason}" in told for name, reason in known.kept.items())


def test_robots_takes_a_robot_as_before_and_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["robots", "op3", "--json"]) == 0
    short = capsys.readouterr().out
    assert execute(["robots", "show", "op3", "--json"]) == 0
    assert capsys.readouterr().out == short and json.loads(short)["name"] == "op3"
    assert execute(["robots", "--json", "op3"]) == 0
    assert capsys.readouterr().out == short
    assert execute(["robots", "-h"]) == 0
    assert "flexmotion robots tune" in capsys.readouterr().out
    assert execute(["robots", "op3", "op3"]) == 2
    assert "unexpected extra argument" in capsys.readouterr().err
    (tmp_path / "tune").symlink_to(load_robot("op3").folder)
    monkeypatch.chdir(tmp_path)
    assert execute(["robots", "./tune", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["name"] == "op3"
