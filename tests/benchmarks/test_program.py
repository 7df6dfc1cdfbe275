"""`started`: programs that a benchmark starts."""

from __future__ import annotations

import subprocess
import sys

import psutil
import pytest

from benchmarks.shared.program import started

WAITS = (sys.executable, "-c", "import signal; print('begun', flush=True); signal.pause()")
BENCHMARK = f"""
from benchmarks.shared.program import end_on_terminate, started

end_on_terminate()
with started({WAITS!r}) as program:
    print(program.pid, flush=True)
    program.wait()
"""


def test_a_benchmark_that_is_terminated_leaves_no_program_behind() -> None:
    """A soak that was ended by SIGTERM left its dry run behind, which went on streaming."""
    with subprocess.Popen([sys.executable, "-c", BENCHMARK], stdout=subprocess.PIPE, text=True) as benchmark:
        assert benchmark.stdout is not None
        lines = [benchmark.stdout.readline().strip() for _ in range(2)]
        program = psutil.Process(int(next(line for line in lines if line.isdigit())))
        benchmark.terminate()
        assert benchmark.wait(60) == 143
    assert not program.is_running()


def test_a_program_ends_where_its_benchmark_fails() -> None:
    """Of a soak in the background, where SIGINT is ignored, a segment went on for two minutes."""
    with (
        pytest.raises(ZeroDivisionError),
        started(WAITS, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as program,
    ):
        assert program.stdout is not None and program.stdout.readline() == "begun\n"
        1 / 0  # noqa: B018
    assert program.returncode == -15
