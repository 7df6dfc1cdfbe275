"""Figures of reports as JSON: rounded, and null where unknown."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict

DIGITS = 6
"""Significant digits of a figure."""


def _rounded(value: float | None) -> float | None:
    """`DIGITS` significant digits; None for NaN and infinity, which JSON lacks."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.{DIGITS}g}") + 0.0  # + 0.0: no negative zero


Figure = Annotated[float, BeforeValidator(_rounded)]
Maybe = Annotated[float | None, BeforeValidator(_rounded)]


class Section(BaseModel):
    """A part of a report: its fields are its keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)
