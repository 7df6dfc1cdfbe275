"""Tables of the figures of `evaluate`: one metric a line, or one condition a line; for a terminal, or as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from flexmotion.evaluation.interval import Interval
from flexmotion.evaluation.meanings import MEANINGS, meanings_of

Figures = Mapping[str, Interval]

ABSENT = "-"

OF_CONDITIONS: dict[str, str] = {
    "fid": "FID",
    "r_precision_top3": "R top 3",
    "diversity": "diversity",
    "skate_ratio": "skate",
    "float_mm": "float mm",
    "penetrate_mm": "below mm",
    "contact_force": "force % weight",
    "actuation": "torque N·m/kg",
    "muscle_limit": "muscle %",
    "trajectory_error": "> .5 m",
}
"""Columns of the paper's table: metric -> heading."""

OF_ASKED: dict[str, str] = {
    "place_cm": "{} cm",
    "torque": "{} N·m/kg",
    "force": "{} % weight",
    "activation_r": "r {}",
}
"""Metrics of what was asked, and how they are written."""

_ASKED = (
    "asked: how well it is kept, in brackets by windows that were not told: distance of joints, error of torques and "
    "forces, correlation of activations over a window's frames"
)


@dataclass(frozen=True)
class FigureTable:
    """A table of text.

    Attributes:
        headings: of the columns; lines: each with as many cells.
        legend: lines that say what the figures are.
    """

    headings: Sequence[str]
    lines: Sequence[Sequence[str]]
    legend: Sequence[str] = ()

    @property
    def markdown(self) -> str:
        """As Markdown."""
        rows = [self.headings, ["---"] * len(self.headings), *self.lines]
        return "".join(f"| {' | '.join(row)} |\n" for row in rows)

    def write(self, path: Path, command: str, note: str) -> None:
        """Write it as Markdown, with the command that made it and the date.

        Args:
            path: of the file, which is replaced.
            command: that makes it again.
            note: what it is of.
        """
        made = f"Made by `{command}` on {datetime.now():%Y-%m-%d}. {note}"
        legend = "".join(f"- {line}\n" for line in self.legend)
        path.write_text(f"{made}\n\n{self.markdown}\n{legend}", encoding="utf-8")


def metric_table(rows: Mapping[str, Figures]) -> FigureTable:
    """One metric a line, one model a column."""
    metrics = dict.fromkeys(metric for row in rows.values() for metric in row)
    lines = [[metric, *(str(row.get(metric, ABSENT)) for row in rows.values())] for metric in metrics]
    return FigureTable(["metric", *rows], lines, meanings_of(list(metrics)))


def condition_table(rows: Mapping[str, Figures | str]) -> FigureTable:
    """One condition a line; behind it what was asked was kept how well, and how well where it was not told.

    Args:
        rows: condition -> figures, or why the model cannot follow it.
    """
    lines = []
    for name, row in rows.items():
        if isinstance(row, str):
            lines.append([name, row, *[ABSENT] * len(OF_CONDITIONS)])
            continue
        figures = (_short(row[metric]) if metric in row else ABSENT for metric in OF_CONDITIONS)
        lines.append([name, "; ".join(_asked(row)) or ABSENT, *figures])
    legend = [f"{heading}: {MEANINGS[metric]}" for metric, heading in OF_CONDITIONS.items() if metric in MEANINGS]
    legend = [_ASKED, *legend, "R top 3: share of sentences whose window is among the nearest 3 of 32"]
    return FigureTable(["condition", "asked: kept (untold)", *OF_CONDITIONS.values()], lines, legend)


def _asked(row: Figures) -> Iterable[str]:
    for metric, text in OF_ASKED.items():
        if metric in row:
            yield f"{text.format(_short(row[metric]))} ({_short(row[f'{metric}_untold'])})"


def _short(value: Interval) -> str:
    return f"{value.mean:.3g}"
