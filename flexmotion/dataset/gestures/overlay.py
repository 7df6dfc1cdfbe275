"""`overlaid`: a planned gesture over the motion of a base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmotion.dataset.gestures.legs import lowered_pelvis
from flexmotion.gestures.moved import moved
from flexmotion.gestures.plan import Plan
from flexmotion.gestures.tracks import values
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion


def overlaid(base: Motion, plan: Plan, rng: np.random.Generator) -> Motion:
    """The base with the gesture: its arms, head, trunk and knees where the gesture moves them, the base's elsewhere.

    Args:
        base: at least as long as the plan.
        plan: the gesture.
        rng: random generator of the unrest of held poses.
    """
    times = np.arange(len(base)) / base.fps
    joints = moved(base.joints, times, plan, rng)
    motion = replace(
        base, joints=joints, torques=None, wrenches=None, activations=None, joint_contact=None, contacts=None
    )
    down, tilt = values(times, plan.strokes, plan.targets.down, np.zeros((len(times), 2))).T
    if not down.any():
        return motion
    # People keep their balance: over the feet, where they stood.
    return lowered_pelvis(motion, down * base.body.leg, tilt, forward(base).com)
