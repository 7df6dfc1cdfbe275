"""Output of commands: results to stdout, progress to stderr.

No text is read as markup. It may hold a user's sentence or a file name, and a tag in it (`[/]`) would be dropped, or
raise an error in the middle of a run.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

_STEPS = 200
"""Most redraws of a progress bar in a run: a loop of 125 Hz must not wait for a terminal."""


def print_result(result: RenderableType) -> None:
    """Print text or a table to stdout; into a pipe without colours, 120 columns wide."""
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = 120
    console.print(result)


def print_json(content: Any) -> None:
    """Print JSON to stdout; `content` is JSON text, or an object that `json` can write."""
    print(content if isinstance(content, str) else json.dumps(content, indent=2, allow_nan=False), flush=True)


class _Stderr(Console):
    """A console that goes quiet on a broken pipe; rich would end the program while a robot is moving."""

    def __init__(self) -> None:
        super().__init__(stderr=True, highlight=False, markup=False)

    def on_broken_pipe(self) -> None:
        """Go quiet; rich calls this."""
        self.quiet = True


def print_note(text: str) -> None:
    """Print one line to stderr."""
    with suppress(OSError, ValueError):
        _Stderr().print(text, style="dim", soft_wrap=True)


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[float], None]]:
    """Context with a bar on stderr; yields a function that takes the share done, in [0, 1].

    The bar appears with the first call: its thread must not run yet when processes are forked.
    """
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    progress = Progress(*columns, TimeElapsedColumn(), console=_Stderr(), transient=True)
    task = progress.add_task(title, total=1.0)
    shown = -1

    def update(done: float) -> None:
        nonlocal shown
        if (step := int(done * _STEPS)) != shown:
            shown = step
            progress.start()
            progress.update(task, completed=done)

    try:
        yield update
    finally:
        if shown >= 0:
            progress.stop()
