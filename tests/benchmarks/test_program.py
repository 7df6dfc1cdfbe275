"""Programs and processes that a benchmark starts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

import benchmarks
from benchmarks.shared.program import started

from ..waiting import wait_until

WAITS = (sys.executable, "-c", "import signal; print('begun', flush=True); signal.pause()")
BENCHMARK = f"""
from benchmarks.shared.program import end_on_terminate, started

end_on_terminate()
with started({WAITS!r}) as program:
    print(program.pid, flush=True)
    program.wait()
"""
RUNS = """
import os, signal

def wait(task):
    with open(f"{task}.pid", "w") as file:
        file.write(str(os.getpid()))
    signal.pause()
"""
POOL = """
from benchmarks.shared.processes import in_order
from benchmarks.shared.program import end_on_terminate
from runs import wait

if __name__ == "__main__":
    end_on_terminate()
    in_order(wait, range(4), 2)
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


def test_a_benchmark_that_is_terminated_ends_the_processes_of_its_runs(tmp_path: Path) -> None:
    """A course that was ended by SIGTERM went on until its last run: the pool waited for all of them."""
    (tmp_path / "runs.py").write_text(RUNS)
    (tmp_path / "__main__.py").write_text(POOL)
    begun = [tmp_path / f"{task}.pid" for task in range(2)]
    found = os.environ | {"PYTHONPATH": str(Path(benchmarks.__file__).parents[1])}
    with subprocess.Popen([sys.executable, tmp_path], cwd=tmp_path, env=found) as benchmark:
        wait_until(lambda: all(file.is_file() and file.read_text() for file in begun), "two runs to begin")
        runs = [psutil.Process(int(file.read_text())) for file in begun]
        benchmark.terminate()
        assert benchmark.wait(60) == 143
    wait_until(lambda: not any(run.is_running() for run in runs), "their processes to end")
    assert not (tmp_path / "2.pid").exists()
