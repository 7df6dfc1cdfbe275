"""Small networks for benchmarks that train many models, and ratios of what they measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from flexmotion.configs.model import Transformer


def small(width: int, layers: int) -> Transformer:
    """A network of four heads."""
    return Transformer(width=width, heads=4, layers=layers)


def mean_ratio(rows: Sequence[Mapping[str, float]], without: Sequence[Mapping[str, float]], name: str) -> float:
    """Mean of a figure over some runs, over its mean over others; 1 where both are 0."""
    first, second = (sum(row[name] for row in own) / len(own) for own in (rows, without))
    return first / second if second else (1.0 if not first else float("inf"))
