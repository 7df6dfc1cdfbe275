"""`--mirror` on the command line: its optional value, what it excludes, and what it refuses."""

from __future__ import annotations

import pytest

from flexmotion.streamer.cli import _with_defaults, execute
from flexmotion.streamer.commands.exit_codes import BAD_USAGE


@pytest.mark.parametrize(
    ("given", "filled"),
    [
        (["dry-run", "--mirror"], ["dry-run", "--mirror", "127.0.0.1:39539"]),
        (["dry-run", "--mirror", "--view"], ["dry-run", "--mirror", "127.0.0.1:39539", "--view"]),
        (["dry-run", "--mirror", "9000", "--view"], ["dry-run", "--mirror", "9000", "--view"]),
        (["dry-run"], ["dry-run"]),
    ],
)
def test_the_address_may_be_left_out(given: list[str], filled: list[str]) -> None:
    assert _with_defaults(given) == filled


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--mirror", "--prompt", "wave"], "--mirror and --prompt exclude each other"),
        (["--mirror", "--replan-noise", "0.02"], "--replan-noise and --mirror exclude each other"),
        (["--mirror", "robot:9000"], "--mirror: 'robot:9000', expected ADDRESS:PORT"),
        (["--mirror", "0.0.0.0"], "needs a token"),
        (["--mirror", "--clock", "lockstep"], "clock: lockstep"),
    ],
)
def test_what_cannot_be_is_one_line(
    options: list[str], named: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FLEXMOTION_TOKEN", raising=False)
    assert execute(["dry-run", *options]) == BAD_USAGE
    message = capsys.readouterr().err.strip()
    assert named in message and "\n" not in message
