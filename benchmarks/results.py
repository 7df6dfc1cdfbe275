"""Results that are kept: one JSON file a benchmark under `benchmarks/results/`."""

from __future__ import annotations

import os
import shlex
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

import flexmotion
from benchmarks.shared.outcome import Outcome
from flexmotion.configs.errors import ConfigError

ROOT = Path(__file__).resolve().parents[1]
FOLDER = Path(__file__).resolve().with_name("results")
NOT_MEASURED = (":!benchmarks/results", ":!docs", ":!*.md")
"""Changes that no result depends on (git pathspecs)."""
DIGITS = 4
"""Significant digits of a kept figure."""


class Machine(BaseModel):
    """Where a benchmark ran: processor model, number of cores, and the load average of the minute before its end."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    processor: str
    cores: int
    load: float

    @classmethod
    def here(cls) -> Machine:
        """Describe the machine that runs this."""
        return cls(processor=_processor(), cores=os.cpu_count() or 1, load=round(os.getloadavg()[0], 1))


class KeptVerdict(BaseModel):
    """A criterion with its figure and limit, and whether it held."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    sentence: str
    holds: bool


class Result(BaseModel):
    """The last kept run of a benchmark.

    Attributes:
        name: of the benchmark, such as `model/hearing`.
        command: that ran it; of paths outside the project only the last part.
        commit: the tree that was measured.
        date: of the end of the run, UTC.
        machine: that it ran on.
        seconds: of wall-clock time that it took.
        verdicts: its criteria.
        figures: its numbers by name; None where a number was not finite.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    name: str
    command: str
    commit: str
    date: str
    machine: Machine
    seconds: float
    verdicts: tuple[KeptVerdict, ...]
    figures: dict[str, Any]

    @classmethod
    def of(cls, name: str, options: Sequence[str], commit: str, seconds: float, outcome: Outcome) -> Result:
        """The result of a run that has just ended."""
        return cls(
            name=name,
            command=shlex.join(["python", "-m", "benchmarks", name, *map(_without_folders, options)]),
            commit=commit,
            date=datetime.now(UTC).strftime("%Y-%m-%d"),
            machine=Machine.here(),
            seconds=_rounded(seconds),
            verdicts=tuple(KeptVerdict(sentence=own.sentence, holds=own.holds) for own in outcome.verdicts),
            figures=_rounded(outcome.figures),
        )

    @property
    def passed(self) -> bool:
        """Whether every criterion held."""
        return all(verdict.holds for verdict in self.verdicts)

    def write(self, folder: Path = FOLDER) -> Path:
        """Write it as `NAME.json`."""
        path = folder / f"{self.name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.model_dump_json(indent=1) + "\n", encoding="utf-8")
        return path


def kept(name: str, folder: Path = FOLDER) -> Result | None:
    """The kept result of a benchmark; None without one.

    Raises:
        ConfigError: the file is no result, or is one of another benchmark.
    """
    path = folder / f"{name}.json"
    if not path.is_file():
        return None
    try:
        result = Result.model_validate_json(path.read_text(encoding="utf-8"))
    except ValidationError as error:
        raise ConfigError(f"{path.name}: not a result: {error.error_count()} fields are wrong") from error
    if result.name != name:
        raise ConfigError(f"{path.name}: expected the result of {name}, found that of {result.name}")
    return result


def check_imported(root: Path = ROOT) -> None:
    """Check that `flexmotion` is that of the working tree, whose commit a result is kept with.

    Raises:
        ConfigError: another one is imported.
    """
    if not Path(str(flexmotion.__file__)).resolve().is_relative_to(root):
        raise ConfigError(
            "--keep records the commit that was measured: run it in the clone's folder, or pip install -e ."
        )


def measured_commit(root: Path = ROOT) -> str:
    """The commit of the working tree, which a result is kept with.

    Raises:
        ConfigError: the tree is no git clone, or has changes that a result may depend on.
    """
    changed = _git(root, "status", "--porcelain", "--", ".", *NOT_MEASURED)
    if changed:
        files = ", ".join(line[3:] for line in changed.splitlines()[:5])
        raise ConfigError(f"--keep records the commit that was measured: commit your changes first ({files})")
    return _git(root, "rev-parse", "--short=12", "HEAD").strip()


def _git(root: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise ConfigError("--keep records the commit that was measured: it needs a git clone of the project") from error
    return done.stdout


def _without_folders(option: str) -> str:
    """An option; of a path outside the project only its last part."""
    name, equals, value = option.rpartition("=") if option.startswith("-") else ("", "", option)
    return f"{name}{equals}{Path(value).name}" if Path(value).is_absolute() else option


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _rounded(own) for name, own in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(own) for own in value]
    # NumPy's float64 is a float; its JSON is that of a plain one.
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        key, _, value = line.partition(":")
        if key.strip() == "model name":
            return value.strip()
    return "unknown"
