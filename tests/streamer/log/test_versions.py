"""Logs of older and newer versions: read, replayed, or refused with what to do."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.writer import Writer

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.cli import execute
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.log.judged import Subject
from flexmotion.streamer.log.reader import read_log
from flexmotion.streamer.log.replay import TOLERANCES, replay

OLD = Path(__file__).parent / "data" / "version_0.1.0.mcap"
"""Written by FlexMotion 0.1.0: `dry-run --clip steps.npz --seed 3 --perturb noise_scale=0`, its first 160 ticks."""

OLD_MODEL = OLD.with_name("model_0.1.0.mcap")
"""Likewise: `dry-run --prompt "step to the left" --seed 2 --seconds 1`, its first 145 ticks without `/plan`."""


def test_a_log_of_version_0_1_0_opens_and_replays(capsys: pytest.CaptureFixture[str]) -> None:
    log = read_log(OLD)
    assert log.header.software == "0.1.0" and len(log.rows) == 160
    assert {State(state) for state in log.rows["state"]} == {State.READY, State.STREAMING}
    assert log.source().window(0, 10) is not None
    # Equal bit for bit on the machine that wrote it; another processor may round differently.
    for figure in replay(log, Subject.of(log)).figures:
        if figure.logged is not None:
            assert figure.difference == pytest.approx(0.0, abs=TOLERANCES.get(figure.name, 0.01)), figure.name
    assert execute(["log", "show", str(OLD)]) == 0
    assert "160 ticks at 125 Hz" in capsys.readouterr().out


def test_a_log_of_the_model_of_version_0_1_0_is_read_and_says_why_it_is_not_replayed() -> None:
    """The bundle of that release is no longer shipped; its rows are read as before."""
    log = read_log(OLD_MODEL)
    assert log.header.software == "0.1.0" and len(log.rows) == 145
    assert State(log.rows["state"][-1]) is State.STREAMING
    expected = (
        r"is not the bundle of the run: .* the run's 363bd437c93721c6; replay it with the release that recorded it"
    )
    with pytest.raises(ConfigError, match=expected):
        log.source()


@pytest.mark.parametrize(
    ("version", "expected"),
    [
        ("2", "log of version 2, this release reads 1: the file is too new: install flexmotion 7.1, or newer"),
        ("0", "log of version 0, this release reads 1: the file is too old: open it with flexmotion 7.1"),
        ("next", "'next', expected a whole number; this release reads 1"),
    ],
)
def test_a_log_of_another_version_says_what_to_do(tmp_path: Path, version: str, expected: str) -> None:
    file = tmp_path / "run.mcap"
    with open(file, "wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_metadata(f"flexmotion.log/{version}", {"software": '"7.1"'})
        writer.finish()
    with pytest.raises(ConfigError, match=rf"run\.mcap: field flexmotion\.log: {expected}"):
        read_log(file)
