"""Figures as cells of a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import median

import numpy as np


def middle(values: Iterable[float | None]) -> float | None:
    """Median of the known values; None without any."""
    known = [value for value in values if value is not None]
    return median(known) if known else None


def cell(value: float | None, form: str = ".2f") -> str:
    """A figure, or a dash where it is unknown."""
    return "-" if value is None else format(value, form)


def share(values: Sequence[bool]) -> float:
    """Share of true values; 0 without any."""
    return sum(values) / len(values) if values else 0.0


def percent(values: Sequence[bool]) -> str:
    """Share of true values as a percentage; a dash without any."""
    return f"{100 * share(values):.0f} %" if values else "-"


def degrees(value: float | None) -> float | None:
    """Radians to degrees."""
    return None if value is None else float(np.degrees(value))
