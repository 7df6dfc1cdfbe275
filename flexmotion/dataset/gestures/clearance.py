"""How far hands and forearms stay clear of the body: distances between the shapes of `human_model`."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import SIDES

Float = NDArray[np.float64]

FAR = 0.3
"""Distances beyond this one are not computed [m]."""

EVERY = 2
"""Every second frame is looked at: 1/15 s."""


def clearance(motion: Motion, frames: slice = slice(None)) -> float:
    """Least distance of hands and forearms to trunk, head, thighs and the other arm [m]; negative where they overlap.

    Args:
        motion: of the human.
        frames: that are looked at.
    """
    human = human_model(motion.body)
    model, data = human.model, mujoco.MjData(human.model)
    pairs = _pairs(model)
    qpos, least, line = human.qpos(motion)[frames][::EVERY], FAR, np.empty(6)
    for pose in qpos:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        for first, second in pairs:
            least = min(least, mujoco.mj_geomDistance(model, data, first, second, least, line))
    return float(least)


def _pairs(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Geoms of hands and forearms, each with the geoms that it must stay clear of."""

    def of(*bodies: str) -> list[int]:
        ids = {model.body(name).id for name in bodies}
        return [geom for geom in range(model.ngeom) if int(model.geom_bodyid[geom]) in ids]

    found = []
    for side, other in zip(SIDES, reversed(SIDES), strict=True):
        around = of("torso", "pelvis", "head", f"femur_{side}", f"femur_{other}")
        # Each pair of arms once.
        arm = of(f"humerus_{other}", f"ulna_{other}", f"hand_{other}") if side == "l" else of(f"humerus_{other}")
        found += [(geom, to) for geom in of(f"hand_{side}", f"ulna_{side}") for to in around + arm]
    return found
