"""`Capture`: content of a motion file in its own skeleton, units and axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Capture:
    """Named points of a moving skeleton, with orientations if the format has them.

    Attributes:
        path: of the file, for messages.
        fps: frames per second.
        names: of the J points.
        positions: in the file's world, (T, J, 3) [file units, or metres: see `units`]; NaN where a marker is missing.
        rotations: of each point's own frame in the file's world, (T, J, 3, 3); None for formats of points only.
        parents: index of each point's parent, -1 for a root; None where the format has no hierarchy.
        zero_positions: positions with every rotation at zero and the root at the origin, (J, 3); None where the format
            has no such pose.
        start: time of the first frame in the file [s].
        warnings: what a user should know about how the file was read.
        units: that the header names, of positions that are in metres by it; None of those in units of the file.
        up: upward axis of the file, of positions that are turned to z up already; None of those that are not.
        pelvis: its rotation (x forward, y left, z up in upright stance) where surface markers show it, in the axes of
            positions that are turned to z up already, (T, 3, 3).
    """

    path: str
    fps: float
    names: tuple[str, ...]
    positions: Float
    rotations: Float | None = None
    parents: tuple[int, ...] | None = None
    zero_positions: Float | None = None
    start: float = 0.0
    warnings: tuple[str, ...] = ()
    units: Literal["m", "cm", "mm", "inch"] | None = None
    up: Literal["y", "z"] | None = None
    pelvis: Float | None = None

    def __len__(self) -> int:
        return len(self.positions)

    def select(self, names: Sequence[str]) -> NDArray[np.intp]:
        """Indices of the points with these names."""
        column = {name: index for index, name in enumerate(self.names)}
        return np.array([column[name] for name in names], dtype=np.intp)

    def common_ancestor(self, first: str, second: str) -> str:
        """Lowest common ancestor of two points."""
        parents = self.parents
        if parents is None:
            raise ValueError("this capture has no hierarchy")

        def ancestors(name: str) -> list[int]:
            chain = [self.names.index(name)]
            while parents[chain[-1]] >= 0:
                chain.append(parents[chain[-1]])
            return chain

        others = set(ancestors(second))
        return self.names[next(joint for joint in ancestors(first) if joint in others)]


def without_prefix(capture: Capture) -> Capture:
    """The same with `Subject:` taken off the names of its points, unless two names would then be equal."""
    plain = tuple(name.rsplit(":", 1)[-1].strip() for name in capture.names)
    return replace(capture, names=plain) if len(set(plain)) == len(plain) else capture
