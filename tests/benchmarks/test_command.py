"""`python -m benchmarks`: its list, its options, how a benchmark ends, what `--keep` writes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Annotated

import pytest
import typer

from benchmarks import command, results
from benchmarks.__main__ import main
from benchmarks.catalogue import CATALOGUE, Benchmark, find
from benchmarks.results import Result, check_imported, kept, measured_commit
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.configs.errors import ConfigError

FOLDER = Path(__file__).parents[2] / "benchmarks"


def test_every_module_with_a_main_is_in_the_catalogue() -> None:
    modules = {
        path.relative_to(FOLDER).with_suffix("").as_posix()
        for path in FOLDER.glob("*/*.py")
        if "\ndef main(" in path.read_text(encoding="utf-8")
    }
    assert modules == {benchmark.name for benchmark in CATALOGUE}
    assert len(modules) == len(CATALOGUE)


@pytest.mark.parametrize("benchmark", CATALOGUE, ids=lambda benchmark: benchmark.name)
def test_every_benchmark_asks_a_question_and_shows_its_options(
    benchmark: Benchmark, capsys: pytest.CaptureFixture[str]
) -> None:
    assert benchmark.asks.endswith("?") and benchmark.takes
    try:
        benchmark.check_extras()
    except ConfigError as missing:
        pytest.skip(str(missing))
    with pytest.raises(SystemExit) as ended:
        command.run(benchmark, ["--help"])
    assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert f"benchmarks {benchmark.name}" in shown and "--keep" in shown


def test_the_list_imports_no_benchmark() -> None:
    program = "import sys; from benchmarks.__main__ import main; main([]); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=FOLDER.parent, capture_output=True, text=True, check=True
    )
    assert all(benchmark.name in done.stdout for benchmark in CATALOGUE)
    loaded = set(done.stdout.splitlines()[-1].split())
    assert not loaded & {"torch", "mujoco", "onnxruntime", "opensim", "rustypot", "matplotlib"}


def test_unknown_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot/walk"]) == 2
    assert "no benchmark 'robot/walk', expected one of robot/clips" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="expected model/hearing"):
        find("hearing")
    assert main(["tables", "--wrong"]) == 2


def test_a_listing_is_asked_for_by_name_too(capsys: pytest.CaptureFixture[str]) -> None:
    """The word `list` was taken for a benchmark: all sixty names came in one line of an error."""
    assert main(["list"]) == 0
    assert all(benchmark.name in capsys.readouterr().out for benchmark in CATALOGUE[:1])
    assert main(["lst"]) == 2
    told = capsys.readouterr().err
    assert "`python -m benchmarks` lists them" in told and "robot/clips" not in told


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("benchmarks.catalogue.find_spec", lambda _name: None)
    with pytest.raises(SystemExit) as ended:
        command.run(find("bus/cycle_time"), [])
    assert ended.value.code == 2
    assert "needs the extra 'dev'" in capsys.readouterr().err


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Benchmark:
    """A benchmark that passes with an even number of samples; results go to a folder of their own."""

    def own_main(samples: Annotated[int, typer.Option(min=1)] = 2, fails: bool = False) -> Outcome:
        if fails:
            raise ConfigError("bundle: not there")
        return Outcome([Verdict(f"even: {samples}", samples % 2 == 0)], {"samples": samples, "third": samples / 3})

    module = ModuleType("benchmarks.model.example", "Is it even?")
    module.main = own_main  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "benchmarks.model.example", module)
    monkeypatch.setattr(results, "FOLDER", tmp_path)
    monkeypatch.setattr(Result.write, "__defaults__", (tmp_path,))
    monkeypatch.setattr(command, "check_imported", lambda: None)
    monkeypatch.setattr(command, "measured_commit", lambda: "0123456789ab")
    return Benchmark("model/example", "1 s")


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        ([], 0, "PASS even: 2"),
        (["--samples", "3"], 1, "FAIL even: 3"),
        (["--samples", "0"], 2, "--samples"),
        (["--fails"], 2, "benchmarks model/example: bundle: not there"),
    ],
)
def test_how_a_benchmark_ends(
    example: Benchmark, options: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        command.run(example, options)
    assert (ended.value.code or 0) == code
    printed = capsys.readouterr()
    assert said in printed.out + printed.err


def test_keep_writes_commit_date_machine_command_and_figures(example: Benchmark, tmp_path: Path) -> None:
    data = tmp_path / "data" / "set"
    with pytest.raises(SystemExit) as ended:
        command.run(example, ["--samples", "7", "--keep"])
    assert ended.value.code == 1
    result = kept("model/example", tmp_path)
    assert result is not None and not result.passed
    assert result.command == "python -m benchmarks model/example --samples 7" and result.commit == "0123456789ab"
    assert result.figures == {"samples": 7, "third": 2.333}
    assert result.machine.cores >= 1 and len(result.date) == len("2026-01-31")
    # A path of this machine is no part of a result.
    options = ["--set", str(data), f"--plots={data}"]
    named = Result.of("model/example", options, "0123456789ab", 1.0, Outcome(figures={"nan": float("nan")}))
    assert named.command == "python -m benchmarks model/example --set set --plots=set"
    named.write(tmp_path)
    again = kept("model/example", tmp_path)
    assert again is not None and again.figures == {"nan": None} and again.passed


def test_results_that_are_none(tmp_path: Path) -> None:
    assert kept("model/none", tmp_path) is None
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "none.json").write_text('{"name": "model/none"}')
    with pytest.raises(ConfigError, match=r"none\.json: not a result"):
        kept("model/none", tmp_path)


def test_kept_results_are_of_benchmarks() -> None:
    names = [path.relative_to(results.FOLDER).with_suffix("").as_posix() for path in results.FOLDER.glob("**/*.json")]
    assert names and set(names) <= {benchmark.name for benchmark in CATALOGUE}
    for name in names:
        result = kept(name)
        assert result is not None and result.command.startswith(f"python -m benchmarks {name}")
        assert not any(word in json.dumps(result.model_dump()) for word in ("/home/", "/tmp/", "/work/"))


def test_only_a_committed_tree_is_measured(tmp_path: Path) -> None:
    def git(*arguments: str) -> None:
        identity = ["-c", "user.name=test", "-c", "user.email=test@example.org"]
        subprocess.run(["git", "-C", str(tmp_path), *identity, *arguments], check=True, capture_output=True)

    with pytest.raises(ConfigError, match="needs a git clone"):
        measured_commit(tmp_path)
    git("init")
    (tmp_path / "module.py").write_text("x = 1\n")
    git("add", ".")
    git("commit", "-m", "first")
    assert len(measured_commit(tmp_path)) == 12
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "model.md").write_text("a table\n")
    assert len(measured_commit(tmp_path)) == 12
    (tmp_path / "module.py").write_text("x = 2\n")
    with pytest.raises(ConfigError, match=r"commit your changes first \(module\.py\)"):
        measured_commit(tmp_path)


def test_only_the_package_of_the_working_tree_is_measured(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="run it in the clone's folder"):
        check_imported(tmp_path)


def test_csv(tmp_path: Path) -> None:
    write_csv(tmp_path / "rows.csv", [{"a": 1, "b": "x"}, {"a": 2, "b": "y, z"}])
    assert (tmp_path / "rows.csv").read_text().splitlines() == ["a,b", "1,x", '2,"y, z"']
