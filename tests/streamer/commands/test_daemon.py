"""`flexmotion daemon`: the unit that it prints."""

from __future__ import annotations

import configparser
import shutil
import subprocess
from pathlib import Path

import pytest
import typer

from flexmotion.streamer.cli import execute
from flexmotion.streamer.commands import daemon as command
from flexmotion.streamer.commands.daemon import unit

OPTIONS = ["--robot", "op3", "--driver", "dynamixel", "--port", "/dev/ttyUSB0"]


def service(text: str) -> configparser.SectionProxy:
    parser = configparser.RawConfigParser(strict=True)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read_string(text)
    return parser["Service"]


def test_a_unit_reports_progress_and_never_stands_a_fallen_robot_up(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["daemon", "--user", "robot", "--", *OPTIONS]) == 0
    found = service(capsys.readouterr().out)
    assert (found["Type"], found["Restart"], found["User"]) == ("notify", "no", "robot")
    assert found["AmbientCapabilities"] == "CAP_SYS_NICE" and float(found["WatchdogSec"]) > 0
    # Another signal, or one to all processes, would end the planner or the loop while the robot walks.
    assert (found["WatchdogSignal"], found["KillMode"]) == ("SIGTERM", "process")
    words = found["ExecStart"].split()
    assert words[1:8] == ["run", *OPTIONS] and words[8:] == [
        "--web",
        "--wait",
        "--allow-refused",
        "--no-arm",
        "--log",
        "%L/flexmotion",
    ]
    assert Path(words[0]).is_absolute() and Path(words[0]).exists()


def test_what_is_given_is_not_added() -> None:
    text = unit([*OPTIONS, "--web", "--log=/data", "--wait", "--arm"], "robot")
    words = service(text)["ExecStart"].split()
    assert words.count("--wait") == words.count("--web") == 1
    assert "--no-arm" not in words and "%L/flexmotion" not in words


def test_a_unit_with_one_file_for_its_log_is_refused() -> None:
    """Each start of the daemon replaced the log of the one before."""
    with pytest.raises(typer.BadParameter, match="expected a folder"):
        unit([*OPTIONS, "--log", "/data/run.mcap"], "robot")


def test_a_unit_with_a_motion_waits_to_be_armed_too() -> None:
    """Its robot would have stood up and walked as soon as somebody powered it, with nobody to stop it."""
    words = service(unit([*OPTIONS, "--prompt", "walk"], "robot"))["ExecStart"].split()
    assert "--no-arm" in words and "--web" in words


def test_words_are_quoted_for_systemd() -> None:
    text = unit(["-r", "op3", "-d", "sim", "--prompt", 'say 100 % of "$HOME"'], "robot")
    assert r'"say 100 %% of \"$$HOME\""' in service(text)["ExecStart"]


def test_options_that_run_does_not_take_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["daemon", "--", "--robot", "op3"]) == 2
    assert "--driver" in capsys.readouterr().err
    assert execute(["daemon", "--", *OPTIONS, "--no-such-option"]) == 2
    assert "--no-such-option" in capsys.readouterr().err


def test_a_robot_or_driver_that_is_not_there_is_told_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    """The unit was printed, and its service failed at the next start of the machine."""
    assert execute(["daemon", "--", "-r", "op3", "-d", "dynamixl", "-p", "/dev/ttyUSB0"]) == 2
    assert "unknown driver 'dynamixl', expected one of: dynamixel" in capsys.readouterr().err
    assert execute(["daemon", "--", "-r", "op4", "-d", "sim"]) == 2
    assert "op4" in capsys.readouterr().err


def test_the_two_dashes_may_be_missing(capsys: pytest.CaptureFixture[str]) -> None:
    """It said "No such option: -r", of an option that the same page of help shows."""
    assert execute(["daemon", "--user", "robot", *OPTIONS]) == 0
    found = service(capsys.readouterr().out)
    assert found["User"] == "robot" and found["ExecStart"].split()[1:8] == ["run", *OPTIONS]


def test_paths_hold_in_the_folder_of_the_service(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A service runs in a folder of its own: a path of the shell that wrote the unit pointed to nothing there."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(Path(command.__file__).parents[2] / "configs" / "robots" / "op3", tmp_path / "mine")
    (tmp_path / "mine" / "op3.yaml").rename(tmp_path / "mine" / "robot.yaml")
    options = [
        "-r",
        "mine",
        "-d",
        "sim",
        "--name",
        "mine",
        "--log=mine",
        "--clips",
        "a.bvh",
        "--settings",
        "/etc/fm.yaml",
    ]
    words = service(unit(options, "robot"))["ExecStart"].split()
    here = str(tmp_path)
    assert words[2:12] == [
        "-r",
        f"{here}/mine",
        "-d",
        "sim",
        "--name",
        "mine",
        f"--log={here}/mine",
        "--clips",
        f"{here}/a.bvh",
        "--settings",
    ]
    assert words[12] == "/etc/fm.yaml" and unit(["-r", "op3", "-d", "sim"], "robot").count("-r op3") == 1


def test_it_is_installed_where_systemd_looks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "UNIT", tmp_path / "flexmotion.service")
    assert execute(["daemon", "--install", "--", *OPTIONS]) == 0
    assert service(command.UNIT.read_text())["Type"] == "notify"
    assert "systemctl enable --now flexmotion" in capsys.readouterr().err
    monkeypatch.setattr(command, "UNIT", tmp_path / "no" / "flexmotion.service")
    assert execute(["daemon", "--install", "--", *OPTIONS]) == 2


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_finds_nothing_wrong_with_it(tmp_path: Path) -> None:
    file = tmp_path / "flexmotion.service"
    file.write_text(unit(OPTIONS, "root"))
    done = subprocess.run(["systemd-analyze", "verify", str(file)], capture_output=True, text=True, check=False)
    told = [line for line in done.stderr.splitlines() if "flexmotion.service" in line]
    assert told == []
