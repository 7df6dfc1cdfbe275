"""Runs one benchmark as a command: its options and `--keep`, its verdicts, its exit code."""

from __future__ import annotations

import functools
import importlib
import inspect
import re
import sys
import time
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NoReturn, get_type_hints

import typer
from rich.console import Console

from benchmarks.catalogue import Benchmark
from benchmarks.results import Result, check_imported, measured_commit
from benchmarks.shared.outcome import Outcome
from flexmotion.configs.errors import FlexMotionError

KeepOption = Annotated[bool, typer.Option("--keep", help="Write the result to benchmarks/results/.")]


def run(benchmark: Benchmark, options: Sequence[str]) -> None:
    """Run a benchmark with the options of its command line, and exit.

    Exits with 0, with 1 where a criterion does not hold, and with the code of an error that is one line for the user
    (`FlexMotionError`).
    """
    program = f"python -m benchmarks {benchmark.name}"
    try:
        benchmark.check_extras()
        main = importlib.import_module(benchmark.module).main
    except FlexMotionError as error:
        _exit(program, error)
    app = typer.Typer(add_completion=False)
    app.command(help=_paragraphs(sys.modules[benchmark.module].__doc__ or ""))(
        _judged(benchmark, main, options, program)
    )
    app(args=list(options), prog_name=program)


def _judged(
    benchmark: Benchmark, main: Callable[..., Outcome], options: Sequence[str], program: str
) -> Callable[..., None]:
    """A command that calls `main`, prints the verdicts, and takes `--keep` besides the options of `main`."""

    @functools.wraps(main)
    def command(*, keep: bool, **values: Any) -> None:
        try:
            commit = ""
            if keep:
                check_imported()
                commit = measured_commit()
            begin = time.perf_counter()
            outcome = main(**values)
            seconds = time.perf_counter() - begin
        except FlexMotionError as error:
            _exit(program, error)
        console = Console(width=160)
        for verdict in outcome.verdicts:
            console.print(f"{'[green]PASS' if verdict.holds else '[red]FAIL'}[/] {verdict.sentence}")
        if keep:
            given = [option for option in options if option != "--keep"]
            path = Result.of(benchmark.name, given, commit, seconds, outcome).write()
            print(f"kept: {path}")
        if not outcome.passed:
            raise typer.Exit(1)

    hints = get_type_hints(main, include_extras=True) | {"keep": KeepOption, "return": None}
    keep_option = inspect.Parameter("keep", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=KeepOption)
    known = [own.replace(annotation=hints[own.name]) for own in inspect.signature(main).parameters.values()]
    command.__annotations__ = hints
    # Typer reads the options of a command from its signature.
    command.__signature__ = inspect.Signature([*known, keep_option])  # type: ignore[attr-defined]
    return command


def _paragraphs(text: str) -> str:
    """A docstring with its paragraphs as lines; items of lists stay lines."""
    return re.sub(r"(?<!\n)\n(?!\n|- )", " ", text)


def _exit(program: str, error: FlexMotionError) -> NoReturn:
    print(f"{program}: {error}", file=sys.stderr)
    sys.exit(error.exit_code)
