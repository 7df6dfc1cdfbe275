"""`placed`: decoded legs end where the ankles were decoded to be.

A decoder tells where ankles are, and how joints are turned. Errors of a degree at each joint of a leg add up at its
end: ankles of sampled walks are 8 mm lower by the joints than by their places, and 5 mm nearer to each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.joint_groups import BALLS, HINGES, PELVIS_SIZE, matrix, six
from flexmotion.features.layout import POINTS, Layout
from flexmotion.human.body import Body
from flexmotion.human.skeleton import SIDES
from flexmotion.sampling.leg_reach import HIP_BALLS, reached, turned

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

_FIRST = PELVIS_SIZE + 6 * len(BALLS)
_KNEES, _ANKLES = (
    [_FIRST + HINGES.index(f"{name}_{side}") for side in SIDES] for name in ("knee_flexion", "ankle_dorsiflexion")
)
_PARTS = [0, *(1 + ball for ball in HIP_BALLS)]
"""The pelvis and both hips among the rotations of two columns."""
_PLACES = [POINTS.index(f"ankle_{side}") for side in SIDES]


def placed(features: Float32, layout: Layout, body: Body) -> Float32:
    """Features with legs whose rotations bring the ankles to their places, as far as they reach; feet keep their pitch.

    Args:
        features: not normalised, (T, layout.size).
        layout: of the features.
        body: of the human.
    """
    frames, blocks = len(features), layout.blocks
    rotations = features[:, blocks["rotations"]].astype(np.float64)
    columns = rotations[:, :_FIRST].reshape(frames, -1, 6)
    parts = matrix(columns[:, _PARTS])
    pelvis, hips = parts[:, :1], parts[:, 1:]
    ankles = features[:, blocks["positions"]].reshape(frames, -1, 3)[:, _PLACES].astype(np.float64) * body.leg
    ankles[..., 2] -= features[:, blocks["root"]][:, 3:4] * body.leg
    beside = 0.5 * body.segments.hip_width
    wanted = turned(pelvis.swapaxes(-1, -2), ankles) - [[0.0, beside, 0.0], [0.0, -beside, 0.0]]
    knees = rotations[:, _KNEES]
    hips, bent, dorsal = reached(body, hips, knees, rotations[:, _ANKLES], wanted)
    columns[:, _PARTS[1:]] = six(hips)
    rotations[:, :_FIRST], rotations[:, _KNEES], rotations[:, _ANKLES] = columns.reshape(frames, -1), bent, dorsal
    found = features.copy()
    found[:, blocks["rotations"]] = rotations
    return found
