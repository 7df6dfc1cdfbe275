"""Figures of targets by the prompt of their run, and a table of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

import numpy as np
from rich.console import Console
from rich.table import Table

Figures = dict[str, Any]


class AskedRow(Protocol):
    """One target: the prompt of its run, and the state of its answer."""

    @property
    def prompt(self) -> str:
        """Of the run."""
        ...

    @property
    def state(self) -> str:
        """Of the answer."""
        ...


Row = TypeVar("Row", bound=AskedRow)


def within(values: Sequence[float], bound: float) -> float:
    """Share of values that are within a bound; NaN is not."""
    return float(np.mean([value <= bound for value in values]))


def states(rows: Sequence[AskedRow]) -> dict[str, int]:
    """How many answers have each state."""
    return {state: sum(row.state == state for row in rows) for state in sorted({row.state for row in rows})}


def by_prompt(rows: Sequence[Row], of: Callable[[Sequence[Row]], Figures]) -> Figures:
    """Figures of all rows, and under `prompts` those of each prompt in the order in which they come."""
    own = {
        prompt: [row for row in rows if row.prompt == prompt] for prompt in dict.fromkeys(row.prompt for row in rows)
    }
    return of(rows) | {"prompts": {prompt: of(part) for prompt, part in own.items()}}


def show(found: Figures, columns: Mapping[str, Callable[[Figures], str]]) -> None:
    """Print a row for each prompt, and one for all. `columns`: heading, and what its cells say of figures."""
    table = Table("prompt", "targets", *columns)
    for name, own in [*found["prompts"].items(), ("all", found)]:
        table.add_row(name, str(own["targets"]), *(cell(own) for cell in columns.values()))
    Console(width=120).print(table)


def percent(name: str) -> Callable[[Figures], str]:
    """A cell with a share in percent."""
    return lambda own: f"{own[name]:.0%}"


def millimetres(name: str) -> Callable[[Figures], str]:
    """A cell with a length [m] in millimetres."""
    return lambda own: f"{1000 * own[name]:.1f} mm"


def degrees(name: str) -> Callable[[Figures], str]:
    """A cell with an angle [°]."""
    return lambda own: f"{own[name]:.1f}°"


def answers(own: Figures) -> str:
    """A cell with the states of the answers."""
    return ", ".join(f"{count} {state}" for state, count in own["states"].items())
