"""`ExternalLoad`: an external force other than the ground's, such as a push or a bag."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


@dataclass(frozen=True)
class ExternalLoad:
    """Force on a segment at its centre of mass.

    Attributes:
        segment: name of the model's body.
        force: in the world, (T, 3) [N].
    """

    segment: str
    force: Float
