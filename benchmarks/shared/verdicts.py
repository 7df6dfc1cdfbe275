"""How the benchmarks of the model end: criteria with their verdict, rows for a CSV file, an exit code."""

from __future__ import annotations

import csv
import functools
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from flexmotion.configs.errors import FlexMotionError


@dataclass(frozen=True)
class Verdict:
    """A criterion as a sentence with its figure, and whether it holds."""

    sentence: str
    holds: bool


def benchmark(command: Callable[..., Sequence[Verdict]]) -> None:
    """Run a command that takes its options from the command line; exit with 1 where a criterion does not hold.

    An error that is one line for the user (`FlexMotionError`) ends with its own exit code.
    """

    @functools.wraps(command)
    def judged(*arguments: Any, **options: Any) -> None:
        try:
            verdicts = command(*arguments, **options)
        except FlexMotionError as error:
            print(f"{Path(sys.argv[0]).name}: {error}", file=sys.stderr)
            raise typer.Exit(error.exit_code) from error
        console = Console(width=160)
        for verdict in verdicts:
            console.print(f"{'[green]PASS' if verdict.holds else '[red]FAIL'}[/] {verdict.sentence}")
        if not all(verdict.holds for verdict in verdicts):
            raise typer.Exit(1)

    typer.run(judged)


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """One line a row; columns are the first row's."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
