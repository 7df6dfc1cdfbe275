"""`served_run`: a run that a benchmark steers."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.shared.served_run import served_run
from flexmotion.bundles.shipped import shipped_bundle

PROGRAM = (sys.executable, str(Path(__file__).parents[1] / "virtual_program.py"))


@pytest.fixture(autouse=True)
def slow_enough(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    if shipped_bundle() is None:
        pytest.skip("no shipped model")
    monkeypatch.setenv("FASTEST", "4")
    yield


def test_a_run_that_stands_is_waited_for_and_reports() -> None:
    """A robot that nobody steers stands: benchmarks that waited for STREAMING waited for ever."""
    with served_run("--no-realtime", program=PROGRAM) as run:
        with run.client() as client:
            answer = client.text("wave with the right hand")
        assert answer.state == "accepted", answer
        assert {"loop", "planner", "gateway"} <= run.processor_s().keys()
    assert run.report["limits"]["violations_sent"] == 0
    assert run.report["targets"][-1]["asked"] == "wave with the right hand"


def test_a_run_ends_where_its_benchmark_fails() -> None:
    """A benchmark that failed left its run behind, and waited for its end."""
    with pytest.raises(ZeroDivisionError), served_run("--no-realtime", program=PROGRAM) as run:
        process = run.process
        raise ZeroDivisionError
    assert process.returncode is not None
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)
