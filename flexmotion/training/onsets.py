"""When clips begin to show their motion: before a bow a person stands, for a moment or for seconds.

A robot that is asked to bow begins at once. A model that learns windows of standing people as "bow", because the bow
comes at their end, waits as long as those people did, and a mean of all their waits is a weak bow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LATE_S = 0.15
"""Longest time in which a window of a motion may wait for it; about what a person needs to respond [s]."""

LEAST = 0.08
"""A clip whose points move by less in the mean has no onset [leg]: a standing person sways by less."""

TOLD_BY = {"bow": ("shoulder_l", "shoulder_r")}
"""Points by which the onset of a kind is told, where all would mislead: people lay their hands together, stand for a
second and then bow. A model remembers a quarter of a second, does not know how long it has stood, and waits on."""

PASSED, BEGUN = 0.3, 0.1
"""Shares of the greatest displacement: a motion is under way at the first, and has begun at the second."""

WITHIN_S = 4.0
"""Time from the beginning of a clip in which its onset is looked for: a long clip shows more than one motion."""


def onset(places: NDArray[np.floating]) -> int:
    """Frame in which the body leaves the pose that it begins in; 0 where it hardly moves.

    Args:
        places: points of the body in its heading frame, (T, P, 3) [leg].
    """
    far = np.linalg.norm(places - places[:1], axis=-1).mean(axis=1)
    most = float(far.max())
    if most < LEAST:
        return 0
    passed = int(np.argmax(far > PASSED * most))
    before = np.flatnonzero(far[:passed] < BEGUN * most)
    return int(before[-1]) if len(before) else 0
