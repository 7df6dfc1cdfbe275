"""A log of several parts, and locks on what a run writes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.stream import LogParts, StreamSettings, load_stream
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.cli import execute
from flexmotion.streamer.commands.log_option import log_file
from flexmotion.streamer.log.lock import locked_folder
from flexmotion.streamer.log.log_file import LogFile
from flexmotion.streamer.log.parts import Rotation, later_parts, part_number, part_path
from flexmotion.streamer.log.reader import read_log
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.requests import Request

from ...virtual_time import virtual_time

PART_S = 2.0
Make = Callable[..., Any]


def settings(**limits: float) -> StreamSettings:
    return load_stream().model_copy(update={"log": LogParts(**limits)})


@pytest.fixture(scope="module")
def in_parts(logged_session: Make, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A finished lockstep run whose log is in parts of two seconds; treat as read-only."""
    made = logged_session(
        tmp_path_factory.mktemp("parts") / "run.mcap",
        ClipSource(default_clip()[225:290]),
        settings=settings(part_s=PART_S),
    )
    made.session.run()
    return made


def test_a_log_in_parts_is_read_as_one(in_parts: Any) -> None:
    """A daemon wrote 24 MB a minute into one file, without an end."""
    record, log = in_parts.session.record, read_log(in_parts.path)
    assert len(log.parts) > 2 and list(log.parts[1:]) == later_parts(in_parts.path)
    assert log.whole and log.gaps == 0 and log.missing == ()
    for name in record.rows.dtype.names:
        np.testing.assert_array_equal(log.rows[name], record.rows[name], err_msg=name)
    assert log.events == list(record.events)
    assert [plan["id"] for plan in log.plans] == list(range(1, in_parts.session.plans.newest_id + 1))
    ticks = [len(read_log(part).rows) for part in log.parts[1:-1]]
    assert ticks == [PART_S * log.header.rate_hz] * len(ticks)


