"""Windows of kicks, punches and slashes without the stroke: between strokes all of them are a fighter's guard.

Of the windows of the clips labelled `kick` two in five raise a foot, of those labelled `punch` half strike. Taught with
the rest, a model that is asked for either stands on guard.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from flexmotion.features.layout import Layout

RAISED = 0.45
"""Height of the toe of a kick, above the floor [leg]."""

STRIKES = 3.2
"""Least greatest speed of a striking hand against its shoulder [leg/s]."""

KICKS, BLOWS = ("kick",), ("punch", "slash")
"""Kinds of motion with a stroke of a foot, and of a hand."""


def without_stroke(kinds: Sequence[str], future: Tensor, layout: Layout) -> NDArray[np.bool_]:
    """Whether windows are of a kind with a stroke and do not show it, (N,).

    Args:
        kinds: of the windows' clips, N.
        future: features, not normalised, (N, W, F).
        layout: of the features.
    """
    points = {name: at for at, name in enumerate(layout.points)}
    sides = ("l", "r")
    places = future[..., layout.blocks["positions"]].unflatten(-1, (-1, 3))
    speeds = future[..., layout.blocks["velocities"]].unflatten(-1, (-1, 3))
    toes = places[:, :, [points[f"toe_{side}"] for side in sides], 2].amax(dim=(1, 2)).numpy()
    hands, shoulders = (speeds[:, :, [points[f"{name}_{side}"] for side in sides]] for name in ("hand", "shoulder"))
    strike = (hands - shoulders).norm(dim=-1).amax(dim=(1, 2)).numpy()
    kick, blow = (np.isin(np.asarray(kinds), of) for of in (KICKS, BLOWS))
    missing: NDArray[np.bool_] = (kick & (toes < RAISED)) | (blow & (strike < STRIKES))
    return missing
