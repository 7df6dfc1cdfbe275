"""`python -m benchmarks`: lists the benchmarks, runs one, or makes the tables of the documents."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from benchmarks.catalogue import CATALOGUE, find
from benchmarks.command import run
from benchmarks.results import kept
from benchmarks.shared.program import end_on_terminate
from benchmarks.tables import main as tables
from flexmotion.configs.errors import FlexMotionError

USAGE = """usage: python -m benchmarks [list]             list the benchmarks and their last kept results
       python -m benchmarks NAME [options]     run one; --help shows its options, --keep keeps its result
       python -m benchmarks tables [--check]   write the tables of the documents from the kept results
"""


def listing() -> Table:
    """Every benchmark, with what it asks, takes and needs, and its last kept result."""
    table = Table(title="Benchmarks")
    for column in ("name", "asks", "takes", "needs", "last result"):
        table.add_column(column, no_wrap=column in ("name", "takes", "last result"))
    for benchmark in CATALOGUE:
        result = kept(benchmark.name)
        last = "-"
        if result is not None:
            verdict = ("PASS" if result.passed else "FAIL") if result.verdicts else "measured"
            last = f"{verdict} {result.commit[:7]} {result.date}"
        needs = ", ".join(need.value for need in benchmark.needs)
        table.add_row(benchmark.name, benchmark.asks, benchmark.takes, needs, last)
    return table


def main(arguments: Sequence[str]) -> int:
    """Run a command line; returns the exit code."""
    try:
        match arguments:
            case [] | ["list"]:
                # Another program reads whole lines.
                console = Console() if sys.stdout.isatty() else Console(width=160)
                console.print(listing())
                console.print(USAGE, end="", highlight=False, markup=False)
                return 0
            case ["-h" | "--help"]:
                print(USAGE, end="")
                return 0
            case ["tables", *options]:
                return tables(options)
            case [name, *options]:
                end_on_terminate()
                run(find(name), options)
    except FlexMotionError as error:
        print(f"python -m benchmarks: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
