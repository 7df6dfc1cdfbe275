"""`columns_of`: where the compiled loops find what is in the features of a layout."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from flexmotion.features.feature_loops import Columns
from flexmotion.features.joint_groups import BALL_COLUMNS, BALL_SIGNS, HINGE_COLUMNS
from flexmotion.features.layout import POINTS, Layout
from flexmotion.human.skeleton import SIDES


@lru_cache(maxsize=8)
def columns_of(layout: Layout) -> Columns:
    """Columns of a layout."""
    blocks = {name: cut.start for name, cut in layout.blocks.items()}
    return Columns(
        root=blocks["root"],
        rotations=blocks["rotations"],
        positions=blocks["positions"],
        wrenches=blocks["wrenches"],
        ankles=np.array([blocks["positions"] + 3 * POINTS.index(f"ankle_{side}") for side in SIDES]),
        balls=BALL_COLUMNS,
        signs=BALL_SIGNS,
        hinges=HINGE_COLUMNS,
    )
