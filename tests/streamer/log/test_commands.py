"""`flexmotion log` from a shell."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from flexmotion.streamer.cli import execute
from flexmotion.streamer.log.judged import Subject
from flexmotion.streamer.log.reader import read_log


@pytest.mark.parametrize("command", ["show", "plot", "replay"])
def test_help_has_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["log", command, "--help"]) == 0
    assert f"flexmotion log {command}" in capsys.readouterr().out.split("Examples")[1]


def test_show(logged: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["log", "show", str(logged.path), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    record = logged.session.record
    assert content["schema"] == "flexmotion.log-summary/1" and content["whole"]
    assert content["ticks"] == record.used and content["duration_s"] == pytest.approx(record.used / 125)
    assert [state["state"] for state in content["states"]] == ["READY", "STREAMING", "HOLD", "PARK", "OFF"]
    assert content["plans"]["made"] == content["plans"]["logged"] >= content["plans"]["played"] == len(record.plans)
    (target,) = content["targets"]
    (request,) = (event for event in content["events"] if event["kind"] == "request")
    assert (target["clip"], request["message"]) == ("wave", "END")
    assert target["at_s"] < request["at_s"]
    assert content["topics"]["/tick"]["messages"] == record.used
    assert content["safety"] == {"final_state": "OFF", "faults": [], "hardware_failed": False}
    assert content["loop"]["wake_lateness_us"] is None  # lockstep has no wake-ups
    assert execute(["log", "show", str(logged.path)]) == 0
    text = capsys.readouterr().out
    assert "op3 on sim" in text and "wave" in text and "/plan" in text
    assert "ended OFF, no fault" in text


@pytest.mark.parametrize(
    ("bytes_kept", "state", "told"),
    [(0.5, "STREAMING", "last seen in STREAMING"), (20_000, None, "unknown state: the log holds no tick")],
    ids=["in the middle", "before the first tick"],
)
def test_a_log_that_was_cut_off_claims_no_end(
    logged: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], bytes_kept: float, state: str | None, told: str
) -> None:
    """A log without a single tick said "ended OFF, no fault"."""
    content = logged.path.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: int(bytes_kept * len(content) if bytes_kept < 1 else bytes_kept)])
    assert execute(["log", "show", str(cut), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["safety"]["final_state"] == state
    assert execute(["log", "show", str(cut)]) == 0
    assert told in " ".join(capsys.readouterr().out.split())


def test_plot_draws_what_the_report_draws(logged: Any, tmp_path: Path) -> None:
    assert execute(["log", "plot", str(logged.path), "-o", str(tmp_path / "pictures")]) == 0
    drawn = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert drawn == {"robot.png", "footsteps.png", "timeline.png", "tracking.png", "torque.png"}


def test_a_report_has_a_log_that_replays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["dry-run", "--seconds", "0.4", "--perturbed", "--no-feedback", "--seed", "5", "--json"]
    assert execute([*arguments, "--report", str(tmp_path)]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["log"] == str(tmp_path / "run.mcap")
    assert execute(["log", "replay", report["log"], "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["schema"] == "flexmotion.replay/1" and content["agrees"] and content["equal"]
    motion = report["motion"]
    assert {name.partition(".")[0] for name in content["figures"]} == set(motion)
    for name, figure in content["figures"].items():
        section, _, part = name.partition(".")
        value = motion[section][part] if part else motion[section]
        assert figure["logged"] == (None if value is None else float(value)), name


def test_the_log_of_a_run_that_may_refuse_is_judged_like_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The log did not hold `--allow-refused`: the same run passed, and its log did not."""
    arguments = ["dry-run", "--prompt", "throw a punch", "--seconds", "0.4", "--report", str(tmp_path), "--json"]
    assert execute([*arguments, "--allow-refused"]) == 0
    report = json.loads(capsys.readouterr().out)
    log = read_log(Path(report["log"]))
    judged = Subject.of(log).report(log, log.record())
    assert judged.ok and judged.options["allow_refused"] and judged.targets[0].state == "refused"
    assert execute(arguments) == 1
    strict = read_log(Path(json.loads(capsys.readouterr().out)["log"]))
    assert not Subject.of(strict).report(strict, strict.record()).ok


def test_a_replay_that_differs_is_exit_code_1(
    logged: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from flexmotion.streamer.log import replay

    monkeypatch.setattr(replay, "_targets", lambda log: [])  # a target that got lost
    assert execute(["log", "replay", str(logged.path)]) == 1
    assert "the runs do NOT agree" in capsys.readouterr().out


@pytest.mark.parametrize("command", [["show"], ["replay"], ["plot", "-o", "pictures"]])
def test_a_file_that_is_no_log_is_exit_code_2(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "clip.mcap"
    file.write_text("HIERARCHY\n" * 50)
    assert execute(["log", *command, str(file)]) == 2
    err = capsys.readouterr().err
    assert err.startswith("flexmotion: ") and "clip.mcap: damaged, or not a log" in err and err.count("\n") == 1


def test_a_folder_gets_a_log_of_its_own_for_each_run(tmp_path: Path) -> None:
    assert execute(["run", "-r", "op3", "-d", "sim", "--clock", "lockstep", "-s", "0.2", "--log", str(tmp_path)]) == 0
    (log,) = tmp_path.iterdir()
    assert log.suffix == ".mcap"
