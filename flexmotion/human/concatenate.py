"""Motions joined one after another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexmotion.human.motion import DYNAMIC, Motion


def concatenate(parts: Sequence[Motion]) -> Motion:
    """All frames of `parts` as one motion with the body of the first.

    Torques, wrenches, centres of pressure, activations, joint contact and contacts are kept where all parts have them.

    Raises:
        ValueError: there are no parts, or their frame rates differ.
    """
    if not parts or len({part.fps for part in parts}) > 1:
        raise ValueError(f"expected motions of one frame rate, found {[part.fps for part in parts]}")
    first = parts[0]
    quaternions = [first.root_quaternion]
    for part in parts[1:]:
        # Both signs are the same rotation; keep the one without a jump.
        known = next((done for done in reversed(quaternions) if len(done)), part.root_quaternion)
        flipped = len(part) and known[-1] @ part.root_quaternion[0] < 0
        quaternions.append(-part.root_quaternion if flipped else part.root_quaternion)
    optional: dict[str, Any] = {}
    for name in DYNAMIC:
        # A part without frames lacks nothing.
        values = [getattr(part, name) for part in parts if len(part)]
        whole = bool(values) and all(value is not None for value in values)
        optional[name] = np.concatenate(values) if whole else None
    return first.trusted(
        root_position=np.concatenate([part.root_position for part in parts]),
        root_quaternion=np.concatenate(quaternions),
        joints=np.concatenate([part.joints for part in parts]),
        **optional,
    )
