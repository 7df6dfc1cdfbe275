"""`made_pose`: the pose of a gesture that was made by a recipe, in which it is held.

Recordings lack such gestures. The clips that the model was trained on were made by recipes, and so is their pose here:
arms, head and trunk come to rest in it from where they are. Left to the model, a sample in eight dropped the arm again,
hands were held by 2 to 5 cm elsewhere than in clips, and swung by up to 12 m/s from one pose to the next.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.gestures.moved import moved, moving
from flexmotion.gestures.plan import draw_plan
from flexmotion.human.body import Body
from flexmotion.sampling.at_rest import resting
from flexmotion.sampling.kept_pose import BEFORE, KeptPose
from flexmotion.sampling.made_gestures import made_gesture, moves_legs

Float = NDArray[np.float64]

REACHING_S = 0.2
"""Time constant with which the pose is reached [s]: a hand that is raised from the hip peaks at 2 m/s, as people's."""


def made_pose(kind: str, body: Body, base: Float, rest: Float, seed: int) -> KeptPose | None:
    """The pose in which a gesture is held; None of a kind without a recipe, or that moves the legs.

    Args:
        kind: of a pose.
        body: of the human.
        base: joint angles when the gesture begins, (26,) [rad]: head and trunk turn from there, where they are near
            `rest`.
        rest: of a standing human, (26,) [rad].
        seed: of what the recipe leaves open.
    """
    found = made_gesture(kind)
    if found is None or moves_legs(found[0]):
        return None
    gesture, side = found
    plan = draw_plan(gesture, body, side, np.random.default_rng(seed))
    reached = moved(resting(base, rest)[None], np.array([plan.strokes[0].end + plan.lead]), plan)[0]
    return KeptPose(reached, BEFORE, tuple(moving(plan)), REACHING_S)
