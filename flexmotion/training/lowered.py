"""Windows of raised hands in which a hand comes down.

People in recordings raise a hand and lower it half a second later. A robot that is asked to raise a hand keeps it up
until something else is asked. A model that learns all windows as "raise" lowers the hand by chance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from flexmotion.features.layout import Layout
from flexmotion.text.phrases import is_brief
from flexmotion.text.sides import sides

LOWERED = 0.15
"""By how much a hand that comes down is lower at the end of a window than before [leg]: hands that are kept up sway by
less, and arms that are lowered pass it within a fifth of a second."""


def lowers_hands(kinds: Sequence[str], future: Tensor, layout: Layout) -> NDArray[np.bool_]:
    """Whether windows are of raised hands and lower one of those, (N,).

    Args:
        kinds: of the windows' clips, N.
        future: features, not normalised, (N, W, F).
        layout: of the features.
    """
    points = {name: at for at, name in enumerate(layout.points)}
    places = future[..., layout.blocks["positions"]].unflatten(-1, (-1, 3))
    found = np.zeros(len(kinds), np.bool_)
    for at, kind in enumerate(kinds):
        if is_brief(kind):
            hands = [points[f"hand_{side[0]}"] for side in sorted(sides(kind) or ("left", "right"))]
            height = places[at, :, hands, 2]
            found[at] = bool((height.amax(dim=0) - height[-1] > LOWERED).any())
    return found
