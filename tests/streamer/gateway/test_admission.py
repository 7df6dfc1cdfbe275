"""Who may speak to a run: token, host, origin."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.gateway.admission import TOKEN_VARIABLE, Admission, find_token

TOKEN = "correct horse battery"


def why(admission: Admission, query: str = "", **headers: str) -> str | None:
    refusal = admission.refusal(headers, query)
    return None if refusal is None else refusal.why


def test_a_program_of_this_machine_needs_no_token() -> None:
    assert why(Admission(), host="127.0.0.1:8790") is None
    assert why(Admission(), host="localhost:8790") is None
    assert why(Admission(), host="[::1]:8790") is None


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8790", "", "127.0.0.1.evil.example", "[::1", "a@b:c"])
def test_a_host_name_of_another_machine_is_refused(host: str) -> None:
    """DNS rebinding: a page's own host name leads to 127.0.0.1, and the browser takes both for one."""
    assert why(Admission(), host=host) == "host"


@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "http://127.0.0.1:9999", "http://localhost:8790", "file://", "http://[::1", ""],
)
def test_a_page_of_another_server_is_refused(origin: str) -> None:
    assert why(Admission(), host="127.0.0.1:8790", origin=origin) == "origin"


def test_the_runs_own_page_is_admitted_also_at_the_port_for_stops() -> None:
    assert why(Admission(), host="127.0.0.1:8790", origin="http://127.0.0.1:8790") is None
    stops = Admission(page_port=8790)
    assert why(stops, host="127.0.0.1:8791", origin="http://127.0.0.1:8790") is None
    assert why(stops, host="127.0.0.1:8791", origin="http://127.0.0.1:8000") == "origin"
    assert why(stops, host="127.0.0.1:8791", origin="http://evil.example:8790") == "origin"


def test_a_token_is_needed_where_one_is_set_and_browsers_send_it_in_the_address() -> None:
    admission = Admission("192.168.0.5", TOKEN)
    host = {"host": "192.168.0.5:8790"}
    assert why(admission, **host) == "token"
    assert why(admission, **host, authorization="Bearer wrong") == "token"
    assert why(admission, **host, authorization="Bearer ü") == "token"
    assert why(admission, **host, authorization=f"Bearer {TOKEN}") is None
    assert why(admission, query="token=correct+horse+battery", **host) is None
    assert why(admission, query="token=wrong", **host) == "token"
    wrong = admission.refusal({**host, "authorization": "Bearer wrong"})  # it said that none was given
    assert wrong is not None and wrong.reason.startswith("not the token of this run")
    assert admission.refusal(host, token_needed=False) is None


@pytest.mark.parametrize("address", ["0.0.0.0", "192.168.0.5", "::", "robot.local"])
def test_an_address_that_others_reach_needs_a_token(address: str) -> None:
    with pytest.raises(ConfigError, match="needs a token: set FLEXMOTION_TOKEN or give --token-file"):
        Admission(address)
    Admission(address, TOKEN)


def test_a_run_that_listens_beyond_this_machine_is_found_by_multicast_dns(monkeypatch: pytest.MonkeyPatch) -> None:
    """`flexmotion drive --host robot.local`, the example of its help, was refused as a foreign host."""
    monkeypatch.setattr("socket.gethostname", lambda: "Robot.example.org")
    assert why(Admission("0.0.0.0", TOKEN), host="robot.local:8790", authorization=f"Bearer {TOKEN}") is None
    assert why(Admission("0.0.0.0", TOKEN), host="other.local:8790", authorization=f"Bearer {TOKEN}") == "host"
    assert why(Admission(), host="robot.local:8790") == "host"  # without a token no name of others is believed


def test_a_token_that_can_be_guessed_is_refused() -> None:
    with pytest.raises(ConfigError, match="16 printable ASCII characters or more"):
        Admission(token="secret")


def test_a_token_comes_from_a_file_that_nobody_else_reads_or_from_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "token"
    file.write_text(f"{TOKEN}\n")
    file.chmod(0o644)
    with pytest.raises(ConfigError, match="other users can read it: chmod 600"):
        find_token(file)
    file.chmod(0o600)
    assert find_token(file) == TOKEN
    with pytest.raises(ConfigError, match="cannot be read"):
        find_token(tmp_path / "none")
    monkeypatch.setenv(TOKEN_VARIABLE, "from the environment")
    assert find_token() == "from the environment"
    monkeypatch.delenv(TOKEN_VARIABLE)
    assert find_token() is None
