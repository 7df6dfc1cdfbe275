"""Names of the points of a file: all different, with the copies and parts of one trajectory joined."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.importers.rigid import visible

Float = NDArray[np.float64]

SAME_POINT = 1e-3
"""Greatest distance of two copies of a point, as a share of the extent of all points (2 mm in a standing human)."""


def unique_names(labels: Sequence[str], positions: Float) -> tuple[tuple[str, ...], Float, list[str]]:
    """Names of points that are all different, the positions of those points, and warnings.

    Points of one name are joined where they agree in every frame that shows two of them: copies of a trajectory, or its
    parts. Others, and points without a name, are named `*NUMBER`.

    Args:
        labels: of the J points; empty for one without a name.
        positions: of the points, (T, J, 3); NaN where one is missing.
    """
    names, positions, notes = [name or f"*{index}" for index, name in enumerate(labels, 1)], positions.copy(), []
    for name in sorted({name for name in names if names.count(name) > 1}):
        columns = [index for index, own in enumerate(names) if own == name]
        joined = _joined(positions[:, columns], _extent(positions))
        if joined is None:
            notes.append(f"{name}: name of {len(columns)} different markers, none of them is used")
        else:
            positions[:, columns[0]] = joined
            notes.append(f"{name}: name of {len(columns)} markers, which are copies or parts of one: joined")
        for column in columns if joined is None else columns[1:]:
            names[column] = f"*{name}/{column + 1}"
    return tuple(names), positions, notes


def named(names: Sequence[str]) -> list[str]:
    """Names without those that `unique_names` made."""
    return [name for name in names if not name.startswith("*")]


def _extent(positions: Float) -> float:
    """Median over frames of the largest distance of two known points along one axis."""
    seen = positions[visible(positions).sum(axis=1) > 1]
    return float(np.median((np.nanmax(seen, axis=1) - np.nanmin(seen, axis=1)).max(axis=1))) if len(seen) else 0.0


def _joined(tracks: Float, extent: float) -> Float | None:
    """One trajectory (T, 3) of several, (T, K, 3); None where two of them differ."""
    joined = tracks[:, 0].copy()
    for track in np.moveaxis(tracks[:, 1:], 1, 0):
        both = visible(joined) & visible(track)
        if (np.linalg.norm(joined[both] - track[both], axis=-1) > SAME_POINT * extent).any():
            return None
        only = visible(track) & ~visible(joined)
        joined[only] = track[only]
    return joined
