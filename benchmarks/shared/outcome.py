"""`Outcome`: what a benchmark found, as verdicts and figures; and rows for a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Verdict:
    """A criterion as a sentence with its figure and limit, and whether it holds."""

    sentence: str
    holds: bool


@dataclass(frozen=True)
class Outcome:
    """The end of a benchmark.

    Attributes:
        verdicts: every criterion; none where the benchmark only measures.
        figures: numbers and texts by name, nested where there are groups; this is what `--keep` writes.
    """

    verdicts: Sequence[Verdict] = ()
    figures: Mapping[str, Any] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether every criterion holds."""
        return all(verdict.holds for verdict in self.verdicts)


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write one line a row; the columns are those of the first row."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