def test_a_part_is_a_log_of_its_own(in_parts: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = later_parts(in_parts.path)[0]
    alone = read_log(part)
    assert alone.parts == (part,) and alone.rows["tick"][0] > 0 and alone.whole
    assert alone.source().name == in_parts.session.source.name
    assert execute(["log", "show", str(part)]) == 0
    assert execute(["log", "plot", str(part), "-o", str(tmp_path)]) == 0
    assert execute(["log", "replay", str(part)]) == 2
    assert "its first ticks are missing" in capsys.readouterr().err


def test_a_log_in_parts_replays_bit_for_bit(in_parts: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["log", "replay", str(in_parts.path)]) == 0
    assert "bit for bit" in capsys.readouterr().out


def test_a_part_that_is_missing_is_told_and_not_replayed(
    in_parts: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second, *others = (in_parts.path, *later_parts(in_parts.path))
    for path in (first, *others):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    log = read_log(tmp_path / first.name)
    assert log.missing == (part_number(second),) and log.gaps == len(read_log(second).rows)
    assert execute(["log", "show", str(log.path)]) == 0
    assert "parts 2 were removed" in capsys.readouterr().out
    assert execute(["log", "replay", str(log.path)]) == 2
    assert "its parts 2 were removed" in capsys.readouterr().err


def test_a_part_of_another_run_is_not_read(in_parts: Any, logged_session: Make, tmp_path: Path) -> None:
    other = logged_session(tmp_path / "run.mcap", ClipSource(default_clip()[:30]))
    other.session.run()
    second = later_parts(in_parts.path)[0]
    (tmp_path / second.name).write_bytes(second.read_bytes())
    log = read_log(other.path)
    assert log.parts == (other.path,) and len(log.rows) == other.session.record.used


def test_an_overwritten_log_takes_its_later_parts_with_it(logged_session: Make, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    part_path(path, 2).write_bytes(b"old")
    (tmp_path / "run.part.mcap").write_bytes(b"another's")
    logged_session(path, ClipSource(default_clip()[:30])).session.run()
    assert later_parts(path) == [] and (tmp_path / "run.part.mcap").exists()


def test_the_oldest_parts_but_the_first_are_removed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    rotation = Rotation(path, LogParts(part_mb=1.0, keep_mb=4.0))
    path.write_bytes(bytes(1_000_000))
    removed = []
    for _ in range(5):
        part_path(path, rotation.number + 1).write_bytes(bytes(900_000))
        for old in rotation.advance():
            removed.append(part_number(old))
            old.unlink()
    assert removed == [2, 3, 4] and path.exists()
    assert sum(part.stat().st_size for part in tmp_path.iterdir()) <= 4e6
    assert rotation.due(1_000_000, 0.0) and not rotation.due(999_999, 1.0) and rotation.due(0, 1800.0)


def test_limits_that_keep_too_little_are_refused() -> None:
    with pytest.raises(ValueError, match="at least three parts"):
        LogParts(part_mb=10.0, keep_mb=20.0)


def test_a_removed_part_is_told(logged_session: Make, tmp_path: Path) -> None:
    tiny = settings(part_mb=0.05, keep_mb=0.2)
    made = logged_session(tmp_path / "run.mcap", ClipSource(default_clip()[225:290]), settings=tiny)
    made.session.run()
    notes = [event.message for event in made.session.record.events if event.kind == "note"]
    assert any("is removed: the parts of a log take more than keep_mb" in note for note in notes)
    log = read_log(made.path)
    assert log.missing and log.rows["tick"][0] == 0 and log.rows["tick"][-1] == made.session.record.tick[-1]


def test_a_full_disk_while_a_part_is_begun_ends_the_log_and_not_the_run(
    logged_session: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = logged_session(tmp_path / "run.mcap", settings=settings(part_s=PART_S))
    part_path(made.path, 2).mkdir()  # a file that cannot be made
    record = made.session.run()
    assert record.state[-1] == 0 and record.violations_sent == 0
    stopped = [event.message for event in record.events if "recording stopped" in event.message]
    assert len(stopped) == 1 and stopped[0].endswith("the run goes on without a log")
    log = read_log(made.path)
    assert 0 < len(log.rows) < record.used and log.gaps == 0
    assert "recording stopped" in made.recorder.result()


# ---------------------------------------------------------------- locks


def test_two_runs_do_not_write_to_one_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The second run cut the file of the first to nothing, and both wrote into it."""
    path = tmp_path / "run.mcap"
    held = LogFile(path)
    held.write(b"of the first run")
    assert execute(["dry-run", "--seconds", "0.3", "--log", str(path)]) == 2
    assert "run.mcap: a run that is not over yet writes to it; choose another path" in capsys.readouterr().err
    assert path.read_bytes() == b"of the first run"
    held.close()
    path.unlink()
    assert execute(["dry-run", "--seconds", "0.3", "--log", str(path)]) == 0
    assert read_log(path).whole


@pytest.mark.parametrize("name", ["run.mcap", "run.part0002.mcap"])
@pytest.mark.parametrize("command", [["dry-run"], ["run", "-r", "op3", "-d", "sim"]])
def test_a_run_does_not_replace_an_earlier_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, command: list[str]
) -> None:
    """The second run with the same `--log` replaced the log of the first without a word, and removed its parts."""
    (tmp_path / name).write_bytes(b"of an earlier run")
    assert execute([*command, "--seconds", "0.3", "--log", str(tmp_path / "run.mcap")]) == 2
    err = capsys.readouterr().err
    assert f"{name}: there is a log already" in err and "give a folder" in err and err.count("\n") == 1
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [(name, b"of an earlier run")]


def test_a_refused_run_leaves_no_empty_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run whose robot file was refused left the empty folder of its report behind."""
    for folder in (tmp_path / "report", tmp_path / "new" / "report"):
        assert execute(["dry-run", "-r", str(tmp_path), "--report", str(folder)]) == 2
        assert "no robot file" in capsys.readouterr().err
    (tmp_path / "mine").mkdir()
    assert execute(["dry-run", "-r", str(tmp_path), "--report", str(tmp_path / "mine")]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_two_runs_do_not_write_to_one_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "report"
    with locked_folder(folder):
        assert execute(["dry-run", "--seconds", "0.3", "--report", str(folder)]) == 2
        assert f"--report: {folder}: a run that is not over yet" in capsys.readouterr().err
        assert list(folder.iterdir()) == []
    with locked_folder(folder):
        pass


@pytest.mark.parametrize("option", ["--log", "--report"])
def test_a_second_run_by_mistake_ends_before_anything_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: str
) -> None:
    """It took seconds, in which the model was loaded, until it said that the other run writes to the file."""
    loaded = list[str]()
    monkeypatch.setattr("flexmotion.streamer.api.open_robot", loaded.append)
    path = tmp_path / "run.mcap"
    held = LogFile(path)
    with locked_folder(tmp_path):
        for command in (["dry-run"], ["run", "-r", "op3", "-d", "sim"]):
            assert execute([*command, option, str(path if option == "--log" else tmp_path)]) == 2
    held.close()
    assert not loaded


def test_runs_that_begin_in_the_same_second_get_files_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.strftime", lambda _format: "20260101-000000")
    names = []
    for _ in range(3):
        path = log_file(tmp_path, None)
        assert path is not None
        path.touch()
        names.append(path.name)
    assert names == ["20260101-000000.mcap", "20260101-000000-2.mcap", "20260101-000000-3.mcap"]


def test_a_log_is_free_again_after_its_run(logged_session: Make, tmp_path: Path) -> None:
    for _ in range(2):
        made = logged_session(tmp_path / "run.mcap", ClipSource(default_clip()[:30]))
        made.session.run()


def test_a_log_stays_locked_in_every_process_of_a_run(logged_session: Make, tmp_path: Path) -> None:
    """Also while it goes on in a later part, in the recorder's process."""
    made = logged_session(tmp_path / "run.mcap", clock="real", settings=settings(part_s=1.0), realtime=False)
    session = made.session
    refused: list[str] = []

    def operate() -> Request | None:
        if not refused and part_path(made.path, 3).exists():
            with pytest.raises(ConfigError, match="a run that is not over yet") as told:
                LogFile(made.path)
            refused.append(str(told.value))
        return None

    session.next_request = operate
    with virtual_time():
        session.run()
    assert refused
    LogFile(made.path).close()


def test_a_folder_to_log_to_is_made_where_its_own_folder_exists(tmp_path: Path) -> None:
    """A folder that did not exist was refused as "expected a folder"."""
    path = log_file(tmp_path / "logs", None)
    assert path is not None and path.parent == tmp_path / "logs" and path.parent.is_dir()
    with pytest.raises(typer.BadParameter, match=r"there is no folder .*nowhere"):
        log_file(tmp_path / "nowhere" / "logs", None)
    with pytest.raises(typer.BadParameter, match=r"ends in \.mcap"):
        log_file(tmp_path / "run.txt", None)
    assert not (tmp_path / "nowhere").exists()
